"""The pictures of a comparison: lines over time, a map of joints and signals, feet on the ground."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from compare.cause import Cause
from compare.differences import SIGNALS, TITLES, Differences
from compare.tracks import STEP_S, Array, Track
from diagnosis.report.svg import heat, line, nice_ticks, on_heat, rect, svg, text, thinned
from spot_model.robot.facts import JOINT_NAMES, LEG_NAMES

COLOURS: Final = ("var(--real)", "var(--nominal)", "var(--corrected)", "var(--floor)")
WIDTH: Final = 1160
LEFT: Final = 62
RIGHT: Final = 12
MAX_POINTS: Final = 600
FULL_SHARE: Final = 1.0
"""Share of the reference's spread at which the map is darkest."""


def over_time(
    lines: Sequence[tuple[str, float, Array]], title: str, *, from_s: float = 0.0, height: float = 190,
    causes: Sequence[Cause] = (),
) -> str:  # fmt: skip
    """Lines on one axis of time.

    Args:
        lines: Colour, width and samples :data:`compare.tracks.STEP_S` apart, each of shape (n,).
        title: Of the vertical axis, with its unit.
        from_s: Time of the first sample.
        height: Of the plot.
        causes: Stretches that are shaded.
    """
    drawn = [(c, w, v) for c, w, v in lines if np.isfinite(v).any()]
    if not drawn:
        return ""
    low = min(float(np.nanmin(v)) for _, _, v in drawn)
    high = max(float(np.nanmax(v)) for _, _, v in drawn)
    pad = 0.06 * max(high - low, 1e-6)
    low, high = low - pad, high + pad
    span_s = max(len(v) for _, _, v in drawn) * STEP_S
    top = 8.0

    def x(time_s: Array | float) -> Array:
        return np.asarray(LEFT + (np.asarray(time_s) - from_s) / span_s * (WIDTH - LEFT - RIGHT))

    def y(value: Array | float) -> Array:
        return np.asarray(top + height * (high - np.asarray(value)) / (high - low))

    parts = [
        rect(float(x(c.start_s)), top, float(x(c.end_s) - x(c.start_s)), height, "var(--cause)", c.text, radius=0)
        for c in causes
    ]
    for tick in nice_ticks(low, high, 4):
        parts.append(line([(LEFT, float(y(tick))), (WIDTH - RIGHT, float(y(tick)))], "var(--line)", 1))
        parts.append(text(LEFT - 8, float(y(tick)) + 4, f"{tick:g}", size=12, anchor="end", css="soft"))
    parts += [
        text(float(x(tick)), top + height + 16, f"{tick:g} s", size=12, anchor="middle", css="soft")
        for tick in nice_ticks(from_s, from_s + span_s, 8)
    ]
    for colour, width, values in drawn:
        rows = thinned(values, MAX_POINTS)
        rows = rows[np.isfinite(values[rows])]
        points = zip(x(from_s + rows * STEP_S).tolist(), y(values[rows]).tolist(), strict=True)
        parts.append(line(list(points), colour, width))
    name = text(0, 0, title, size=12.5, anchor="middle")
    parts.append(f'<g transform="translate(14 {top + height / 2:.0f}) rotate(-90)">{name}</g>')
    return svg(WIDTH, top + height + 24, parts, title)


def joint_map(found: Differences) -> str:
    """Joints against signals: the distance of the distributions in shares of the reference's spread."""
    cell, left, row = 78, 130, 30
    parts = [text(left + cell * (j + 0.5), 16, name, size=13, anchor="middle") for j, name in enumerate(JOINT_NAMES)]
    for i, (name, unit) in enumerate(SIGNALS.items()):
        signal, y = found.signals[name], 26 + row * i
        parts.append(text(left - 10, y + 20, TITLES[name], size=13, anchor="end"))
        for j, joint in enumerate(JOINT_NAMES):
            share = float(signal.share[j])
            known = bool(np.isfinite(signal.distance[j]))
            tip = f"{TITLES[name]}, {joint}: not in both runs"
            if known:
                tip = (
                    f"{TITLES[name]}, {joint}\ndistance {signal.distance[j]:.3g} {unit}, {100 * share:.0f} % of the "
                    f"spread\nrms in step {signal.rms[j]:.3g} {unit}"
                )
            fill = heat(share / FULL_SHARE) if known else "var(--empty)"
            parts.append(rect(left + cell * j + 1, y, cell - 2, row - 2, fill, tip, radius=3))
            words, ink = (f"{100 * share:.0f}", on_heat(share / FULL_SHARE)) if known else ("–", "")
            parts.append(text(left + cell * (j + 0.5), y + 19, words, size=12, anchor="middle", fill=ink))
    return svg(left + cell * len(JOINT_NAMES), 30 + row * len(SIGNALS), parts, f"Differences of {found.name} by joint")


def gait(track: Track, colour: str, rows: slice) -> str:
    """Feet on the ground over a few seconds, one row a leg."""
    contact = track.foot_contact[rows]
    if contact.shape[1] != len(LEG_NAMES) or not len(contact):
        return ""
    row, width = 18, WIDTH - LEFT - RIGHT
    scale = width / len(contact)
    parts = []
    for leg, name in enumerate(LEG_NAMES):
        y = 4 + row * leg
        parts.append(text(LEFT - 8, y + 12, name, size=12, anchor="end"))
        parts.append(rect(LEFT, y, width, row - 4, "var(--empty)", radius=0))
        edges = np.flatnonzero(np.diff(np.concatenate([[0], contact[:, leg].astype(int), [0]])))
        parts += [
            rect(LEFT + scale * a, y, scale * (b - a), row - 4, colour, f"{name} on the ground", radius=0)
            for a, b in edges.reshape(-1, 2)
        ]
    return svg(WIDTH, 4 + row * len(LEG_NAMES), parts, f"Feet of {track.name} on the ground")


def liveliest(track: Track, span_s: float) -> slice:
    """The stretch of ``span_s`` in which the joints move most."""
    length = min(len(track), round(span_s / STEP_S))
    speed = np.nan_to_num(np.abs(track.velocity_rad_s).sum(axis=1))
    sums = np.concatenate([[0.0], np.cumsum(speed)])
    start = int(np.argmax(sums[length:] - sums[:-length]))
    return slice(start, start + length)
