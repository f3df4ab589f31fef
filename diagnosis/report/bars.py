"""Bars, strips and curves: gaps, a robot's numbers beside the nominal ones, logs over time, what is left over."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from diagnosis.document import CalibratedNumber, Consequences, Dependence, Stretch
from diagnosis.report.words import number
from spot_log.page.svg import HALF, Frame, disc, heat, line, nice_ticks, rect, svg, text
from spot_log.read.run import Run

WIDTH: Final = 480
BAR: Final = 16
COLOURS: Final = ("var(--nominal)", "var(--corrected)", "var(--floor)")
"""Before, after, floor."""
MAX_LOGS: Final = 40
FAR: Final = 4.0
"""Published standard deviations that an interval's axis reaches to, both ways."""
QUANTITY_UNITS: Final = {
    "position": "rad",
    "acceleration": "rad/s²",
    "total power": "W",
    **dict.fromkeys(("velocity", "turn rate", "roll rate", "pitch rate"), "rad/s"),
    **dict.fromkeys(("body speed", "vertical velocity"), "m/s"),
    "torque": "N·m",
    "total torque": "N·m",
    "torque rate": "N·m/s",
    "torque history": "(N·m)²·s",
    **dict.fromkeys(("time since start", "time since set-point"), "s"),
}
"""Of what an unexplained residual may depend on."""


def gap_bars(consequences: Consequences) -> str:
    """Before, after and floor of each gap, each gap on its own scale."""
    left, parts, y = 110, [], 4.0
    for g in consequences.gaps:
        values = (g.before, g.after, g.floor)
        parts.append(text(left - 10, y + 1.4 * BAR, g.gap, size=13.5, anchor="end", weight=600))
        parts.append(text(left - 10, y + 2.4 * BAR, g.unit, size=12, anchor="end", css="soft"))
        for value, colour in zip(values, COLOURS, strict=True):
            span = (WIDTH - left - 66) * value / max(*values, 1e-12)
            parts.append(rect(left, y, span, BAR - 2, colour, f"{g.gap}: {number(value)} {g.unit}"))
            parts.append(text(left + span + 6, y + BAR - 4, number(value), size=12.5))
            y += BAR
        y += 14
    return svg(WIDTH, y, parts, "Three gaps, before and after")


def by_joint(gaps: Mapping[str, float], shares: Mapping[str, float], named: frozenset[str]) -> str:
    """The gap of each joint of a robot that has no picture."""
    top, left, parts = max(gaps.values(), default=1.0) or 1.0, 150, []
    for i, (name, value) in enumerate(gaps.items()):
        y, colour = 6 + 26 * i, heat(shares.get(name, 0.0))
        parts.append(text(left - 10, y + 15, f"{name} ◂" if name in named else name, size=13, anchor="end"))
        parts.append(rect(left, y, (WIDTH - left - 60) * value / top, 18, colour, f"{name}: {number(value)}", radius=4))
        parts.append(text(WIDTH - 52, y + 15, number(value), size=13, weight=600))
    return svg(WIDTH, 12 + 26 * len(gaps), parts, "Gap by joint")


def interval(n: CalibratedNumber) -> str:
    """A number on an axis of published standard deviations: nominal in the middle, two of them shaded."""
    if n.spread <= 0.0:
        return ""
    width, height = 200.0, 20.0

    def at(value: float) -> float:
        return width / 2 + float(np.clip((value - n.nominal) / n.spread, -FAR, FAR)) / FAR * (width / 2 - 6)

    two = 2.0 / FAR * (width / 2 - 6)
    colour = "var(--found)" if n.stands_out else "var(--corrected)"
    parts = [
        rect(width / 2 - two, 3, 2 * two, height - 6, "var(--empty)"),
        line([(width / 2, 1), (width / 2, height - 1)], "var(--nominal)", 1.5),
        line([(at(n.low), height / 2), (at(n.high), height / 2)], colour, 4, "opacity:.5"),
        disc(at(n.value), height / 2, 4.5, colour, f"{n.title} of {n.where}: {n.value:.4g} {n.unit}"),
    ]
    return svg(width, height, parts, f"{n.title} of {n.where}")


def strips(runs: Sequence[Run], stretches: Sequence[Stretch]) -> str:
    """Each log as a strip of time: what was cut out, and which seconds carry the gap."""
    shown, left, row, parts = runs[:MAX_LOGS], 170, 22, []
    longest = max(run.duration_s for run in shown) or 1.0
    scale = (HALF - left - 16) / longest
    for i, run in enumerate(shown):
        y, name = 4 + row * i, run.header.command_sequence or run.path.stem
        parts.append(text(left - 10, y + 13, f"{name[:18]}, repeat {run.header.repeat}", size=12.5, anchor="end"))
        parts.append(rect(left, y, scale * run.duration_s, row - 6, "var(--corrected)", run.path.name, radius=3))
        for s in stretches:
            if s.log == run.header.run_id:
                fill = "var(--nominal)" if s.kind == "gap" else "var(--empty)"
                tip = f"{s.start_s:.1f} to {s.end_s:.1f} s: {s.reason}"
                width = scale * (min(s.end_s, run.duration_s) - s.start_s)
                parts.append(rect(left + scale * s.start_s, y, width, row - 6, fill, tip, radius=1))
    bottom = 4 + row * len(shown)
    parts += [
        text(left + scale * tick, bottom + 12, f"{tick:g} s", size=12.5, anchor="middle", css="soft")
        for tick in nice_ticks(0.0, longest, 5)
    ]
    return svg(HALF, bottom + 20, parts, "Logs over time")


def dependences(curves: Sequence[Dependence], unit: str) -> list[str]:
    """What is left over one quantity each, on one scale."""
    values = [v for c in curves for v in c.residual] + [0.0]
    pad = 0.06 * max(max(values) - min(values), 1e-9)
    return [_dependence(c, unit, (min(values) - pad, max(values) + pad)) for c in curves if len(c.at) > 1]


def _dependence(curve: Dependence, unit: str, scale: tuple[float, float]) -> str:
    frame = Frame((min(curve.at), max(curve.at)), scale, WIDTH, 156, left=58)
    name = f"{curve.quantity}, {QUANTITY_UNITS.get(curve.quantity.split(' of ')[0], '')}".rstrip(", ")
    points = [frame.at(a, b) for a, b in zip(curve.at, curve.residual, strict=True)]
    tips = [
        f"{curve.quantity} {a:.3g}\nunexplained {b:.3g} {unit}" for a, b in zip(curve.at, curve.residual, strict=True)
    ]
    parts = [*axes(frame, name, f"unexplained, {unit}"), line(points, "var(--unknown)", 2.5)]
    parts += [disc(*point, 4, "var(--unknown)", tip) for point, tip in zip(points, tips, strict=True)]
    return svg(WIDTH, frame.total_height + 22, parts, f"What is left over {name}")


def axes(frame: Frame, x_title: str, y_title: str) -> list[str]:
    """Round numbers on both axes, and their titles."""
    name = text(0, 0, y_title, size=13, anchor="middle")
    return [
        *frame.axes(),
        text(frame.width / 2, frame.total_height + 16, x_title, size=13, anchor="middle"),
        f'<g transform="translate(13 {frame.top + 0.5 * frame.height:.0f}) rotate(-90)">{name}</g>',
    ]
