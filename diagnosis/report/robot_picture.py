"""Spot from its left front, standing; each joint a disc in the colour of its gap."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from spot_log.page.rows import scale_bar
from spot_log.page.svg import disc, heat, line, on_heat, svg, text
from spot_model.robot import facts
from spot_model.robot.facts import Array

WIDTH: Final = 480
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
