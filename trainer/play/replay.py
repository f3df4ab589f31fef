"""Recorded and simulated walks of the same commands beside each other, in a browser."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from spot_log.page.charts import stance
from spot_log.page.sections import Chart, Content, Legend, Section, Series, Shade
from spot_model.errors import SpotRlError
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.mjcf import spot_mjcf
from spot_model.robot.rotation import yaw_rad
from trainer.play.live_plots import beside_robot
from trainer.play.scene import PACES, DrawnRobot, WebScene, WebServer, offer
from trainer.play.switches import Effects, Switch, Switched

FRAME_S: Final = 1.0 / 30.0
PLOTTED_EVERY: Final = 8
"""Frames."""
SEEN_S: Final = 1.5
"""Of feet on the ground, before and after the shown instant."""
COLOURS: Final = ("#c79a10", "#2f6fb5", "#1f8a5b")
TINTS: Final = (None, (90, 150, 230), (70, 190, 130))
"""Of the recorded robot, the model, and the model with what is switched on."""


@dataclass(frozen=True)
class Walked:
    """One walk on an even grid of time, which begins where the policy took over."""

    words: str
    """Which robot it is."""
    told: str
    """How it differs from the recorded one, in a sentence; empty for that one itself."""
    step_s: float
    """Between two samples."""
    qpos: Array
    """MuJoCo's generalised positions, shape (n, 19)."""
    forward_m_s: Array
    """Forward speed, shape (n,)."""
    foot_contact: NDArray[np.bool_]
    """Feet on the ground, shape (n, 4), or (n, 0) where it is not known."""

    def at(self, time_s: float) -> Array:
        """Where it is at a time; after its end where it was last. Shape (19,)."""
        return np.asarray(self.qpos[min(round(time_s / self.step_s), len(self.qpos) - 1)])

    @property
    def end_s(self) -> float:
        """Time of the last sample."""
        return (len(self.qpos) - 1) * self.step_s


Simulate = Callable[[Effects, str, Callable[[float], None]], Walked]
"""Simulates a model with these effects, named by these words; tells the share that is done."""


class StoppedError(Exception):
    """Something else is wanted by now than what is being simulated."""


class Simulations:
    """Simulates in a thread of its own what is wanted last."""

    def __init__(self, simulate: Simulate) -> None:
        self._simulate = simulate
        self._wanted: tuple[Effects, str] = ((), "")
        self._changed = threading.Event()
        self._done: SimpleQueue[Walked | None] = SimpleQueue()
        self.told = ""
        """What is being done, or what went wrong; empty otherwise."""
        threading.Thread(target=self._work, daemon=True).start()

    def want(self, effects: Effects, words: str) -> None:
        """Simulate these effects next; nothing where ``words`` is empty."""
        self._wanted = (effects, words)
        self._changed.set()

    def news(self) -> list[Walked | None]:
        """What has been simulated since the last call; None where nothing is wanted any more."""
        found: list[Walked | None] = []
        try:
            while True:
                found.append(self._done.get_nowait())
        except Empty:
            return found

    def _work(self) -> None:
        while True:
            self._changed.wait()
            self._changed.clear()
            self._done.put(None)
            effects, words = self._wanted
            self.told = ""
            if words:
                self._simulate_with(effects, words)

    def _simulate_with(self, effects: Effects, words: str) -> None:
        def tell(share: float) -> None:
            if self._changed.is_set():
                raise StoppedError
            self.told = f"simulating with {words}: {100.0 * share:.0f} %"

        try:
            self._done.put(self._simulate(effects, words, tell))
            self.told = ""
        except StoppedError:
            pass
        except SpotRlError as error:
            self.told = f"{words}: {error}"


class ReplayPage:
    """The page of one log.

    Args:
        server: Where browsers connect.
        walks: The recorded walk, then that of the model.
        own: Effects of the model.
        offered: What may be switched on beside them.
        simulate: Simulates the model with other effects.
    """

    def __init__(
        self, server: WebServer, walks: Sequence[Walked], own: Effects, offered: Sequence[Switch], simulate: Simulate
    ) -> None:
        self._server, self._walks = server, list(walks)
        self._end_s = walks[0].end_s
        self.scene = WebScene(server)
        model = mujoco.MjModel.from_xml_string(spot_mjcf())
        names = ("recorded", "model", "changed")
        self._robots = [DrawnRobot(server, name, model, tint) for name, tint in zip(names, TINTS, strict=True)]
        heading = float(yaw_rad(walks[0].qpos[0, 3:7]))
        self._left = np.array([-np.sin(heading), np.cos(heading)])
        self._switched, self._simulations = Switched(own), Simulations(simulate)
        self._shown_s, self._drawn = 0.0, 0
        self._build(offered)

    def run(self, seconds: float | None) -> None:
        """Show the log again and again until ``seconds`` have passed."""
        start_s = last_s = due_s = time.monotonic()
        while seconds is None or last_s - start_s < seconds:
            due_s = max(due_s + FRAME_S, last_s)
            time.sleep(max(0.0, due_s - time.monotonic()))
            now_s = time.monotonic()
            self.advance(now_s - last_s)
            last_s = now_s

    def advance(self, elapsed_s: float) -> None:
        """Draw what is to be seen ``elapsed_s`` after the last call."""
        asked_s = float(self._time.value)
        if abs(asked_s - round(self._shown_s, 2)) > 1e-6:  # somebody has moved the slider
            self._shown_s = asked_s
        if self._plays.value:
            self._shown_s += elapsed_s / 2.0 ** PACES.index(self._pace.value)
            self._shown_s = 0.0 if self._shown_s > self._end_s else self._shown_s
            self._time.value = round(self._shown_s, 2)
        self._take_news()
        if self._server.get_clients():
            self.scene.watched_s += elapsed_s
            self._draw(self._shown_s)
            self._drawn += 1
            if self._drawn % PLOTTED_EVERY == 1:
                self._told.content = self._simulations.told or "Nothing is being simulated."
                self._beside.content = self._figures(self._shown_s)

    # Private ---------------------------------------------------------------------------------------------------------

    def _take_news(self) -> None:
        for walked in self._simulations.news():
            self._walks = [*self._walks[:2], *([] if walked is None else [walked])]
            self._robots[2].show(is_shown=walked is not None)

    def _draw(self, time_s: float) -> None:
        with self.scene.frame(self._walks[0].at(time_s)[:2]):
            for i, (walked, robot) in enumerate(zip(self._walks, self._robots, strict=False)):
                qpos = walked.at(time_s).copy()
                qpos[:2] += i * float(self._apart.value) * self._left
                robot.put(qpos)

    def _figures(self, time_s: float) -> str:
        parts: list[Content] = []
        for walked, colour in zip(self._walks, COLOURS, strict=False):
            parts += [Legend([(colour, walked.words)]), walked.told]
            rows = np.arange(round((time_s - SEEN_S) / walked.step_s), round((time_s + SEEN_S) / walked.step_s))
            is_in = (rows >= 0) & (rows < len(walked.foot_contact))
            if walked.foot_contact.shape[1]:
                feet = walked.foot_contact[np.clip(rows, 0, len(walked.qpos) - 1)] & is_in[:, None]
                parts.append(stance(feet, facts.LEG_NAMES, colour, (-SEEN_S, SEEN_S)))
        lines = [
            Series(colour, np.arange(len(walked.forward_m_s)) * walked.step_s, walked.forward_m_s)
            for walked, colour in zip(self._walks, COLOURS, strict=False)
        ]
        now = Shade(time_s, time_s + 0.005 * self._end_s, "now", "#8446a8")
        speed = Chart(lines, x_unit=" s", height=90, least_span=0.5, shades=[now])
        return beside_robot([*parts, Section("Forward speed, m/s", "", speed)])

    def _build(self, offered: Sequence[Switch]) -> None:
        gui = self._server.gui
        with gui.add_folder("Time"):
            self._time: Any = gui.add_slider("time (s)", 0.0, round(self._end_s, 2), 0.01, 0.0)
            self._plays: Any = gui.add_checkbox("play", initial_value=True)
            self._pace = gui.add_dropdown("pace, × real time", PACES)
            gui.add_command("play or pause", hotkey="space").on_trigger(self._play_or_pause)
        with gui.add_folder("Switch on in the model"):
            for switch in offered:
                offer(gui, switch, self._turned)
            self._told = gui.add_markdown("")
        with gui.add_folder("View"):
            self._apart = gui.add_slider("beside each other (m)", 0.0, 1.5, 0.1, 0.8)
            self.scene.add_follow()
        self._beside = self.scene.add_beside("Walks", 380.0)
        self._robots[2].show(is_shown=False)

    def _turned(self, switch: Switch, size: Callable[[], float | None]) -> None:
        if self._switched.turn(switch, size()):
            self._simulations.want(self._switched.effects, self._switched.words)

    def _play_or_pause(self, _: object) -> None:
        self._plays.value = not self._plays.value
