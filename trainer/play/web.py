"""A walk in a browser: velocity, pushes and effects are changed while it walks."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from queue import SimpleQueue
from typing import Any, Final

import numpy as np

from spot_model.effects.base import Effect
from spot_model.plant.plant import PlantDivergedError
from spot_model.robot.facts import Array
from trainer.play.live_plots import SpeedHistory, live_html
from trainer.play.scene import PACES, DrawnRobot, WebScene, WebServer, offer
from trainer.play.switches import Switch, Switched
from trainer.play.walk import PUSH_M_S, Walk, following

LATE_S: Final = 0.5
"""Lateness beyond which the walk slows down instead of catching up, s."""
DRAWN_WITHIN_S: Final = 0.04
"""A late computer leaves out frames, but never for longer than this, s."""
KEYS: Final[tuple[tuple[Any, tuple[float, float, float], str], ...]] = (
    ("I", (0.25, 0.0, 0.0), "faster forward"),
    ("K", (-0.25, 0.0, 0.0), "slower, or back"),
    ("J", (0.0, 0.0, 0.25), "turn left"),
    ("L", (0.0, 0.0, -0.25), "turn right"),
    ("U", (0.0, 0.25, 0.0), "to the left"),
    ("O", (0.0, -0.25, 0.0), "to the right"),
)
"""Keys that viser's own camera leaves free, what each adds to V_x, V_y (m/s), ω_z (rad/s), and what that does."""
HELP: Final = (
    "Keys: **I** faster, **K** slower or back, **J** and **L** turn, **U** and **O** sideways, **space** stop, "
    "**P** push, **R** back to the start. Drag to turn the view, scroll to zoom."
)


class LivePage:
    """The page of one walk. Browsers only leave wishes; the loop that walks takes them up between two ticks.

    Args:
        server: Where browsers connect.
        walk: The robot in closed loop.
        own: Effects of its model.
        offered: Effects to switch on beside them.
        start: Velocity command at the start, V_x, V_y (m/s), ω_z (rad/s), shape (3,).
    """

    def __init__(
        self, server: WebServer, walk: Walk, own: Sequence[Effect], offered: Sequence[Switch], start: Array
    ) -> None:
        self._walk, self._server = walk, server
        self.scene = WebScene(server)
        self._robot = DrawnRobot(server, "robot", walk.plant.model)
        self._switched = Switched(own)
        self._wishes: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._history = SpeedHistory()
        self._build(offered, start)

    def run(self, seconds: float | None) -> None:
        """Walk in real time until ``seconds`` of the robot's time have passed."""
        walk, tick_s = self._walk, 1.0 / self._walk.policy.contract.rate_hz
        velocity_at = following(lambda: np.array([slider.value for slider in self._sliders]))
        ticks = walk.ticks(velocity_at)
        due_s = seen_s = drawn_s = plotted_s = time.monotonic()
        while seconds is None or walk.time_s < seconds - 0.5 * tick_s:
            while not self._wishes.empty():
                self._wishes.get()()
            if not self._pause.value:
                falls = walk.falls
                try:
                    next(ticks)
                except PlantDivergedError:
                    walk.plant.reset()
                    ticks = walk.ticks(velocity_at)
                    self._told.content = "The simulation broke down under these effects and started again."
                if walk.falls > falls:
                    self._told.content = f"It fell at {walk.time_s:.1f} s and is put back at the start."
            now_s = time.monotonic()
            is_watched = bool(self._server.get_clients())
            if is_watched:
                self.scene.watched_s += now_s - seen_s
            seen_s = now_s
            if is_watched and (now_s < due_s + tick_s or now_s > drawn_s + DRAWN_WITHIN_S):
                self._draw()
                drawn_s = now_s
            if now_s - plotted_s >= 1.0 / 5.0:
                self._history.note(walk)
                if is_watched:
                    self._live.content = live_html(walk, *self._history.columns())
                plotted_s = now_s
            due_s = max(due_s + tick_s * 2.0 ** PACES.index(self._pace.value), time.monotonic() - LATE_S)
            time.sleep(max(0.0, due_s - time.monotonic()))

    # Private ---------------------------------------------------------------------------------------------------------

    def _draw(self) -> None:
        qpos = self._walk.qpos
        with self.scene.frame(qpos[:2]):
            self._robot.put(qpos)

    def _build(self, offered: Sequence[Switch], start: Array) -> None:
        gui, contract = self._server.gui, self._walk.policy.contract
        self._told = gui.add_markdown(f"The policy **{contract.name}** walks a simulated Spot.")
        with gui.add_folder("Velocity"):
            names = ("forward (m/s)", "left (m/s)", "turn (rad/s)")
            bounds = (contract.velocity_command_low, contract.velocity_command_high)
            self._sliders: list[Any] = [
                gui.add_slider(name, low, high, 0.05, float(value))
                for name, low, high, value in zip(names, *bounds, start, strict=True)
            ]
            self._button("Stop", self._stop, "space")
            self._button(f"Push by {PUSH_M_S:g} m/s", self._walk.push, "P")
            self._button("Put it back at the start", self._walk.put_back, "R")
        with gui.add_folder("Effects"):
            for switch in offered:
                offer(gui, switch, self._turned)
        with gui.add_folder("View"):
            self._pause = gui.add_checkbox("pause", initial_value=False)
            self._pace = gui.add_dropdown("pace, × real time", PACES)
            self.scene.add_follow()
        gui.add_markdown(HELP)
        for key, change, what in KEYS:
            gui.add_command(what, hotkey=key).on_trigger(self._steering(change))
        self._live = self.scene.add_beside("Now", 350.0)

    def _button(self, label: str, action: Callable[[], None], key: Any) -> None:
        def wish(_: object) -> None:
            self._wishes.put(action)

        self._server.gui.add_button(label).on_click(wish)
        self._server.gui.add_command(label, hotkey=key).on_trigger(wish)

    def _turned(self, switch: Switch, size: Callable[[], float | None]) -> None:
        def change() -> None:
            if self._switched.turn(switch, size()):
                self._walk.plant.change_effects(self._switched.effects)

        self._wishes.put(change)

    def _stop(self) -> None:
        for slider in self._sliders:
            slider.value = 0.0

    def _steering(self, change: Sequence[float]) -> Callable[[object], None]:
        def steer() -> None:
            for slider, step in zip(self._sliders, change, strict=True):
                if step:
                    slider.value = float(np.clip(round(slider.value + step, 6), slider.min, slider.max))

        return lambda _: self._wishes.put(steer)
