"""``spot-rl diagnose next`` and ``spot-rl diagnose predict``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from spot_model.policy.built_in import policy_file

OfLogs = Annotated[
    Path | None,
    typer.Option(
        "--policy", parser=policy_file, metavar="POLICY", help="Policy for walks; default: the policy of the logs."
    ),
]


def next_experiment(
    folder: Annotated[Path, typer.Argument(help="Folder of a diagnosis; with --logs, where the first one goes.")],
    logs: Annotated[
        list[Path] | None,
        typer.Option("--logs", help="First logs, if there is no diagnosis yet; repeatable."),
    ] = None,
    nominal: Annotated[str | None, typer.Option("--nominal", help="With --logs: the simulator's model.")] = None,
    policy: OfLogs = None,
    experiment: Annotated[
        Path | None,
        typer.Option("--experiment", help="Evaluate your own experiment (YAML) instead."),
    ] = None,
    run: Annotated[bool, typer.Option("--run", help="Run the experiments on a robot until one cause is left.")] = False,
    robot: Annotated[str | None, typer.Option("--robot", help="With --run: HOST, HOST:PORT or unix:/path.")] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask before each run; for a fake robot only.")] = False,
    budget_s: Annotated[float, typer.Option("--budget", min=10.0, max=3600.0, help="Robot time, s.")] = 120.0,
    rounds: Annotated[int, typer.Option("--rounds", min=1, max=20, help="Largest number of experiments.")] = 5,
    config: Annotated[Path | None, typer.Option("--config", help="Run configuration (YAML).")] = None,
    ca_file: Annotated[Path | None, typer.Option("--ca-file", help="Certificate to trust beside the vendor's.")] = None,
    credentials_file: Annotated[
        Path | None, typer.Option("--credentials-file", help="File with user name and password.")
    ] = None,
    lock_step: Annotated[
        str | None, typer.Option("--lock-step", help="Admin address of a fake robot in lock-step mode.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Random seed.")] = 0,
) -> None:
    """Propose the experiment that tells most about a cause; with --run, run experiments until one cause is left."""
    typer.echo("loading the library of effects and the simulator …", err=True)
    from diagnosis.next.files import load_motion
    from diagnosis.next.rounds import Limits, is_here
    from diagnosis.next.session import Session
    from spot_model.errors import BadInputError
    from trainer.collect.collect_run import run_arguments

    if run and robot is None:
        raise BadInputError("--run needs a robot; give --robot HOST")
    if run and yes and robot is not None and lock_step is None and not is_here(robot):
        raise BadInputError(f"--yes is for a fake robot on this computer, not for {robot}; a person confirms each run")
    own = load_motion(experiment) if experiment is not None else None
    session = Session.opened(folder, logs or [], nominal, policy, seed)
    session.own = own
    if not run:
        for line in session.rank():
            typer.echo(line)
        return
    words = run_arguments(
        robot=robot or "",
        config=config,
        ca_file=ca_file,
        credentials_file=credentials_file,
        labels=("purpose=next experiment",),
        lock_step=lock_step,
    )

    def confirm(proposal: Any, lines: list[str]) -> bool:
        for line in lines:
            typer.echo(line)
        return yes or typer.confirm(f"Run {proposal.candidate.title} now? The robot will stand up and move")

    story = session.ask(words, confirm, Limits(budget_s, rounds))
    cause, odds = next(iter(story.odds.items()))
    typer.echo(f"{cause}: {odds:.2f}, experiments: {len(story.rounds)}, {story.robot_s:.0f} s of robot time")
    typer.echo(f"diagnosis: {story.sentence}")
    typer.echo(f"ended: {story.ending}")
    typer.echo(f"page: {session.page}")
    if story.is_interrupted:
        raise typer.Exit(130)


def predict_run(
    folder: Annotated[Path, typer.Argument(help="Folder of a diagnosis.")],
    sequence: Annotated[
        str | None, typer.Option("--sequence", help="Velocity commands to predict: a built-in name or a YAML file.")
    ] = None,
    policy: OfLogs = None,
    log: Annotated[Path | None, typer.Option("--log", help="Log of the run to compare with the prediction.")] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="The prediction's file; by default prediction_SEQUENCE.json."),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Random seed.")] = 0,
) -> None:
    """Predict a run of a new command sequence; afterwards, compare the run with the prediction."""
    typer.echo("loading the library of effects and the simulator …", err=True)
    from diagnosis.next.session import Session
    from spot_model.errors import BadInputError

    if sequence is None:
        raise BadInputError("nothing to predict; give --sequence NAME or FILE")
    for line in Session.opened(folder, [], None, policy, seed).predicted(sequence, log, out):
        typer.echo(line)
