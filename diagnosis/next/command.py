"""``spot-rl diagnose next``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from spot_model.policy.built_in import policy_file


def next_recording(
    folder: Annotated[Path, typer.Argument(help="Folder of a diagnosis.")],
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
    from diagnosis.next.files import load_motion, propose

    own = load_motion(experiment) if experiment is not None else None
    lines, page = propose(folder, policy, own=own, out=out, seed=seed)
    for line in (*lines, f"page: {page}"):
        typer.echo(line)
