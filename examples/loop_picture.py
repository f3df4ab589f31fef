"""The loop's picture: knee actions and torques of the policies at the top of the forward sequence, as SVG."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from spot_log import Run
from spot_model.robot import facts

JOINTS: Final = ("fr_kn", "hr_kn")
COLOURS: Final = {"baseline": "#c06a3d", "identified": "#2f7f9e", "oracle": "#1c2430"}
BEGIN_S: Final = 12.0
LENGTH_S: Final = 1.2
WIDTH: Final = 460
HEIGHT: Final = 190
MARGIN: Final = 46


def write_overlay(runs: Mapping[str, Run], path: Path, title: str) -> None:
    """Draw front and hind right knee: action above, measured torque below; one line a policy.

    Args:
        runs: Forward sequences by policy; those that ended before the top are left out, and the legend says so.
        path: An SVG file.
        title: Above the panels.
    """
    panels, legend = [], []
    shown = {name: run for name, run in runs.items() if _duration_s(run) > BEGIN_S + LENGTH_S}
    for number, (kind, joint) in enumerate((k, j) for k in ("action", "torque, N·m") for j in JOINTS):
        lines = {name: _line(run, kind, joint) for name, run in shown.items()}
        x, y = MARGIN + (number % 2) * (WIDTH + MARGIN), 66 + (number // 2) * (HEIGHT + 44)
        panels.append(_panel(lines, f"{joint} {kind}", x, y))
    for number, name in enumerate(runs):
        words = name if name in shown else f"{name} (ended before)"
        x = MARGIN + 190 * number
        legend.append(
            f'<line x1="{x}" y1="40" x2="{x + 24}" y2="40" stroke="{COLOURS.get(name, "#888888")}" stroke-width="2.5"/>'
            f'<text x="{x + 30}" y="44">{escape(words)}</text>'
        )
    width, height = 2 * WIDTH + 3 * MARGIN, 66 + 2 * (HEIGHT + 44)
    path.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        f'font-family="sans-serif" font-size="13"><rect width="100%" height="100%" fill="#ffffff"/>'
        f'<text x="{MARGIN}" y="22" font-size="16">{escape(title)}</text>{"".join(legend)}{"".join(panels)}</svg>\n',
        encoding="utf-8",
    )


def _line(run: Run, kind: str, joint: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    begin_ns = int(run.ticks.robot_stamp_ns[run.ticks.mode == "active"][0]) + round(BEGIN_S * 1e9)
    column = facts.JOINT_NAMES.index(joint)
    if kind == "action":
        stamps, values = run.ticks.robot_stamp_ns, run.ticks.action[:, column].astype(np.float64)
    else:
        stamps, values = run.states.robot_stamp_ns, run.states.load_nm[:, column]
    inside = (stamps >= begin_ns) & (stamps < begin_ns + round(LENGTH_S * 1e9))
    return np.asarray((stamps[inside] - begin_ns) * 1e-9, dtype=np.float64), np.asarray(values[inside])


def _panel(
    lines: Mapping[str, tuple[NDArray[np.float64], NDArray[np.float64]]], title: str, x0: float, y0: float
) -> str:
    values = np.concatenate([v for _, v in lines.values()]) if lines else np.zeros(1)
    low, high = float(values.min()), float(values.max())
    pad = 0.05 * max(high - low, 1e-6)
    low, high = low - pad, high + pad

    def place(time_s: NDArray[np.float64], value: NDArray[np.float64]) -> str:
        x = x0 + WIDTH * time_s / LENGTH_S
        y = y0 + HEIGHT * (high - value) / (high - low)
        return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))

    drawn = [
        f'<rect x="{x0}" y="{y0}" width="{WIDTH}" height="{HEIGHT}" fill="none" stroke="#b8bec8"/>',
        f'<text x="{x0}" y="{y0 - 6}">{escape(title)}</text>',
        f'<text x="{x0 + WIDTH}" y="{y0 + HEIGHT + 16}" text-anchor="end" fill="#5b6472">{LENGTH_S:g} s</text>',
        f'<text x="{x0}" y="{y0 + HEIGHT + 16}" fill="#5b6472">0 s</text>',
    ]
    for tick in _ticks(low, high):
        y = y0 + HEIGHT * (high - tick) / (high - low)
        drawn.append(f'<line x1="{x0}" x2="{x0 + WIDTH}" y1="{y:.1f}" y2="{y:.1f}" stroke="#e6e9ee"/>')
        drawn.append(f'<text x="{x0 - 6}" y="{y + 4:.1f}" text-anchor="end" fill="#5b6472">{tick:g}</text>')
    for name, (time_s, value) in lines.items():
        colour = COLOURS.get(name, "#888888")
        drawn.append(f'<polyline points="{place(time_s, value)}" fill="none" stroke="{colour}" stroke-width="1.6"/>')
    return "".join(drawn)


def _ticks(low: float, high: float) -> list[float]:
    step = 10.0 ** np.floor(np.log10((high - low) / 3.0))
    step *= next(m for m in (1.0, 2.0, 5.0, 10.0) if (high - low) / (m * step) <= 6.0)
    return [float(v) + 0.0 for v in np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step]


def _duration_s(run: Run) -> float:
    stamps = run.ticks.robot_stamp_ns[run.ticks.mode == "active"]
    return float(stamps[-1] - stamps[0]) * 1e-9 if len(stamps) else 0.0
