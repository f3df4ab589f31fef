"""From a gap to a colour: how many times its floor, or without a floor its share of the largest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from diagnosis.document import GapCell
from spot_log.page.svg import heat, rect, text

TOP_RATIO = 16.0
"""The darkest colour: so many times the floor, or more."""


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


def scale_bar(x: float, y: float, width: float, *, in_floors: bool) -> str:
    """The legend of the colours."""
    n = 40
    parts = [rect(x + i * width / n, y, width / n + 0.5, 10, heat((i + 0.5) / n), radius=0) for i in range(n)]
    words = (
        [(0.0, "1× own runs"), (0.25, "2×"), (0.5, "4×"), (0.75, "8×"), (1.0, "16×")]
        if in_floors
        else [
            (0.0, "0"),
            (1.0, "largest"),
        ]
    )
    parts += [text(x + s * width, y + 24, w, size=11, anchor="middle", css="soft") for s, w in words]
    return "".join(parts)
