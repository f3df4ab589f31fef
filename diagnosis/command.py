"""``spot-rl diagnose LOGS``, without the comparison that the command adds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from spot_model.console.command_registry import PolicyThatRan
from spot_model.errors import BadInputError
from trainer.simulate.engine import Device, EngineName, EngineOption, RayAddress, Workers, place_of

diagnose = typer.Typer(no_args_is_help=True)


@diagnose.command()
def explain_logs(
    logs: Annotated[list[Path], typer.Argument(help="Log files of one robot, or folders of them.")],
    nominal: Annotated[
        str | None,
        typer.Option(
            "--nominal",
            help="The simulator's model: a file (YAML) or a built-in name; with --history by default the corrected "
            "model of the date before.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            help="Folder for verdict, report and corrected model; with --history by default the logs' date in there.",
        ),
    ] = None,
    history: Annotated[
        Path | None,
        typer.Option("--history", help="Folder of dated diagnoses of this robot; writes history.html there."),
    ] = None,
    policy: PolicyThatRan = None,
    robot: Annotated[
        Path | None, typer.Option("--robot", help="YAML file that describes a robot other than Spot.")
    ] = None,
    add_effect: Annotated[
        list[str] | None, typer.Option("--add-effect", help="One more effect to try, module:Class; repeatable.")
    ] = None,
    without: Annotated[
        list[str] | None, typer.Option("--without", help="Leave an effect out of the library; repeatable.")
    ] = None,
    workers: Workers = 1,
    engine: EngineOption = EngineName.LOCAL,
    device: Device = "cpu",
    ray_address: RayAddress = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Random seed.")] = 0,
) -> tuple[object, Path]:  # A Diagnosis and its folder: naming it would make --help import it.
    """Explain a sim-to-real gap: where it lies, which effect causes it, how far it shrinks."""
    if not any(path.exists() for path in logs):
        raise BadInputError(f"there is no log {logs[0]}; give files written by spot-rl (*.mcap), or folders of them")
    typer.echo("loading the library of effects and the simulator …", err=True)
    from diagnosis.report.history import Filing, file_next
    from diagnosis.report.history_page import write_history
    from diagnosis.report.output import check_no_diagnosis
    from diagnosis.session import DiagnosisProgress, DiagnosisRequest, run_session
    from diagnosis.terminal import twelve_lines

    if history is not None:
        if robot is not None:
            raise BadInputError("--history needs a corrected model, which --robot has not: give --nominal and --out")
        place = file_next(history, logs, nominal, out)
    elif nominal is None or out is None:
        raise BadInputError("give --nominal MODEL and --out DIR, or --history DIR")
    else:
        place = Filing(out, nominal)
    check_no_diagnosis(place.out)
    inputs = DiagnosisRequest(
        logs=tuple(map(str, logs)),
        nominal=place.nominal,
        since=place.since,
        policy=None if policy is None else str(policy),
        add_effect=tuple(add_effect or ()),
        without=tuple(without or ()),
    )
    where = place_of(workers, engine, ray_address, device)
    try:
        with DiagnosisProgress() as progress:
            result, paths = run_session(
                inputs,
                place.out,
                progress,
                check_robot=place.check_robot,
                robot_file=robot,
                place=where,
                seed=seed,
            )
    except KeyboardInterrupt:
        typer.echo(f"interrupted; nothing was written into {place.out}", err=True)
        raise typer.Exit(130) from None
    lines = twelve_lines(result.verdict, paths)
    if history is not None:
        drift, page = write_history(history)
        lines += [f"{'changed':<12}{told}" for told in drift.since_last] + [f"{'history':<12}{page}"]
    for line in lines:
        typer.echo(line)
    return result, place.out
