"""``spot-rl play``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from spot_model.policy.built_in import policy_file


def play(
    policy: Annotated[
        Path,
        typer.Argument(
            parser=policy_file,
            metavar="POLICY",
            help="ONNX file, a built-in policy's name, or the folder of a running training.",
        ),
    ],
    model: Annotated[str, typer.Option("--model", help="Built-in model, or a model file.")] = "paper_identified",
    velocity: Annotated[
        str | None,
        typer.Option(
            "--velocity",
            help="Initial vx,vy,wz in m/s and rad/s; default: 0.5,0,0 with --web, and a film accelerates forward.",
        ),
    ] = None,
    seconds: Annotated[
        float | None, typer.Option("--seconds", help="End after this many seconds; default for a film: 12.")
    ] = None,
    gamepad: Annotated[bool, typer.Option("--gamepad", help="Hold the dead-man button and use the sticks.")] = False,
    video: Annotated[
        Path | None, typer.Option("--video", help="Write a film, FILE.mp4 or FILE.gif, and open no window.")
    ] = None,
    web: Annotated[
        bool, typer.Option("--web", help="Walk in a browser, also over SSH; needs neither display nor OpenGL.")
    ] = False,
    port: Annotated[int, typer.Option("--port", help="Port of --web; 0: any that is free.", min=0, max=65535)] = 8080,
    host: Annotated[
        str, typer.Option("--host", help="Address of --web; with 0.0.0.0 anybody in the network can watch and steer.")
    ] = "127.0.0.1",
    seed: Annotated[int, typer.Option("--seed", help="Random seed of the directions of pushes.", min=0)] = 0,
) -> None:
    """Watch a policy walk in a browser or a window, with velocity commands and pushes, or film it.

    Given a training's folder, it plays the newest checkpoint and switches to each new one when it is written.
    """
    from spot_model.errors import BadInputError

    if seconds is not None and not 0.1 <= seconds <= 3600.0:
        raise BadInputError(f"--seconds {seconds}: it must be 0.1 to 3600")
    if web + gamepad + (video is not None) > 1:
        raise BadInputError("--web, --video and --gamepad (which steers in a window) exclude each other; keep one")
    if web:
        os.environ["MUJOCO_GL"] = "disable"
    typer.echo("loading the simulator …", err=True)
    try:
        import mujoco  # noqa: F401 - it loads the OpenGL that MUJOCO_GL names
    except ModuleNotFoundError:
        raise
    except Exception as error:
        raise BadInputError(
            f"MuJoCo cannot be loaded with MUJOCO_GL={os.environ.get('MUJOCO_GL', '')} "
            f"({type(error).__name__}: {error}); unset it, or install the package libegl1 (egl) or libosmesa6 (osmesa)"
        ) from error
    from trainer.play.start import Started, film_it, in_browsers, in_window

    started = Started.of(policy, model, velocity, seed)
    if video is not None:
        told = film_it(started, video, seconds or 12.0)
    elif web:
        told = in_browsers(started, (host, port), seconds)
    else:
        told = in_window(started, seconds, has_gamepad=gamepad)
    typer.echo(told)
