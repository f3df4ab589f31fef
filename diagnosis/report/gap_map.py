"""The gap map: a panel a signal, regimes down, joints across; hovering tells the figures. And its scale of colours.

A colour says how many times its floor a gap is, or without a floor its share of the signal's largest.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from diagnosis.document import GapCell
from spot_log.page.svg import HALF, disc, heat, on_heat, rect, svg, text

SIGNALS: Final = ("load error", "load", "velocity", "position")
REGIMES: Final = (
    *("all", "motoring", "motoring, high speed", "motoring, high torque"),
    *("braking", "braking, high speed", "braking, high torque"),
    *("low torque", "middle torque", "high torque", "low speed", "middle speed", "high speed"),
    *("velocity reversal", "stance", "swing", "low total power", "high total power"),
    *("first third of time", "last third of time"),
)
LABELS: Final = 160
ROW: Final = 18
TOP: Final = 74
SIGNIFICANT: Final = 0.05
TOP_RATIO: Final = 16.0
"""The darkest colour: so many times the floor, or more."""


def gap_maps(cells: Sequence[GapCell], joints: Sequence[str]) -> list[str]:
    """A panel for each signal, as SVG."""
    return [_panel(signal, cells, joints) for signal in SIGNALS if any(c.signal == signal for c in cells)]


def _panel(signal: str, cells: Sequence[GapCell], joints: Sequence[str]) -> str:
    known = {c.regime for c in cells}
    regimes = [r for r in REGIMES if r in known] + sorted(known - set(REGIMES))
    by_key = {(c.regime, c.joint): c for c in cells if c.signal == signal}
    width = (HALF - LABELS - 14) / len(joints)
    parts = [text(LABELS - 10, TOP + ROW * (i + 0.72), r, size=12.5, anchor="end") for i, r in enumerate(regimes)]
    parts.append(text(LABELS - 10, 40, signal, size=15, anchor="end", weight=600))
    largest = max(c.gap for c in by_key.values())
    for j, joint in enumerate(joints):
        at = LABELS + (j + 0.5) * width
        name = text(0, 0, joint, size=12, css="soft")
        parts.append(f'<g transform="translate({at + 4:.1f} {TOP - 6}) rotate(-60)">{name}</g>')
        for i, regime in enumerate(regimes):
            cell, x, y = by_key.get((regime, joint)), LABELS + j * width, TOP + ROW * i
            if cell is None:
                parts.append(rect(x, y, width - 1, ROW - 1, "var(--empty)"))
                continue
            share = share_of(cell, largest)
            parts.append(rect(x, y, width - 1, ROW - 1, heat(share), told(cell)))
            if cell.p_value is not None and cell.p_value <= SIGNIFICANT:
                dot = disc(at - 0.5, y + ROW / 2 - 0.5, 2.2, on_heat(share))
                parts.append(dot.replace("<circle", '<circle pointer-events="none"', 1))
    bottom = TOP + ROW * len(regimes)
    parts.append(scale_bar(HALF - 330, bottom + 14, 260, in_floors=has_floor(cells)))
    return svg(HALF, bottom + 48, parts, f"Gap by signal, regime and joint: {signal}")


def note(cells: Sequence[GapCell]) -> str:
    """How to read it."""
    about = "Load error: measured load minus the torque that the servo asks for. "
    about += "Distance of your simulator's runs from the robot's, "
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


def scale_bar(x: float, y: float, width: float, *, in_floors: bool) -> str:
    """The legend of the colours."""
    n = 40
    parts = [rect(x + i * width / n, y, width / n + 0.5, 10, heat((i + 0.5) / n), radius=0) for i in range(n)]
    words = ("1× own runs", "2×", "4×", "8×", "16×") if in_floors else ("0", "largest")
    at = np.linspace(x, x + width, len(words))
    parts += [text(a, y + 24, w, size=11, anchor="middle", css="soft") for a, w in zip(at, words, strict=True)]
    return "".join(parts)
