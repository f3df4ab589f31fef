"""``spot-rl export``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from spot_model.errors import BadInputError
from spot_model.policy.built_in import policy_or_run


def export(
    run: Annotated[
        Path,
        typer.Argument(
            parser=policy_or_run,
            metavar="RUN",
            help="Run folder, a checkpoint, or a policy (ONNX file or built-in name): measured anew.",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="ONNX file to write.")] = Path("policy.onnx"),
    framework: Annotated[
        str | None, typer.Option("--for", help="Convert an ONNX policy of this project for mjlab or spot-rl-example.")
    ] = None,
    name: Annotated[str | None, typer.Option("--name", help="The policy's name; the config's by default.")] = None,
) -> None:
    """Write a trained policy as ONNX with its contract."""
    if framework is not None:
        from trainer.foreign.exporting import FRAMEWORKS, export_for

        if framework not in FRAMEWORKS:
            raise BadInputError(f"--for {framework}; allowed: {', '.join(FRAMEWORKS)}")
        for path in export_for(run, framework, out):
            typer.echo(f"{path} ({path.stat().st_size} bytes)")
        return
    from spot_model.io.whole import check_new
    from spot_model.policy.contract import gait_sentence

    check_new(out)
    typer.echo("loading torch …", err=True)
    from trainer.evaluate.export import export_policy

    typer.echo("measuring gait and turning at each speed", err=True)
    policy = export_policy(run, out, name)
    typer.echo(gait_sentence(policy.contract))
    typer.echo(f"policy {out} ({len(policy.file_bytes)} bytes)")
