"""The gap map: signals side by side, regimes down, joints across; hovering tells the figures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from diagnosis.document import GapCell
from diagnosis.report.scale import has_floor, scale_bar, share_of, told
from spot_log.page.svg import disc, heat, on_heat, rect, svg, text

SIGNALS: Final = ("load error", "load", "velocity", "position")
REGIMES: Final = (
    "all",
    "motoring",
    "motoring, high speed",
    "motoring, high torque",
    "braking",
    "braking, high speed",
    "braking, high torque",
    "low torque",
    "middle torque",
    "high torque",
    "low speed",
    "middle speed",
    "high speed",
    "velocity reversal",
    "stance",
    "swing",
    "low total power",
    "high total power",
    "first third of time",
    "last third of time",
)
WIDTH: Final = 1160
LABELS: Final = 165
ROW: Final = 18
TOP: Final = 74
SIGNIFICANT: Final = 0.05


def gap_map_figure(cells: Sequence[GapCell], joints: Sequence[str]) -> str:
    """The map as SVG."""
    signals = [s for s in SIGNALS if any(c.signal == s for c in cells)]
    known = {c.regime for c in cells}
    regimes = [r for r in REGIMES if r in known] + sorted(known - set(REGIMES))
    by_key = {(c.signal, c.regime, c.joint): c for c in cells}
    panel = (WIDTH - LABELS) / len(signals)
    width = (panel - 14) / len(joints)
    parts = [text(LABELS - 10, TOP + ROW * (i + 0.72), r, size=12, anchor="end") for i, r in enumerate(regimes)]
    for k, signal in enumerate(signals):
        x = LABELS + k * panel
        parts.append(text(x + (panel - 14) / 2, 16, signal, size=14, anchor="middle", weight=600))
        largest = max(c.gap for c in cells if c.signal == signal)
        for j, joint in enumerate(joints):
            at = x + (j + 0.5) * width
            name = text(0, 0, joint, size=11, css="soft")
            parts.append(f'<g transform="translate({at + 4:.1f} {TOP - 6}) rotate(-60)">{name}</g>')
            for i, regime in enumerate(regimes):
                cell = by_key.get((signal, regime, joint))
                y = TOP + ROW * i
                if cell is None:
                    parts.append(rect(x + j * width, y, width - 1, ROW - 1, "var(--empty)"))
                    continue
                share = share_of(cell, largest)
                parts.append(rect(x + j * width, y, width - 1, ROW - 1, heat(share), told(cell)))
                if cell.p_value is not None and cell.p_value <= SIGNIFICANT:
                    dot = disc(at - 0.5, y + ROW / 2 - 0.5, 2.2, on_heat(share))
                    parts.append(dot.replace("<circle", '<circle pointer-events="none"', 1))
    bottom = TOP + ROW * len(regimes)
    parts.append(scale_bar(WIDTH - 330, bottom + 14, 260, in_floors=has_floor(cells)))
    return svg(WIDTH, bottom + 48, parts, "Gap by signal, regime and joint")


def note(cells: Sequence[GapCell]) -> str:
    """How to read it."""
    error = "Load error: measured load minus the torque that the servo asks for. "
    if has_floor(cells):
        return error + (
            "Distance of your simulator's runs from the robot's, divided by that between the robot's own runs. "
            f"A dot marks what is not due to chance (p ≤ {SIGNIFICANT}, corrected for the number of "
            "cells). Hover for figures."
        )
    return error + (
        "Distance of your simulator's runs from the robot's, each signal on its own scale. No sequence was repeated, "
        "so it is not known how much of it is due to chance."
    )
