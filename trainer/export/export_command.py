"""``spot-rl export``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def export(
    run: Annotated[Path, typer.Argument(help="Run folder, or a checkpoint.")],
    out: Annotated[Path, typer.Option("--out", help="ONNX file to write.")] = Path("policy.onnx"),
    networks: Annotated[
        Path | None, typer.Option("--networks", help="Also write the networks alone, for start_from.")
    ] = None,
    name: Annotated[str | None, typer.Option("--name", help="The policy's name; the config's by default.")] = None,
) -> None:
    """Write a trained policy as ONNX with its contract."""
    from trainer.export.export import export_policy
    from trainer.ppo.checkpoint import find_checkpoint, save_networks

    path = export_policy(run, out, name)
    if networks is not None:
        save_networks(find_checkpoint(run), networks)
    typer.echo(f"policy {path} ({path.stat().st_size} bytes)")
