"""A picture of the robot from its left, opened out: each joint a disc coloured by its gap."""

from __future__ import annotations

import html
from collections.abc import Mapping
from typing import Final

LEGS: Final = {"fl": (450, 100), "fr": (450, 300), "hl": (150, 100), "hr": (150, 300)}
"""Where the hips are; the robot is seen from above, its nose to the right."""


def picture(gaps: Mapping[str, float], named: frozenset[str]) -> str:
    """An SVG of Spot.

    Args:
        gaps: By joint, a number; the largest is the darkest.
        named: Joints to which the verdict points: they get a ring.
    """
    top = max(gaps.values(), default=0.0)
    parts = [
        '<svg viewBox="0 0 620 400" role="img" aria-label="Spot, joints coloured by their gap" width="100%">',
        '<rect x="110" y="140" width="400" height="120" rx="34" fill="#f0c419" stroke="#7d6608"/>',
        '<rect x="470" y="160" width="52" height="80" rx="14" fill="#3b4650"/>',
        '<text x="300" y="206" text-anchor="middle" font-size="15" fill="#5c4b05">front →</text>',
    ]
    for leg, (x, y) in LEGS.items():
        out = -1 if y < 200 else 1
        points = {"hx": (x, y + 38 * -out), "hy": (x + 52, y + 4 * out), "kn": (x - 12, y + 62 * out)}
        foot = (x + 34, y + 88 * out)
        line = " ".join(f"{a},{b}" for a, b in [*points.values(), foot])
        parts.append(
            f'<polyline points="{line}" fill="none" stroke="#56636e" stroke-width="9" stroke-linecap="round"/>'
        )
        parts.append(f'<circle cx="{foot[0]}" cy="{foot[1]}" r="7" fill="#26313b"/>')
        for kind, (a, b) in points.items():
            joint = f"{leg}_{kind}"
            value = gaps.get(joint, 0.0)
            ring = ' stroke="#1f4fbf" stroke-width="5"' if joint in named else ' stroke="#fff" stroke-width="2"'
            parts.append(
                f'<g><title>{html.escape(joint)}: {value:.2f}</title><circle cx="{a}" cy="{b}" r="17" '
                f'fill="{colour(value / top if top > 0.0 else 0.0)}"{ring}/>'
                f'<text x="{a}" y="{b + 4}" text-anchor="middle" font-size="11" '
                f'fill="{"#fff" if top > 0.0 and value > 0.6 * top else "#26313b"}">{kind}</text></g>'
            )
        parts.append(f'<text x="{x - 62}" y="{y + 30 * out}" font-size="14" fill="#61707d">{leg}</text>')
    parts.append("</svg>")
    return "".join(parts)


def colour(share: float) -> str:
    """From pale to dark red, share 0 to 1."""
    low, high = (253, 237, 228), (165, 15, 21)
    return "#" + "".join(
        f"{round(a + (b - a) * min(max(share, 0.0), 1.0)):02x}" for a, b in zip(low, high, strict=True)
    )
