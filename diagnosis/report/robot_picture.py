"""Spot from its left front, standing; each joint a disc in the colour of its gap."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from diagnosis.report.gap_map import scale_bar
from spot_log.page.svg import disc, heat, line, on_heat, svg, text
from spot_model.robot import facts

WIDTH: Final = 480
HEIGHT: Final = 400
SCALE: Final = 370.0
"""Picture units a metre."""
TURN_RAD: Final = float(np.radians(74.0))
TILT_RAD: Final = float(np.radians(38.0))
"""Where the eye is: from the nose round to the robot's left, and up."""
BODY_M: Final = ((-0.42, 0.42), (-0.095, 0.095), (-0.07, 0.10))
"""The box that stands for the body, x, y, z."""
RADIUS: Final = 15


def picture(shares: Mapping[str, float], tips: Mapping[str, str], named: frozenset[str], *, in_floors: bool) -> str:
    """An SVG of Spot.

    Args:
        shares: By joint, the place on the colour scale, 0 to 1; a joint that is missing stays grey.
        tips: By joint, what hovering says.
        named: Joints to which the verdict points: they get a ring and their name.
        in_floors: Whether colours are times the floor.
    """
    legs = {leg: _points(i) for i, leg in enumerate(facts.LEG_NAMES)}
    far_first = sorted(legs, key=lambda leg: _nearness(legs[leg][3]))
    behind = [leg for leg in far_first if facts.side_sign(leg) < 0]
    parts = [_shadow()]
    parts += [_leg(legs[leg], opacity=0.55) for leg in behind]
    parts.append(_body())
    parts += [_leg(legs[leg], opacity=1.0) for leg in far_first if leg not in behind]
    for leg in far_first:
        for kind, point in zip(facts.JOINT_TYPES, legs[leg][:3], strict=True):
            parts.append(_joint(f"{leg}_{kind}", kind, _screen(point), shares, tips, named))
        x, y = _screen(legs[leg][3])
        parts.append(text(x, y + 26, leg, size=13.5, anchor="middle", css="soft", weight=600))
    x, y = _screen(np.array([0.56, 0.0, 0.02]))
    parts.append(text(x, y, "front", size=13, anchor="middle", css="soft"))
    parts.append(scale_bar(0.5 * WIDTH - 120, HEIGHT - 32, 240, in_floors=in_floors))
    return svg(WIDTH, HEIGHT, parts, "Spot, joints coloured by their gap")


def _points(leg: int) -> list[np.ndarray]:
    """Hip roll, hip pitch, knee and foot of a leg in the default pose, body frame, m."""
    name = facts.LEG_NAMES[leg]
    hx, hy, kn = np.asarray(facts.DEFAULT_POSITION_RAD)[3 * leg : 3 * leg + 3]
    side, end = facts.side_sign(name), facts.end_sign(name)
    hip = np.array([end * facts.HX_FROM_BODY_M[0], side * facts.HX_FROM_BODY_M[1], 0.0])

    def rolled(x: float, y: float, z: float) -> np.ndarray:
        return np.array([x, y * np.cos(hx) - z * np.sin(hx), y * np.sin(hx) + z * np.cos(hx)])

    def pitched(offset: tuple[float, float, float], angle: float) -> tuple[float, float]:
        x, _, z = offset
        return x * np.cos(angle) + z * np.sin(angle), -x * np.sin(angle) + z * np.cos(angle)

    out = side * facts.HY_FROM_HX_M[1]
    thigh = pitched(facts.KN_FROM_HY_M, hy)
    shank = pitched(facts.FOOT_FROM_KN_M, hy + kn)
    knee = (thigh[0], out, thigh[1])
    foot = (thigh[0] + shank[0], out, thigh[1] + shank[1])
    return [hip, hip + rolled(0.0, out, 0.0), hip + rolled(*knee), hip + rolled(*foot)]


def _screen(point: np.ndarray) -> tuple[float, float]:
    x, y, z = (float(v) for v in point)
    right = -x * np.sin(TURN_RAD) + y * np.cos(TURN_RAD)
    up = z * np.cos(TILT_RAD) - _nearness(point) * np.sin(TILT_RAD)
    return 0.48 * WIDTH + SCALE * right, 0.27 * HEIGHT - SCALE * up


def _nearness(point: np.ndarray) -> float:
    """How far a point lies towards the eye, on the ground's plane, m."""
    return float(point[0] * np.cos(TURN_RAD) + point[1] * np.sin(TURN_RAD))


def _leg(points: list[np.ndarray], opacity: float) -> str:
    screen = [_screen(p) for p in points]
    more = f"opacity:{opacity}"
    return (
        line(screen[:2], "var(--leg)", 17, more)
        + line(screen[1:3], "var(--leg)", 14, more)
        + line(screen[2:], "var(--leg)", 9, more)
        + disc(*screen[3], 7, "var(--leg)")
    )


def _shadow() -> str:
    x, y = _screen(np.array([0.0, 0.0, _points(0)[3][2]]))
    return f'<ellipse cx="{x:.0f}" cy="{y:.0f}" rx="200" ry="100" style="fill:var(--empty)"/>'


def _body() -> str:
    (x0, x1), (y0, y1), (z0, z1) = BODY_M

    def face(corners: list[tuple[float, float, float]], shade: str) -> str:
        way = " ".join("{:.1f},{:.1f}".format(*_screen(np.array(c))) for c in corners)
        return (
            f'<polygon points="{way}" style="fill:var(--body);stroke:var(--edge);stroke-width:1.5;'
            f'stroke-linejoin:round;filter:brightness({shade});fill-opacity:.82"/>'
        )

    top = face([(x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)], "1.06")
    left = face([(x0, y1, z0), (x1, y1, z0), (x1, y1, z1), (x0, y1, z1)], "0.94")
    front = face([(x1, y0, z0), (x1, y1, z0), (x1, y1, z1), (x1, y0, z1)], "0.8")
    return top + left + front


def _joint(
    name: str,
    kind: str,
    at: tuple[float, float],
    shares: Mapping[str, float],
    tips: Mapping[str, str],
    named: frozenset[str],
) -> str:
    x, y = at
    share = shares.get(name)
    fill = "var(--empty)" if share is None else heat(share)
    ring, width = ("var(--none)", 5.0) if name in named else ("var(--card)", 2.0)
    ink = "var(--soft)" if share is None else on_heat(share)
    tip = tips.get(name, f"{name}: not measured")
    words = text(x, y + 4, kind, size=12, anchor="middle", weight=600, fill=ink)
    return disc(x, y, RADIUS, fill, tip, ring, width) + words.replace("<text", '<text pointer-events="none"', 1)
