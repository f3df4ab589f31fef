"""A histogram with its median and 99th percentile, as SVG."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from spot_log.page.frame import QUARTER, Frame
from spot_log.page.svg import line, rect, svg, text

_BINS: Final = 40
_SHOWN_PERCENT: Final = 99.5


def histogram(values: ArrayLike, title: str, *, width: float = QUARTER, height: float = 150) -> str:
    """Draw how often each value came; what lies beyond the 99.5th percentile is counted in words.

    Args:
        values: Shape (n,); those that are not finite are left out.
        title: What they are, with the unit.
        width: Of the picture.
        height: Of the plot.
    """
    known = np.asarray(values, dtype=np.float64)
    known = known[np.isfinite(known)]
    if not len(known):
        return svg(width, height, [text(44, 16, title, weight=500), text(44, 40, "not known", css="soft")], title)
    low, top = float(known.min()), float(np.percentile(known, _SHOWN_PERCENT))
    counts, edges = np.histogram(known, bins=_BINS, range=(low, top if top > low else low + 1.0))
    frame = Frame((float(edges[0]), float(edges[-1])), (0.0, 1.08 * counts.max()), width, height, left=44, top=58)
    parts = [text(4, 16, title, weight=500), *frame.axes()]
    for count, a, b in zip(counts, edges[:-1], edges[1:], strict=True):
        (left, y), (right, base) = frame.at(float(a), float(count)), frame.at(float(b), 0.0)
        parts.append(
            rect(left, y, right - left, base - y, "var(--floor)", f"{count} from {a:.4g} to {b:.4g}", radius=0)
        )
    p50, p99 = (float(p) for p in np.percentile(known, [50, 99]))
    for value in (p50, p99):
        x = frame.at(value, 0.0)[0]
        parts.append(line([(x, frame.top), (x, frame.top + height)], "var(--nominal)", 1.5, "stroke-dasharray:3 4;"))
    parts.append(text(4, 33, f"median {p50:.4g}, 99 % {p99:.4g}", size=12, css="soft"))
    beyond = int(np.sum(known > edges[-1]))
    if beyond:
        parts.append(text(4, 49, f"{beyond} more, up to {known.max():.4g}", size=12, css="soft"))
    return svg(width, frame.total_height, parts, title)
