"""A gait diagram, as SVG: a bar for each foot while it is on the ground."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from spot_log.page.frame import WIDE, Frame
from spot_log.page.svg import rect, svg, text

_ROW: Final = 18


def stance(
    contact: ArrayLike, names: Sequence[str], colour: str, *, width: float = WIDE, span_s: tuple[float, float] = (0, 0)
) -> str:
    """Feet on the ground over a stretch of time, one row a foot; an empty text where there is none.

    Args:
        contact: Whether each foot is down, samples at even times. Shape (n, feet).
        names: Of the feet.
        colour: Of the bars.
        width: Of the picture.
        span_s: Begin and end on the axis of time below; no axis without them.
    """
    down = np.asarray(contact, dtype=np.bool_)
    if down.ndim != 2 or down.shape[1] != len(names) or not len(down):
        return ""
    frame = Frame((0.0, len(down)), (0.0, 1.0), width, _ROW * len(names), top=4)
    parts = []
    for foot, name in enumerate(names):
        y = frame.top + _ROW * foot
        parts.append(text(frame.left - 8, y + 12, name, size=12, anchor="end"))
        parts.append(rect(frame.left, y, frame.right - frame.left, _ROW - 4, "var(--empty)", radius=0))
        edges = np.flatnonzero(np.diff(np.concatenate([[0], down[:, foot].astype(int), [0]])))
        for a, b in edges.reshape(-1, 2):
            left, right = frame.at(float(a), 0.0)[0], frame.at(float(b), 0.0)[0]
            parts.append(rect(left, y, right - left, _ROW - 4, colour, f"{name} on the ground", radius=0))
    height = frame.top + frame.height
    if span_s[1] > span_s[0]:
        parts += Frame(span_s, (0.0, 1.0), width, frame.height, top=4).axes(x_unit=" s", has_y=False)
        height = frame.total_height
    return svg(width, height, parts, "Feet on the ground")
