"""``spot-rl diagnose next``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from spot_model.policy.built_in import policy_file


def next_recording(
    folder: Annotated[Path, typer.Argument(help="Folder of a diagnosis; with --logs, where the first one goes.")],
    logs: Annotated[
        list[Path] | None,
        typer.Option("--logs", help="First logs, if there is no diagnosis yet; repeatable."),
    ] = None,
    nominal: Annotated[str | None, typer.Option("--nominal", help="With --logs: the simulator's model.")] = None,
    policy: Annotated[
        Path | None,
        typer.Option(
            "--policy", parser=policy_file, metavar="POLICY", help="Policy for walks; default: the policy of the logs."
        ),
    ] = None,
    experiment: Annotated[
        Path | None,
        typer.Option("--experiment", help="Weigh your own recording (YAML) instead of the menu."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="New folder for the recordings; by default FOLDER/next.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Random seed.")] = 0,
) -> None:
    """Say what to record next: how much surer each recording of a short menu makes the numbers that are in doubt."""
    typer.echo("loading the library of effects and the simulator …", err=True)
    from diagnosis.next.files import first_diagnosis, load_motion, propose

    own = load_motion(experiment) if experiment is not None else None
    if logs:
        first_diagnosis(folder, logs, nominal, policy)
    lines, page = propose(folder, policy, own=own, out=out, seed=seed)
    for line in (*lines, f"page: {page}"):
        typer.echo(line)
