"""A walk in MuJoCo's own viewer, in real time."""

from __future__ import annotations

import os
import time
from collections.abc import Callable

import mujoco
import mujoco.viewer

from spot_model.errors import BadInputError
from trainer.play.film import columns, gait_diagram
from trainer.play.walk import VelocityAt, Walk

LATE_S = 1.0
"""Lateness beyond which the walk slows down instead of catching up, s."""
DRAWN_WITHIN_S = 1.0
"""A late computer leaves out drawings, but never for longer than this, s."""


def check_display() -> None:
    """See that a window can be opened. Raises BadInputError: there is no display."""
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise BadInputError(
            "there is no display for a window (neither DISPLAY nor WAYLAND_DISPLAY is set); "
            "walk in a browser, --web, or write a film, --video walk.mp4"
        )


def show_walk(walk: Walk, velocity_at: VelocityAt, press: Callable[[int], None], seconds: float | None) -> None:
    """Walk until the window is closed, or ``seconds`` have passed.

    Raises:
        BadInputError: The window cannot be opened.
    """
    model, period_s = walk.plant.model, 1.0 / walk.policy.contract.rate_hz
    data = mujoco.MjData(model)
    try:
        viewer = mujoco.viewer.launch_passive(model, data, key_callback=press, show_left_ui=False, show_right_ui=False)
    except (mujoco.FatalError, RuntimeError) as error:
        raise BadInputError(f"the window cannot be opened: {error}; write a film instead: --video walk.mp4") from error
    with viewer:
        with viewer.lock():
            viewer.cam.type = mujoco.mjtCamera.mjCAMERA_TRACKING.value
            viewer.cam.trackbodyid = model.body("body").id
            viewer.cam.distance, viewer.cam.azimuth, viewer.cam.elevation = 2.6, 120.0, -14.0
        due_s = drawn_s = time.monotonic()
        for _ in walk.ticks(velocity_at):
            if not viewer.is_running() or (seconds is not None and walk.time_s > seconds):
                return
            due_s = max(due_s + period_s, time.monotonic() - LATE_S)
            if due_s < time.monotonic() < drawn_s + DRAWN_WITHIN_S:
                continue
            with viewer.lock():
                data.qpos[:] = walk.qpos
                data.time = walk.time_s
                mujoco.mj_forward(model, data)
            if viewer.viewport is not None:
                viewer.set_texts((None, None, *columns(walk)))
                corner = mujoco.MjrRect(viewer.viewport.width - 370, 10, 360, 150)
                viewer.set_figures((corner, gait_diagram(walk)))
            viewer.sync()
            drawn_s = time.monotonic()
            time.sleep(max(0.0, due_s - drawn_s))
