"""What stands beside the robot in a browser: feet on the ground and speed over the last seconds."""

from __future__ import annotations

from typing import Final

import numpy as np

from spot_log.page.charts import stance
from spot_log.page.render import as_html
from spot_log.page.sections import Chart, Content, Legend, Section, Series, Table
from spot_model.robot import facts
from spot_model.robot.facts import Array
from trainer.play.walk import SEEN_S, Walk

ASKED, MEASURED, STANDS = "#9aa7b2", "#2f6fb5", "#e2a21b"
_STYLE: Final = (
    "<style>.spot{padding:0 8px;font-size:13px;color:#1d2730}.spot .wide{display:block;width:100%}"
    ".spot .wide,.spot .wide svg{overflow:visible}.spot h3{font-size:13px;font-weight:400;margin:6px 0 2px}"
    ".spot p{margin:6px 0 2px}.spot .legend span{margin-right:14px;color:#5c6b78}"
    ".spot .legend i{display:inline-block;width:10px;height:10px;border-radius:2px;margin-right:5px}"
    ".spot table{width:100%}.spot th{text-align:left;font-weight:400}.spot td{text-align:right}</style>"
)
"""What the pages' own style does for these figures, within the frame of viser's."""
UNITS: Final = (("forward", "m/s"), ("left", "m/s"), ("turn", "rad/s"))


def live_html(walk: Walk, times_s: Array, asked_m_s: Array, measured_m_s: Array) -> str:
    """Figures, the feet on the ground over the last seconds, and the forward speed; arrays of shape (n,)."""
    gait, contact = walk.gait, walk.contact
    rows = [
        (name, _two(is_), f"of {_two(wanted)} {unit}")
        for (name, unit), is_, wanted in zip(UNITS, walk.velocity, walk.command, strict=True)
    ]
    rows.append(("gait", "", "—" if gait is None else f"{gait.name}, {gait.stride_hz:.1f} strides a second"))
    rows.append(("time, falls", f"{walk.time_s:.0f} s", str(walk.falls)))
    feet = stance(contact, facts.LEG_NAMES, STANDS, (-len(contact) * walk.plant.timestep_s, 0.0))
    lines = [Series(ASKED, times_s, asked_m_s, is_stepped=True), Series(MEASURED, times_s, measured_m_s)]
    speed = Chart(lines if len(times_s) > 1 else (), x_unit=" s", height=90, least_span=1.0)
    key = Legend([(ASKED, "commanded"), (MEASURED, "measured")])
    about = f"Feet on the ground, last {SEEN_S:g} s (front, hind; left, right)"
    parts = [Table((), rows), Section(about, "", feet), Section("Forward speed, m/s", "", [speed, key])]
    return beside_robot(parts)


def beside_robot(parts: Content) -> str:
    """Parts of a page in the browser's window of the robot."""
    return f"{_STYLE}<div class='spot'>{as_html(parts, columns=4, is_within=True)}</div>"


def _two(value: float) -> str:
    """Two decimals; nothing is told of a zero's sign."""
    return f"{round(value, 2) + 0.0:.2f}"


class SpeedHistory:
    """Forward speed, asked and measured, over the last seconds."""

    def __init__(self, seen_s: float = 10.0) -> None:
        self._seen_s = seen_s
        self._rows: list[tuple[float, float, float]] = []

    def note(self, walk: Walk) -> None:
        """Take the speeds of now."""
        self._rows.append((walk.time_s, float(walk.command[0]), float(walk.velocity[0])))
        while self._rows[0][0] < walk.time_s - self._seen_s:
            del self._rows[0]

    def columns(self) -> tuple[Array, Array, Array]:
        """Times until now (s, 0 is now), asked and measured (m/s), each of shape (n,)."""
        if not self._rows:
            return np.empty(0), np.empty(0), np.empty(0)
        times, asked, measured = np.array(self._rows).T
        return times - times[-1], asked, measured
