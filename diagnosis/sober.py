"""A last look at "no gap": logs whose loads plainly do not do what was asked cannot be said to have none."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from diagnosis.seam import Views
from diagnosis.verdict import Status

PLAIN_SHARE: Final = 0.3
"""A load's error of this share of the load, root mean square, is plain to see."""
NOTE: Final = (
    "loads differ from the servo law by {share:.0f} % of their size at half of the joints, in no way that repeats: "
    "these logs cannot tell why; record longer ones, each command sequence several times"
)


def sober(status: Status, views: Views) -> tuple[Status, str]:
    """The status, and a note where it had to change."""
    share = load_error_share(views)
    if status == "no_gap" and share > PLAIN_SHARE:
        return "cannot_tell", NOTE.format(share=100.0 * share)
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
