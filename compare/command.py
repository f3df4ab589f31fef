"""``spot-rl compare``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from spot_model.console.command_registry import PolicyThatRan


def compare(
    log: Annotated[str, typer.Argument(help="The log (*.mcap) that the others are compared with.", metavar="LOG")],
    others: Annotated[
        list[str],
        typer.Argument(help="Other logs, or models: a model is simulated with LOG's commands.", metavar="OTHER"),
    ],
    out: Annotated[Path, typer.Option("--out", help="Folder for page, ghost log, figures and layout.")],
    policy: PolicyThatRan = None,
    verdict: Annotated[
        Path | None,
        typer.Option("--verdict", help="Folder of a diagnosis of LOG, whose cause is marked on the timeline."),
    ] = None,
    beside: Annotated[
        float,
        typer.Option("--beside", min=0.0, max=10.0, help="Distance from the robot to its ghost, m; 0: inside it."),
    ] = 0.7,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Random seed of simulated sensors and delays.")] = 0,
) -> None:
    """Compare a log with other logs or simulations: one page, and a ghost Spot in Foxglove."""
    typer.echo("loading the simulator …", err=True)
    from compare.cause import check_verdict, read_verdict
    from compare.compare import (
        FILES,
        LAYOUT_NAME,
        LOG_NAME,
        PAGE_NAME,
        Named,
        compare_runs,
        is_model,
        named,
        read_other,
        read_reference,
        write_comparison,
    )
    from spot_model.io.whole import check_new

    check_new(*(out / name for name in FILES))
    told = read_verdict(verdict) if verdict is not None else None
    reference = read_reference(log)
    if told is not None and verdict is not None:
        check_verdict(told, verdict, reference)
    runs = [Named(log, reference)]
    for other in others:
        if is_model(other):
            typer.echo(f"simulating {other} with the commands of {log}", err=True)
        runs.append(Named(other, read_other(other, reference, policy, seed), is_model(other)))
    found = compare_runs(named(runs), told)
    paths = write_comparison(found, out, beside)
    for line in (*found.sentences, *found.notes):
        typer.echo(line)
    typer.echo(f"page {paths[PAGE_NAME]}  Foxglove {paths[LOG_NAME]}  layout {paths[LAYOUT_NAME]}")
