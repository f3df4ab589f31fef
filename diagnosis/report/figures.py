"""The figures of the report: gaps before and after, by joint and by regime.

Colours reach to the largest gap of their figure: in times what repeats or noise explain, or without these in its unit.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from diagnosis.document import Consequences, GapCell
from diagnosis.report.words import BODY, number
from spot_log.page.rows import Bar, Cell, bars, heat_map, scale_bar
from spot_log.page.svg import disc, heat, line, on_heat, svg, text
from spot_model.robot import facts
from spot_model.robot.facts import Array

COLOURS: Final = ("var(--nominal)", "var(--corrected)", "var(--floor)")
"""Before, after, floor."""
WIDTH: Final = 480
SIGNIFICANT: Final = 0.05
LEAST_TOP: Final = 4.0
"""The darkest colour is of so many times what repeats or noise explain, or more: a robot without a gap stays pale."""
SIGNALS: Final = ("load error", "load", "torque error of swinging legs", "velocity", "position")
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
    return bars(groups, "Three gaps, before and after", left=134)


def gap_maps(cells: Sequence[GapCell], joints: Sequence[str]) -> list[str]:
    """A map a signal, as SVG: regimes down, joints across; hovering tells the figures."""
    return [_gap_map(signal, cells, joints) for signal in SIGNALS if any(c.signal == signal for c in cells)]


def _gap_map(signal: str, cells: Sequence[GapCell], joints: Sequence[str]) -> str:
    known, cells = {c.regime for c in cells}, [c for c in cells if c.signal == signal]
    regimes = [r for r in REGIMES if r in known] + sorted(known - set(REGIMES))
    by_key, top = {(c.regime, c.joint): c for c in cells}, top_of(cells)
    sure = {at for at, c in by_key.items() if c.p_value is not None and c.p_value <= SIGNIFICANT}
    drawn = {at: Cell(share_of(c, top), told(c), "", at in sure) for at, c in by_key.items()}
    rows = [(regime, [drawn.get((regime, joint), Cell(None)) for joint in joints]) for regime in regimes]
    label = f"Gap by signal, regime and joint: {signal}"
    return heat_map(joints, rows, label, title=signal, left=160, row=18, scale=scale(cells))


def top_of(cells: Sequence[GapCell]) -> float:
    """What the darkest colour stands for."""
    if has_floor(cells):
        return max(LEAST_TOP, *(c.ratio or 0.0 for c in cells))
    return max(c.gap for c in cells) or 1.0


def share_of(cell: GapCell, top: float) -> float:
    """Place on the scale of colours, 0 to 1."""
    return cell.gap / top if cell.ratio is None else max(cell.ratio - 1.0, 0.0) / (top - 1.0)


def scale(cells: Sequence[GapCell]) -> tuple[str, ...]:
    """Words below the scale of colours."""
    top = top_of(cells)
    if has_floor(cells):
        return tuple(f"{x:.2g}×" for x in (1.0, 0.5 + 0.5 * top, top))
    return tuple(number(x, cells[0].unit) for x in (0.0, 0.5 * top, top))


def meaning(cells: Sequence[GapCell]) -> str:
    """What a colour stands for."""
    noise = "sensors' noise makes" if all(c.p_value is None for c in cells) else "two runs of the robot differ by"
    return f"in times what {noise}" if has_floor(cells) else f"in {cells[0].unit}"


def note(cells: Sequence[GapCell]) -> str:
    """How to read it."""
    chance = "No sequence was repeated, so it is not known how much of it is due to chance."
    if has_floor(cells):
        chance = f"A dot marks what is not due to chance (p ≤ {SIGNIFICANT}, corrected for the number of cells)."
    colour = meaning(cells) if has_floor(cells) else "each signal in its unit"
    return f"Colour: the nominal model's gap, {colour}. Load error: measured load less what the servo asks. {chance}"


def has_floor(cells: Sequence[GapCell]) -> bool:
    """Whether it is known what repeats or noise explain."""
    return any(c.ratio is not None for c in cells)


def told(cell: GapCell) -> str:
    """A cell in words."""
    lines = [f"{cell.signal} of {cell.joint}", cell.regime, f"gap {cell.gap:.3g} {cell.unit}"]
    if cell.ratio is not None:
        lines.append(f"{cell.ratio:.1f} times the {cell.floor:.3g} {cell.unit} that repeats or noise explain")
    if cell.p_value is not None:
        lines.append(f"p = {cell.p_value:.3f}, corrected for the number of cells")
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


def picture(cells: Mapping[str, GapCell], named: Collection[str]) -> str:
    """An SVG of Spot: joints in the colours of their cells, grey without one; what is named has a blue frame."""
    all_cells = tuple(cells.values())
    top = top_of(all_cells)
    legs = {leg: _points(leg) for leg in facts.LEG_NAMES}
    far_first = sorted(legs, key=lambda leg: float(legs[leg][3] @ NEARER))
    behind = [leg for leg in far_first if facts.side_sign(leg) < 0]
    x, y = _screen(np.array([0.0, 0.0, legs["fl"][3, 2]]))
    parts = [f'<ellipse cx="{x:.0f}" cy="{y:.0f}" rx="200" ry="100" style="fill:var(--empty)"/>']
    parts += [_leg(legs[leg], opacity=0.55) for leg in behind]
    parts += _body(BODY in named)
    parts += [_leg(legs[leg], opacity=1.0) for leg in far_first if leg not in behind]
    for leg in far_first:
        for kind, point in zip(facts.JOINT_TYPES, legs[leg], strict=False):
            name = f"{leg}_{kind}"
            share = share_of(cells[name], top) if name in cells else None
            tip = told(cells[name]) if name in cells else f"{name}: not measured"
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
    parts.append(scale_bar(0.5 * WIDTH - 120, HEIGHT - 32, 240, scale(all_cells)))
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


def _body(is_named: bool) -> list[str]:
    """Its top, left and front, each in a shade."""
    (x0, x1), (y0, y1), (z0, z1) = BODY_M
    faces = {
        "1.06": [(x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)],
        "0.94": [(x0, y1, z0), (x1, y1, z0), (x1, y1, z1), (x0, y1, z1)],
        "0.8": [(x1, y0, z0), (x1, y1, z0), (x1, y1, z1), (x1, y0, z1)],
    }
    edge = "var(--none);stroke-width:5" if is_named else "var(--edge);stroke-width:1.5"
    look = f"fill:var(--body);stroke:{edge};stroke-linejoin:round;fill-opacity:.82"
    ways = {
        shade: " ".join("{:.1f},{:.1f}".format(*_screen(np.array(c))) for c in face) for shade, face in faces.items()
    }
    return [f'<polygon points="{way}" style="{look};filter:brightness({shade})"/>' for shade, way in ways.items()]
