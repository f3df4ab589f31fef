"""``spot-rl play``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from spot_model.errors import BadInputError
from spot_model.policy.built_in import policy_file, policy_or_log

USUAL_MODEL = "paper_identified"


def play(
    policy: Annotated[
        Path,
        typer.Argument(
            parser=policy_or_log,
            metavar="POLICY",
            help="ONNX file, a built-in policy's name, a running training's folder, or a log (*.mcap).",
        ),
    ],
    model: Annotated[
        str | None,
        typer.Option("--model", help="Built-in model, or a model file; default: the diagnosis', or paper_identified."),
    ] = None,
    velocity: Annotated[
        str | None,
        typer.Option(
            "--velocity",
            help="Initial vx,vy,wz in m/s and rad/s; default: 0.5,0,0, and a film accelerates forward.",
        ),
    ] = None,
    seconds: Annotated[
        float | None, typer.Option("--seconds", help="End after this many seconds; default for a film: 12.")
    ] = None,
    video: Annotated[
        Path | None, typer.Option("--video", help="Write a film, FILE.mp4 or FILE.gif, and serve no page.")
    ] = None,
    port: Annotated[
        int, typer.Option("--port", help="Port of the page; 0: any that is free.", min=0, max=65535)
    ] = 8080,
    host: Annotated[
        str,
        typer.Option("--host", help="Address of the page; with 0.0.0.0 anybody in the network can watch and steer."),
    ] = "127.0.0.1",
    diagnosis: Annotated[
        Path | None,
        typer.Option(
            "--diagnosis", help="With a log: folder of its diagnosis, whose effects the page offers as switches."
        ),
    ] = None,
    ran: Annotated[
        Path | None,
        typer.Option(
            "--policy",
            help="With a log: the policy that ran; default: the one with the log's digest.",
            parser=policy_file,
        ),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="Random seed of pushes, sensors and delays.", min=0)] = 0,
) -> None:
    """Watch a policy walk in a browser, with velocity commands and pushes, or film it.

    The page needs neither a display nor OpenGL on this computer, and is reached over SSH, too. Given a training's
    folder, it plays the newest checkpoint and switches to each new one when it is written. Given a log, it shows the
    recorded robot beside a simulation of the same commands.
    """
    if seconds is not None and not 0.1 <= seconds <= 3600.0:
        raise BadInputError(f"--seconds {seconds}: it must be 0.1 to 3600")
    is_log = ".mcap" in policy.name
    if is_log and video is not None:
        raise BadInputError(f"{policy} is a log, which is shown in a browser: leave out --video")
    if not is_log and (diagnosis is not None or ran is not None):
        raise BadInputError("--diagnosis and --policy belong to a log; give one (*.mcap), or leave them out")
    if is_log and velocity is not None:
        raise BadInputError("a log holds its own velocity commands; leave out --velocity")
    if video is None:
        os.environ["MUJOCO_GL"] = "disable"
    typer.echo("loading the simulator …", err=True)
    from trainer.play.start import Started, film_it, in_browsers

    if is_log:
        typer.echo(_log_in_browsers(policy, model, ran, diagnosis, seed, (host, port), seconds))
        return
    started = Started.of(policy, model or USUAL_MODEL, velocity, seed)
    if video is not None:
        typer.echo(film_it(started, video, seconds or 12.0))
    else:
        typer.echo(in_browsers(started, (host, port), seconds))


def _log_in_browsers(
    log: Path,
    model: str | None,
    policy: Path | None,
    diagnosis: Path | None,
    seed: int,
    address: tuple[str, int],
    seconds: float | None,
) -> str:
    from trainer.play.start import missing, serve_page

    try:
        from compare.play_log import LogToPlay, read_diagnosed
        from trainer.play.replay import ReplayPage
    except ModuleNotFoundError as error:
        raise missing("a log is simulated", error, "diagnosis,web") from error
    run, verdict = read_diagnosed(log, diagnosis)
    played = LogToPlay.of(run, model, policy, verdict, seed)
    if verdict is not None and not verdict.differences:
        typer.echo(f"{diagnosis} found no difference ({verdict.status}); the usual four effects are offered", err=True)
    typer.echo(f"simulating {played.model_name} with the commands of {log} …", err=True)
    walks = (played.recorded(), played.simulate(played.model.effects, "", lambda _: None))
    told = serve_page(
        lambda server: ReplayPage(server, walks, played.model.effects, played.offered, played.simulate),
        address,
        seconds,
    )
    return f"{walks[1].told}{told and f' {told[0].upper()}{told[1:]}.'}"
