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
        typer.Option("--velocity", help="Initial vx,vy,wz in m/s and rad/s; by default a film accelerates forward."),
    ] = None,
    seconds: Annotated[
        float | None, typer.Option("--seconds", help="End after this many seconds; default for a film: 12.")
    ] = None,
    gamepad: Annotated[bool, typer.Option("--gamepad", help="Hold the dead-man button and use the sticks.")] = False,
    video: Annotated[
        Path | None, typer.Option("--video", help="Write a film, FILE.mp4 or FILE.gif, and open no window.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="Random seed of the directions of pushes.", min=0)] = 0,
) -> None:
    """Watch a policy walk in a window that takes velocity commands and pushes, or film it.

    Given a training's folder, it plays the newest checkpoint and switches to each new one when it is written.
    """
    import numpy as np

    from spot_model.errors import BadInputError

    typer.echo("loading the simulator …", err=True)
    try:
        import mujoco  # noqa: F401 - it loads the OpenGL that MUJOCO_GL names
    except Exception as error:
        raise BadInputError(
            f"MuJoCo cannot be loaded with MUJOCO_GL={os.environ.get('MUJOCO_GL', '')} "
            f"({type(error).__name__}: {error}); unset it, or install the package libegl1 (egl) or libosmesa6 (osmesa)"
        ) from error
    from spot_model.io.model_file import load_model
    from spot_model.io.whole import check_new
    from spot_model.plant.plant import Plant, PlantOptions
    from spot_model.policy.policy import load_policy
    from spot_model.robot.facts import Array
    from spot_tools.sources import PygamePad
    from trainer.play.film import check_film, top_speed_ramp, write_film
    from trainer.play.steering import HELP, KeySteering, parse_velocity, stick_steering
    from trainer.play.walk import Walk
    from trainer.play.window import check_display, show

    if seconds is not None and not 0.1 <= seconds <= 3600.0:
        raise BadInputError(f"--seconds {seconds}: it must be 0.1 to 3600")
    following = None
    if policy.is_dir():
        from trainer.ppo.checkpoint_policy import NewestPolicy

        following = NewestPolicy(policy, lambda name: typer.echo(f"now {name}", err=True))
    loaded = load_policy(policy) if following is None else following.load()
    contract = loaded.contract
    wanted = None if velocity is None else parse_velocity(velocity, contract)
    if video is not None:
        if gamepad:
            raise BadInputError("--gamepad steers in a window, and --video opens none; leave one of them out")
        check_new(video)
        check_film(video)
    else:
        check_display()
    plant = Plant(load_model(model).effects, 1, PlantOptions(n_threads=1))
    rng = np.random.default_rng(seed)
    walk = Walk(loaded, plant, rng) if following is None else Walk(loaded, plant, rng, following.newer)
    keys = KeySteering(contract, np.zeros(3) if wanted is None else wanted, walk.push)
    if video is not None:
        length_s = seconds or 12.0
        velocity_at = top_speed_ramp(loaded, length_s) if wanted is None else keys.velocity_at
        write_film(walk, velocity_at, video, length_s)
    elif gamepad:
        pad = PygamePad(0)
        sticks = stick_steering(contract, pad)

        def steered(time_s: float) -> Array:
            keys.velocity_at(time_s)  # pushes still come from the keys
            return sticks(time_s)

        try:
            show(walk, steered, keys.press, seconds)
        finally:
            pad.close()
    else:
        typer.echo(HELP)
        show(walk, keys.velocity_at, keys.press, seconds)
    gait = walk.gait
    typer.echo(
        f"{f'wrote {video}: ' if video else ''}{walk.time_s:.1f} s, {walk.falls} falls; at the end "
        f"{walk.velocity[0]:.2f} m/s forward, gait: {'too short to say' if gait is None else gait.sentence()}"
    )
