"""The figures of the report: gaps before and after, by joint and by regime, numbers on their axis, logs over time.

A colour says how many times its floor a gap is, or without a floor its share of the signal's largest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from diagnosis.document import CalibratedNumber, Consequences, GapCell, Stretch
from diagnosis.report.words import number
from spot_log.page.chart import Shade
from spot_log.page.rows import Bar, Cell, bands, bars, heat_map, scale_bar
from spot_log.page.svg import HALF, disc, heat, line, on_heat, rect, svg, text
from spot_log.read.run import Run
from spot_model.robot import facts
from spot_model.robot.facts import Array

COLOURS: Final = ("var(--nominal)", "var(--corrected)", "var(--floor)")
"""Before, after, floor."""
WIDTH: Final = 480
MAX_LOGS: Final = 40
FAR: Final = 4.0
"""Published standard deviations that an interval's axis reaches to, both ways."""
SIGNIFICANT: Final = 0.05
TOP_RATIO: Final = 16.0
"""The darkest colour: so many times the floor, or more."""
IN_FLOORS: Final = ("1× own runs", "2×", "4×", "8×", "16×")
IN_LARGEST: Final = ("0", "largest")
"""Words below the scale of colours."""
SIGNALS: Final = ("load error", "load", "velocity", "position")
REGIMES: Final = (
    *("all", "motoring", "motoring, high speed", "motoring, high torque"),
    *("braking", "braking, high speed", "braking, high torque"),
    *("low torque", "middle torque", "high torque", "low speed", "middle speed", "high speed"),
    *("velocity reversal", "stance", "swing", "low total power", "high total power"),
    *("first third of time", "last third of time"),
)


def gap_bars(consequences: Consequences) -> str:
    """Before, after and floor of each gap, each gap on its own scale."""
    groups = []
    for g in consequences.gaps:
        values = (g.before, g.after, g.floor)
        top = max(*values, 1e-12)
        drawn = [
            Bar(value / top, colour, number(value), f"{g.gap}: {number(value)} {g.unit}")
            for value, colour in zip(values, COLOURS, strict=True)
        ]
        groups.append((g.gap, g.unit, drawn))
    return bars(groups, "Three gaps, before and after", left=110)


def by_joint(cells: Mapping[str, GapCell], shares: Mapping[str, float], named: frozenset[str]) -> str:
    """The gap of each joint of a robot that has no picture; an arrow marks one that the verdict names."""
    top = max((c.gap for c in cells.values()), default=1.0) or 1.0
    groups = [
        (
            f"{name} ◂" if name in named else name,
            cell.unit,
            [Bar(cell.gap / top, heat(shares.get(name, 0.0)), number(cell.gap), told(cell))],
        )
        for name, cell in cells.items()
    ]
    return bars(groups, "Gap by joint")


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
    rows = []
    for run in runs[:MAX_LOGS]:
        name = f"{(run.header.command_sequence or run.path.stem)[:18]}, repeat {run.header.repeat}"
        drawn = [Shade(0.0, run.duration_s, run.path.name, "var(--corrected)")]
        for s in stretches:
            if s.log == run.header.run_id:
                colour = "var(--nominal)" if s.kind == "gap" else "var(--empty)"
                tip = f"{s.start_s:.1f} to {s.end_s:.1f} s: {s.reason}"
                drawn.append(Shade(s.start_s, min(s.end_s, run.duration_s), tip, colour))
        rows.append((name, drawn))
    longest_s = max(run.duration_s for run in runs[:MAX_LOGS]) or 1.0
    return bands(rows, (0.0, longest_s), "Logs over time", width=HALF, left=170)


def gap_maps(cells: Sequence[GapCell], joints: Sequence[str]) -> list[str]:
    """A map a signal, as SVG: regimes down, joints across; hovering tells the figures."""
    return [_gap_map(signal, cells, joints) for signal in SIGNALS if any(c.signal == signal for c in cells)]


def _gap_map(signal: str, cells: Sequence[GapCell], joints: Sequence[str]) -> str:
    known = {c.regime for c in cells}
    regimes = [r for r in REGIMES if r in known] + sorted(known - set(REGIMES))
    by_key = {(c.regime, c.joint): c for c in cells if c.signal == signal}
    largest = max(c.gap for c in by_key.values())
    rows = [(regime, [_cell(by_key.get((regime, joint)), largest) for joint in joints]) for regime in regimes]
    label = f"Gap by signal, regime and joint: {signal}"
    return heat_map(joints, rows, label, title=signal, left=160, row=18, scale=scale(cells))


def _cell(cell: GapCell | None, largest: float) -> Cell:
    if cell is None:
        return Cell(None)
    return Cell(share_of(cell, largest), told(cell), "", cell.p_value is not None and cell.p_value <= SIGNIFICANT)


def scale(cells: Sequence[GapCell]) -> tuple[str, ...]:
    """What the scale of colours says."""
    return IN_FLOORS if has_floor(cells) else IN_LARGEST


def note(cells: Sequence[GapCell]) -> str:
    """How to read it."""
    about = "Load error: measured load minus the torque that the servo asks for. "
    about += "Distance of the nominal model's runs from the robot's, "
    if has_floor(cells):
        return (
            f"{about}divided by that between the robot's own runs. A dot marks what is not due to chance "
            f"(p ≤ {SIGNIFICANT}, corrected for the number of cells). Hover for figures."
        )
    return (
        f"{about}each signal on its own scale. No sequence was repeated, so it is not known how much of it is due to "
        "chance."
    )


def has_floor(cells: Sequence[GapCell]) -> bool:
    """Whether real runs were repeated."""
    return any(c.ratio is not None for c in cells)


def share_of(cell: GapCell, largest: float) -> float:
    """Place on the colour scale, 0 to 1; ``largest`` is the signal's largest gap."""
    if cell.ratio is not None:
        return float(np.log2(max(cell.ratio, 1.0)) / np.log2(TOP_RATIO))
    return cell.gap / largest if largest > 0.0 else 0.0


def told(cell: GapCell) -> str:
    """A cell in words."""
    lines = [f"{cell.signal} of {cell.joint}", cell.regime, f"gap {cell.gap:.3g} {cell.unit}"]
    if cell.ratio is not None:
        lines.append(f"between two runs of the robot {cell.floor:.3g} {cell.unit}: {cell.ratio:.1f} times that")
    if cell.p_value is not None:
        lines.append(f"p = {cell.p_value:.3f}, corrected for the number of cells")
    if cell.low is not None and cell.high is not None:
        lines.append(f"90 % interval {cell.low:.3g} to {cell.high:.3g} {cell.unit}")
    lines.append(f"{cell.n_samples} samples")
    return "\n".join(lines)


HEIGHT: Final = 400
SCALE: Final = 370.0
"""Picture units a metre."""
TURN_RAD, TILT_RAD = np.radians(74.0), np.radians(38.0)
"""Where the eye is: from the nose round to the robot's left, and up."""
NEARER: Final = np.array([np.cos(TURN_RAD), np.sin(TURN_RAD), 0.0])
RIGHT: Final = np.array([-np.sin(TURN_RAD), np.cos(TURN_RAD), 0.0])
UP: Final = np.cos(TILT_RAD) * np.array([0.0, 0.0, 1.0]) - np.sin(TILT_RAD) * NEARER
"""Directions in the body frame: towards the eye on the ground's plane, and the picture's two."""
BODY_M: Final = ((-0.42, 0.42), (-0.095, 0.095), (-0.07, 0.10))
"""The box that stands for the body, x, y, z."""
RADIUS: Final = 15


def picture(shares: Mapping[str, float], tips: Mapping[str, str], named: frozenset[str], scale: Sequence[str]) -> str:
    """An SVG of Spot: by joint its ``shares``, 0 to 1, on the colour scale (grey without one) and what hovering says.

    Joints that are ``named`` by the verdict get a ring; ``scale``: words below the scale of colours.
    """
    legs = {leg: _points(leg) for leg in facts.LEG_NAMES}
    far_first = sorted(legs, key=lambda leg: float(legs[leg][3] @ NEARER))
    behind = [leg for leg in far_first if facts.side_sign(leg) < 0]
    x, y = _screen(np.array([0.0, 0.0, legs["fl"][3, 2]]))
    parts = [f'<ellipse cx="{x:.0f}" cy="{y:.0f}" rx="200" ry="100" style="fill:var(--empty)"/>']
    parts += [_leg(legs[leg], opacity=0.55) for leg in behind]
    parts += _body()
    parts += [_leg(legs[leg], opacity=1.0) for leg in far_first if leg not in behind]
    for leg in far_first:
        for kind, point in zip(facts.JOINT_TYPES, legs[leg], strict=False):
            name = f"{leg}_{kind}"
            share, tip = shares.get(name), tips.get(name, f"{name}: not measured")
            x, y = _screen(point)
            fill, ink = ("var(--empty)", "var(--soft)") if share is None else (heat(share), on_heat(share))
            ring, width = ("var(--none)", 5.0) if name in named else ("var(--card)", 2.0)
            words = text(x, y + 4, kind, size=12, anchor="middle", weight=600, fill=ink)
            parts.append(disc(x, y, RADIUS, fill, tip, ring, width))
            parts.append(words.replace("<text", '<text pointer-events="none"', 1))
        x, y = _screen(legs[leg][3])
        parts.append(text(x, y + 26, leg, size=13.5, anchor="middle", css="soft", weight=600))
    x, y = _screen(np.array([0.56, 0.0, 0.02]))
    parts.append(text(x, y, "front", size=13, anchor="middle", css="soft"))
    parts.append(scale_bar(0.5 * WIDTH - 120, HEIGHT - 32, 240, scale))
    return svg(WIDTH, HEIGHT, parts, "Spot, joints coloured by their gap")


def _points(leg: str) -> Array:
    """Hip roll, hip pitch, knee and foot of a leg in the default pose, shape (4, 3), body frame, m."""
    first = 3 * facts.LEG_NAMES.index(leg)
    hx, hy, kn = facts.DEFAULT_POSITION_RAD[first : first + 3]
    signs = np.array([facts.end_sign(leg), facts.side_sign(leg), 1.0])
    thigh = signs * facts.HY_FROM_HX_M
    knee = thigh + Rotation.from_euler("y", hy).apply(facts.KN_FROM_HY_M)
    foot = knee + Rotation.from_euler("y", hy + kn).apply(facts.FOOT_FROM_KN_M)
    turned = Rotation.from_euler("x", hx).apply([np.zeros(3), thigh, knee, foot])
    return np.asarray(signs * facts.HX_FROM_BODY_M + turned)


def _screen(point: Array) -> tuple[float, float]:
    right, up = float(point @ RIGHT), float(point @ UP)
    return 0.48 * WIDTH + SCALE * right, 0.27 * HEIGHT - SCALE * up


def _leg(points: Array, opacity: float) -> str:
    screen = [_screen(p) for p in points]
    parts = [line(screen[i : i + 2], "var(--leg)", width, f"opacity:{opacity}") for i, width in enumerate((17, 14, 9))]
    return "".join([*parts, disc(*screen[3], 7, "var(--leg)")])


def _body() -> list[str]:
    """Its top, left and front, each in a shade."""
    (x0, x1), (y0, y1), (z0, z1) = BODY_M
    faces = {
        "1.06": [(x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)],
        "0.94": [(x0, y1, z0), (x1, y1, z0), (x1, y1, z1), (x0, y1, z1)],
        "0.8": [(x1, y0, z0), (x1, y1, z0), (x1, y1, z1), (x1, y0, z1)],
    }
    look = "fill:var(--body);stroke:var(--edge);stroke-width:1.5;stroke-linejoin:round;fill-opacity:.82"
    ways = {
        shade: " ".join("{:.1f},{:.1f}".format(*_screen(np.array(c))) for c in face) for shade, face in faces.items()
    }
    return [f'<polygon points="{way}" style="{look};filter:brightness({shade})"/>' for shade, way in ways.items()]
