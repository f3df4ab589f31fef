"""Each log as a strip of time: what was cut out, and which seconds carry the gap."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from diagnosis.document import Stretch
from spot_log.page.svg import nice_ticks, rect, svg, text
from spot_log.read.run import Run

WIDTH: Final = 560
LEFT: Final = 170
ROW: Final = 22
MAX_LOGS: Final = 40


def strips(runs: Sequence[Run], stretches: Sequence[Stretch]) -> str:
    """One strip a log."""
    shown = runs[:MAX_LOGS]
    longest = max(run.duration_s for run in shown) or 1.0
    scale = (WIDTH - LEFT - 16) / longest
    parts = []
    for i, run in enumerate(shown):
        y = 4 + ROW * i
        name = run.header.command_sequence or run.path.stem
        parts.append(text(LEFT - 10, y + 13, f"{name[:18]}, repeat {run.header.repeat}", size=12.5, anchor="end"))
        parts.append(rect(LEFT, y, scale * run.duration_s, ROW - 6, "var(--corrected)", run.path.name, radius=3))
        for s in stretches:
            if s.log != run.header.run_id:
                continue
            fill = "var(--nominal)" if s.kind == "gap" else "var(--empty)"
            tip = f"{s.start_s:.1f} to {s.end_s:.1f} s: {s.reason}"
            end = min(s.end_s, run.duration_s)
            parts.append(rect(LEFT + scale * s.start_s, y, scale * (end - s.start_s), ROW - 6, fill, tip, radius=1))
    bottom = 4 + ROW * len(shown)
    parts += [
        text(LEFT + scale * tick, bottom + 12, f"{tick:g} s", size=12.5, anchor="middle", css="soft")
        for tick in nice_ticks(0.0, longest, 5)
    ]
    return svg(WIDTH, bottom + 20, parts, "Logs over time")
