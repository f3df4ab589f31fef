"""Where the gap lies without a closed loop: how far the nominal model mispredicts logged loads and motion."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Views
from diagnosis.document import GapCell
from diagnosis.verdict.explain import Explained

SIGNALS: Final = {Channel.SET_POINT_TO_LOAD: "load error", Channel.LOAD_TO_MOTION: "torque error of swinging legs"}
MEAN_OF_NORMAL: Final = float(np.sqrt(2.0 / np.pi))
"""Mean size of a normal variable over its standard deviation."""


def open_loop_cells(found: Explained) -> tuple[GapCell, ...]:
    """By joint, mean size of the prediction's error against what sensors' noise alone makes; largest ratio first."""
    out = []
    for channel, signal in SIGNALS.items():
        view = found.views.get(channel)
        if view is None:
            continue
        for row in range(view.response.shape[1]):
            good = view.usable[:, row] & np.isfinite(view.response[:, row])
            if not good.any() or view.row_joint[row] < 0:
                continue
            gap = float(np.mean(np.abs(view.response[good, row])))
            floor = MEAN_OF_NORMAL * float(view.noise[row])
            out.append(
                GapCell(
                    signal=signal,
                    joint=found.board.robot.joint_names[view.row_joint[row]],
                    regime="all",
                    gap=gap,
                    floor=floor,
                    ratio=gap / floor if floor > 0.0 else None,
                    p_value=None,
                    unit=view.unit,
                    n_samples=int(good.sum()),
                )
            )
    return tuple(sorted(out, key=lambda c: -(c.ratio or 0.0)))


def load_error_share(views: Views) -> float:
    """Load error over load, root mean square, the median joint's; 0 without *set-point to load*."""
    view = views.get(Channel.SET_POINT_TO_LOAD)
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
