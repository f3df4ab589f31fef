"""A video of a policy, rendered without a display."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np

from spot_model.errors import BadInputError
from trainer.evaluate.rollout import Array, roll_out
from trainer.evaluate.setting import Setting

WIDTH, HEIGHT = 640, 360
FRAME_RATE_HZ = 25.0


def check_video() -> None:
    """See that a video can be made here, before minutes of trials.

    Raises:
        BadInputError: There is no ffmpeg, or MuJoCo finds no OpenGL that works without a display.
    """
    if shutil.which("ffmpeg") is None:
        raise BadInputError("--video needs the program ffmpeg, which is not installed; install the package ffmpeg")
    import mujoco

    try:
        mujoco.Renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), 16, 16).close()
    except Exception as error:
        raise BadInputError(
            f"--video: MuJoCo cannot draw with MUJOCO_GL={os.environ.get('MUJOCO_GL', '')} "
            f"({type(error).__name__}: {error}); install the packages libegl1 or libosmesa6, "
            "and set MUJOCO_GL to egl or osmesa"
        ) from error


def write_video(setting: Setting, out: Path, *, seconds: float = 12.0) -> None:
    """Film one robot that speeds up to the policy's top forward command, as MP4 (H.264)."""
    rate = setting.policy.contract.rate_hz
    every = round(rate / FRAME_RATE_HZ)
    plant = setting.plant(1)
    poses: list[Array] = []

    def remember(*_: object) -> None:
        poses.append(np.array(plant.batch.bind("qpos")[0]))

    top = np.array([[setting.policy.contract.velocity_command_high[0], 0.0, 0.0]])
    roll_out(
        setting.policy,
        plant,
        lambda tick: top * min(1.0, tick / (0.7 * seconds * rate)),
        round(seconds * rate),
        disturb=remember,
    )
    _render(setting, poses[::every], out)


def _render(setting: Setting, poses: list[Array], out: Path) -> None:
    import mujoco

    model = setting.plant(1).model
    data = mujoco.MjData(model)
    camera = mujoco.MjvCamera()
    camera.distance, camera.azimuth, camera.elevation = 2.6, 120.0, -14.0
    renderer = mujoco.Renderer(model, HEIGHT, WIDTH)
    command = ["ffmpeg", "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"]
    command += ["-s", f"{WIDTH}x{HEIGHT}", "-r", str(FRAME_RATE_HZ), "-i", "-", "-pix_fmt", "yuv420p", str(out)]
    with renderer, subprocess.Popen(command, stdin=subprocess.PIPE) as encoder:  # noqa: S603
        assert encoder.stdin is not None  # noqa: S101 - a pipe was asked for
        # Software rendering spends most of its time on these two.
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            renderer.scene.flags[flag] = 0
        for pose in poses:
            data.qpos[:] = pose
            mujoco.mj_forward(model, data)
            camera.lookat[:] = pose[:3]
            renderer.update_scene(data, camera)
            encoder.stdin.write(renderer.render().tobytes())
        encoder.stdin.close()
    if encoder.returncode != 0:
        raise BadInputError(f"--video: ffmpeg ended with {encoder.returncode}; its message stands above")
