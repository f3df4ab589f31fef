"""A drawing of Spot in its default pose, seen from 74° round to its left and 38° above."""

from __future__ import annotations

from typing import Final

from spot_log.page.draw import as_line, heat, on_heat, tipped, words
from spot_log.page.sections import Cell, SpotMap
from spot_model.robot.facts import JOINT_TYPES

_LEGS: Final = {
    "hr": ((330, 77), (319, 50), (415, 78), (365, 169)),
    "fr": ((118, 115), (107, 87), (189, 131), (118, 218)),
    "hl": ((342, 101), (353, 122), (452, 157), (409, 262)),
    "fl": ((130, 139), (141, 160), (227, 213), (162, 312)),
}
"""Hip roll, hip pitch, knee and foot of each leg in the picture; the right legs are behind the body."""
_BODY: Final = {
    "1.06": "370,32 71,84 90,126 389,73",
    "0.94": "389,123 90,176 90,126 389,73",
    "0.8": "71,134 90,176 90,126 71,84",
}
"""Corners of the body's top, left and front, by their brightness."""


def spot_svg(spot: SpotMap) -> str:
    """Body, legs, and the joints in the colours of their cells."""
    named, limbs = set(spot.named), [_limb(points, 0.55 if leg[1] == "r" else 1.0) for leg, points in _LEGS.items()]
    edge = "var(--none);stroke-width:5" if "body" in named else "var(--edge);stroke-width:1.5"
    look = f"fill:var(--body);stroke:{edge};stroke-linejoin:round;fill-opacity:.82"
    body = [f'<polygon points="{way}" style="{look};filter:brightness({b})"/>' for b, way in _BODY.items()]
    parts = ['<ellipse cx="230" cy="249" rx="200" ry="100" style="fill:var(--empty)"/>', *limbs[:2], *body, *limbs[2:]]
    for leg, points in _LEGS.items():
        for kind, (x, y) in zip(JOINT_TYPES, points, strict=False):
            name = f"{leg}_{kind}"
            share, tip, _ = spot.cells.get(name, Cell(None, f"{name}: not measured"))
            fill, ink = ("var(--empty)", "var(--soft)") if share is None else (heat(share), on_heat(share))
            ring = "var(--none);stroke-width:5" if name in named else "var(--card);stroke-width:2"
            parts.append(f'<circle cx="{x}" cy="{y}" r="15" style="fill:{fill};stroke:{ring}"{tipped(tip)}/>')
            parts.append(words(x, y + 4, kind, more=f' pointer-events="none" style="fill:{ink};font-weight:600"'))
        parts.append(words(points[3][0], points[3][1] + 26, leg, more=' font-weight="600"'))
    parts.append(words(31, 137, "front"))
    label = "Spot, joints coloured by their gap"
    return f'<svg class="spot" viewBox="0 0 480 360" role="img" aria-label="{label}">{"".join(parts)}</svg>'


def _limb(points: tuple[tuple[int, int], ...], opacity: float) -> str:
    ends = f"stroke-linecap:round;opacity:{opacity}"
    parts = [as_line(points[i : i + 2], "var(--leg)", width, ends) for i, width in enumerate((17, 14, 9))]
    return "".join([*parts, as_line([points[3]] * 2, "var(--leg)", 14, "stroke-linecap:round")])
