"""A last look at the status: plain errors of the loads are no "no gap", and what widens the gap does not explain it."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from diagnosis.seam import Views
from diagnosis.verdict import Shrink, Status

PLAIN_SHARE: Final = 0.3
"""A load's error of this share of the load, root mean square, is plain to see."""
NOTE: Final = (
    "loads differ from the servo law by {share:.0f} % of their size at half of the joints, in no way that repeats: "
    "these logs cannot tell why; record longer ones, each command sequence several times"
)
WIDER: Final = 0.5
"""Floors by which closed loops must be farther off with a model than without, to say that it widens the gap."""
WIDENS: Final = (
    "closed loops with the stated effects are farther from the robot ({after:.1f} floors) than without ({before:.1f}): "
    "they show in the logs, but their values are off or something that acts with them is missing; "
    "do not train on this model"
)


def sober(status: Status, views: Views, shrink: Shrink | None) -> tuple[Status, str]:
    """The status, and a note where it had to change.

    Args:
        status: What the probabilities say.
        views: The channels.
        shrink: Of the stated model; None where nothing was simulated.
    """
    share = load_error_share(views)
    if status == "no_gap" and share > PLAIN_SHARE:
        return "cannot_tell", NOTE.format(share=100.0 * share)
    if status == "explained" and shrink is not None and shrink.floor > 0.0:
        before, after = shrink.d0 / shrink.floor, shrink.d1 / shrink.floor
        if after > before + WIDER:
            return "partly_explained", WIDENS.format(before=before, after=after)
    return status, ""


def load_error_share(views: Views) -> float:
    """Channel A's residual over the load, root mean square, the median joint's; 0 without the channel."""
    view = views.get("A")
    if view is None:
        return 0.0
    signals: Any = view.signals
    load = signals.finish(signals.load_nm)
    shares = []
    for row in range(view.response.shape[1]):
        rows = view.usable[:, row]
        size = float(np.sqrt(np.mean(load[rows, row] ** 2))) if rows.any() else 0.0
        # Under this a joint carries next to nothing, and its error is the sensor's.
        if size > 5.0 * view.noise[row]:
            shares.append(float(np.sqrt(np.mean(view.response[rows, row] ** 2))) / size)
    return float(np.median(shares)) if shares else 0.0
