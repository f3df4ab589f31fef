"""A film of a walk, drawn without a display and encoded by imageio-ffmpeg, and what stands beside the robot."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from spot_model.console.progress import Progress
from spot_model.errors import BadInputError
from spot_model.io.whole import whole_file
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from trainer.play.walk import SEEN_S, VelocityAt, Walk

COLOURS = ((0.95, 0.75, 0.1), (0.3, 0.65, 1.0), (0.3, 0.65, 1.0), (0.95, 0.75, 0.1))
"""Colours of the bars of fl, fr, hl, hr: one for each diagonal."""


def columns(walk: Walk) -> tuple[str, str]:
    """Names and values, a line each; ASCII, which is all that MuJoCo's font has."""
    units = ("m/s", "m/s", "rad/s")
    names = ["forward", "left", "turn"]
    values = [
        f"{is_:5.2f} of {asked:5.2f} {unit}"
        for is_, asked, unit in zip(walk.velocity, walk.command, units, strict=True)
    ]
    gait = walk.gait
    names += ["gait", "strides", "time", "falls"]
    values += ["-", "-"] if gait is None else [gait.name, f"{gait.stride_hz:.1f} /s"]
    values += [f"{walk.time_s:.1f} s", str(walk.falls)]
    return "\n".join(names), "\n".join(values)


def gait_diagram(walk: Walk) -> mujoco.MjvFigure:
    """A bar for each time that a foot is on the ground, over the last three seconds; fl on top, then fr, hl, hr."""
    figure = mujoco.MjvFigure()
    mujoco.mjv_defaultFigure(figure)
    figure.title = "on the ground: fl, fr, hl, hr"
    figure.range[:] = ((-SEEN_S, 0.0), (0.5, facts.N_LEGS + 0.5))
    figure.gridsize[:] = (4, 2)
    figure.flg_ticklabel[:] = (1, 0)
    figure.xformat = "%.1f s"
    figure.linewidth = 9.0
    figure.figurergba[:] = (0.0, 0.0, 0.0, 0.5)
    contact, line = walk.contact, 0
    for leg, colour in enumerate(COLOURS):
        edges = np.flatnonzero(np.diff(np.r_[False, contact[:, leg], False].astype(np.int8)))
        for start, end in edges.reshape(-1, 2)[-len(figure.linepnt) // facts.N_LEGS :]:
            times = (np.array([start, end]) - len(contact)) * walk.plant.timestep_s
            height = facts.N_LEGS - leg
            figure.linepnt[line], figure.linergb[line] = 2, colour
            figure.linedata[line, :4] = (times[0], height, times[1], height)
            line += 1
    return figure


WIDTH, HEIGHT = 800, 448
FORMATS: Final = (".mp4", ".gif")
_GIF: Final = ["-filter_complex", "split[a][b];[a]palettegen=stats_mode=diff[p];[b][p]paletteuse=dither=bayer"]


def check_film(out: Path) -> None:
    """See that a film can be made here, before it is walked.

    Raises:
        BadInputError: The file has another ending than ``.mp4`` or ``.gif``, the encoder is not installed, or MuJoCo
            finds no OpenGL that works without a display.
    """
    if out.suffix not in FORMATS:
        raise BadInputError(f"--video {out}: name a file that ends in {' or '.join(FORMATS)}")
    try:
        import imageio_ffmpeg  # noqa: F401
    except ModuleNotFoundError as error:
        raise BadInputError("--video needs imageio-ffmpeg; install the extra: pip install 'spot-rl[train]'") from error
    with contextlib.ExitStack() as stack:
        renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), stack, "--video")


def top_speed_ramp(policy: Policy, seconds: float) -> VelocityAt:
    """Speed up to the policy's top forward command over seven tenths of the time, then hold it."""
    top = np.array([policy.contract.velocity_command_high[0], 0.0, 0.0])
    return lambda time_s: top * min(1.0, time_s / (0.7 * seconds))


def renderer(model: mujoco.MjModel, stack: contextlib.ExitStack, needed_by: str) -> tuple[Any, mujoco.MjrContext]:
    """OpenGL and a model's renderer, until the stack is closed. Raises BadInputError where nothing can be drawn."""
    try:
        context = stack.enter_context(gl_context())
        return context, mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
    except Exception as error:
        stack.close()
        raise BadInputError(
            f"{needed_by}: MuJoCo cannot draw with MUJOCO_GL={os.environ.get('MUJOCO_GL', 'egl')} "
            f"({type(error).__name__}: {error}); install the package libegl1 or libosmesa6, and set MUJOCO_GL to egl "
            "or osmesa"
        ) from error


@contextlib.contextmanager
def gl_context() -> Iterator[Any]:
    """OpenGL without a display: OSMesa where MUJOCO_GL says so, otherwise EGL."""
    if os.environ.get("MUJOCO_GL") == "osmesa":
        from mujoco.osmesa import GLContext
    else:
        from mujoco.egl import GLContext
    context = GLContext(WIDTH, HEIGHT)
    try:
        context.make_current()
        yield context
    finally:
        context.free()


def write_film(walk: Walk, velocity_at: VelocityAt, out: Path, seconds: float) -> None:
    """Film a walk of ``seconds``; the file appears under its name when it is whole."""
    import imageio_ffmpeg

    is_gif = out.suffix == ".gif"
    rate = 12.5 if is_gif else 25.0
    how = {"codec": "gif", "pix_fmt_out": "pal8", "output_params": _GIF} if is_gif else {"quality": 7}
    with whole_file(out) as part:
        encoder = imageio_ffmpeg.write_frames(part, (WIDTH, HEIGHT), fps=rate, ffmpeg_log_level="error", **how)
        total = frames_in(seconds, rate)
        try:
            encoder.send(None)
            with Progress("frames", total) as progress:
                for number, frame in enumerate(frames(walk, velocity_at, seconds, rate), 1):
                    encoder.send(frame)
                    progress.update(number)
        except OSError as error:
            raise _unwritten(out, str(error).partition("\n")[0]) from error
        finally:
            encoder.close()
        # imageio-ffmpeg does not report that the encoder failed.
        try:
            written, _ = imageio_ffmpeg.count_frames_and_secs(str(part))
        except RuntimeError:
            written = 0
        if written < total:
            raise _unwritten(out, f"{written} of {total} frames are in it")


def _unwritten(out: Path, why: str) -> BadInputError:
    return BadInputError(f"--video {out} cannot be written ({why}); is there room on the disk?")


def frames(walk: Walk, velocity_at: VelocityAt, seconds: float, rate_hz: float) -> Iterator[NDArray[np.uint8]]:
    """Walk, and draw at a rate; images of shape (HEIGHT, WIDTH, 3), seen from the side."""
    model = walk.plant.model
    data = mujoco.MjData(model)
    camera, option, perturb = mujoco.MjvCamera(), mujoco.MjvOption(), mujoco.MjvPerturb()
    camera.distance, camera.azimuth, camera.elevation = 2.6, 120.0, -14.0
    whole, corner = mujoco.MjrRect(0, 0, WIDTH, HEIGHT), mujoco.MjrRect(WIDTH - 330, HEIGHT - 150, 320, 140)
    font, place = mujoco.mjtFont.mjFONT_NORMAL.value, mujoco.mjtGridPos.mjGRID_TOPLEFT.value
    category = mujoco.mjtCatBit.mjCAT_ALL.value
    image = np.empty((HEIGHT, WIDTH, 3), dtype=np.uint8)
    with gl_context():
        context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, context)
        scene = mujoco.MjvScene(model, 1000)
        # Software rendering spends most of its time on these two.
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            scene.flags[flag] = 0
        ticks = walk.ticks(velocity_at)
        for number in range(1, frames_in(seconds, rate_hz) + 1):
            while walk.time_s < number / rate_hz - 1e-9:
                next(ticks)
            data.qpos[:] = walk.qpos
            mujoco.mj_forward(model, data)
            camera.lookat[:] = data.qpos[:3]
            mujoco.mjv_updateScene(model, data, option, perturb, camera, category, scene)
            mujoco.mjr_render(whole, scene, context)
            mujoco.mjr_overlay(font, place, whole, *columns(walk), context)
            mujoco.mjr_figure(corner, gait_diagram(walk), context)
            mujoco.mjr_readPixels(image, None, whole, context)
            yield np.ascontiguousarray(image[::-1])


def frames_in(seconds: float, rate_hz: float) -> int:
    """Frames in a film."""
    return math.floor(seconds * rate_hz + 1e-9)
