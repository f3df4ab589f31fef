"""The pictures of a comparison: lines over time, a map of joints and signals, feet on the ground."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from compare.cause import Cause
from compare.differences import SIGNALS, TITLES, Differences
from compare.tracks import STEP_S, Array, Track
from spot_log.page.chart import Series, Shade, chart
from spot_log.page.svg import heat, on_heat, rect, svg, text
from spot_model.robot.facts import JOINT_NAMES

COLOURS: Final = ("var(--real)", "var(--nominal)", "var(--corrected)", "var(--floor)")
FULL_SHARE: Final = 1.0
"""Share of the reference's spread at which the map is darkest."""


def over_time(
    lines: Sequence[tuple[str, float, Array]],
    title: str,
    *,
    from_s: float = 0.0,
    height: float = 190,
    causes: Sequence[Cause] = (),
) -> str:
    """Lines on one axis of time.

    Args:
        lines: Colour, width and samples :data:`compare.tracks.STEP_S` apart, each of shape (n,).
        title: Of the vertical axis, with its unit.
        from_s: Time of the first sample.
        height: Of the plot.
        causes: Stretches that are shaded.
    """
    series = [Series(c, from_s + np.arange(len(v)) * STEP_S, v, width=w) for c, w, v in lines]
    end_s = from_s + max(len(v) for _, _, v in lines) * STEP_S
    shades = [Shade(max(c.start_s, from_s), min(c.end_s, end_s), c.text) for c in causes]
    return chart(series, title, x_unit=" s", height=height, shades=shades)


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
                    f"standard deviation\nrms in step {signal.rms[j]:.3g} {unit}"
                )
            fill = heat(share / FULL_SHARE) if known else "var(--empty)"
            parts.append(rect(left + cell * j + 1, y, cell - 2, row - 2, fill, tip, radius=3))
            words, ink = (f"{100 * share:.0f}", on_heat(share / FULL_SHARE)) if known else ("–", "")
            parts.append(text(left + cell * (j + 0.5), y + 19, words, size=12, anchor="middle", fill=ink))
    return svg(left + cell * len(JOINT_NAMES), 30 + row * len(SIGNALS), parts, f"Differences of {found.name} by joint")


def liveliest(track: Track, span_s: float) -> slice:
    """The stretch of ``span_s`` in which the joints move most."""
    length = min(len(track), round(span_s / STEP_S))
    speed = np.nan_to_num(np.abs(track.velocity_rad_s).sum(axis=1))
    sums = np.concatenate([[0.0], np.cumsum(speed)])
    start = int(np.argmax(sums[length:] - sums[:-length]))
    return slice(start, start + length)
