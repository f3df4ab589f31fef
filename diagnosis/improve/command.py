"""``spot-rl improve``."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Annotated

import typer

from spot_model.console.command_registry import Overrides, PolicyFile
from trainer.simulate.engine import Device, Workers


def improve(
    logs: Annotated[list[Path], typer.Argument(help="Log files of one robot and policy, or folders of them.")],
    policy: PolicyFile,
    nominal: Annotated[str, typer.Option("--nominal", help="The model it was trained on: a file, or a built-in name.")],
    out: Annotated[Path, typer.Option("--out", help="Folder of all results; a second call continues there.")],
    config: Annotated[
        Path | None, typer.Option("--config", help="Training config (YAML), for a GPU; by default this command's own.")
    ] = None,
    set_: Overrides = None,
    n: Annotated[int, typer.Option("--n", help="Robots in the trials that count falls.", min=10)] = 100,
    seed: Annotated[int, typer.Option("--seed", help="Random seed.", min=0)] = 0,
    workers: Workers = 2,
    device: Device = "cpu",
) -> None:
    """Correct the model by a robot's logs, train the policy further on it, and compare old and new."""
    typer.echo("loading the diagnosis …", err=True)
    from diagnosis.improve.session import ImproveRequest, improve_policy
    from trainer.simulate.engine import check_device

    check_device(device)
    inputs = ImproveRequest.of(logs, policy, nominal, config, tuple(set_ or ()), n, seed)
    try:
        say = functools.partial(typer.echo, err=True)
        result, page = improve_policy(inputs, out, workers=workers, device=device, say=say)
    except KeyboardInterrupt:
        typer.echo(f"interrupted; the same command goes on from what is in {out}", err=True)
        raise typer.Exit(130) from None
    typer.echo(result.headline)
    for figure in result.figures:
        typer.echo(f"  {figure.name:<42} {figure.old:>14} -> {figure.new:>14} {figure.unit:<6} {figure.kind}")
    typer.echo(f"page {page}")
