"""Channel N: white noise of the joint sensors, over short blocks, beyond what is usual for a Spot.

Sixth differences leave nothing of a leg's motion; the lower quartile of their squares is blind to impacts and to the
steps of new set-points. The load's noise is that of the load less the servo law, where channel A has it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from diagnosis.channels.actuator import ActuatorSignals, leg_of_joint
from diagnosis.channels.stack import Stack
from diagnosis.recording import Recording
from diagnosis.seam import Array, ChannelOff, ChannelView

SIGNALS: Final = ("position", "velocity", "load")
USUAL: Final = np.array([4e-4, 0.06, 0.5])
"""Usual standard deviations, rad, rad/s, N·m: an encoder, its derivative with what motion leaks in, a strain gauge."""
BLOCK: Final = 128
ORDER: Final = 6
_BINOMIALS: Final = np.array([1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0])
GAIN: Final = float(np.sum(_BINOMIALS**2))
QUARTILE_OF_SQUARE: Final = 0.1015
"""Lower quartile of the square of a standard normal number."""


@dataclass(frozen=True)
class NoiseSignals:
    """Signals of channel N."""

    sigma: Array
    """Standard deviation by block, position, velocity and load in turn, joints within. Shape (n, 3 J)."""


def noise_view(stack: Stack, actuator: ActuatorSignals | None = None) -> ChannelView | ChannelOff:
    """Build channel N; response and columns are variances in units of the usual ones.

    Args:
        stack: The recordings.
        actuator: Channel A's signals, where it is on.
    """
    parts: tuple[Callable[[Recording], Array], ...] = (
        lambda r: r.position_rad,
        lambda r: r.velocity_rad_s,
        lambda r: r.load_nm,
    )
    if not all(r.has("position_rad") for r in stack.recordings):
        return ChannelOff("N", "no measured joint positions")
    n_joints = stack.recordings[0].n_joints
    rows = tuple(f"{joint}_{signal}" for signal in SIGNALS for joint in stack.recordings[0].joint_names)
    blocks, runs, states = [], [], []
    usable = stack.inner(stack.used, ORDER, ORDER)
    starts = np.arange(0, stack.n - BLOCK, BLOCK)
    values = np.concatenate([stack.filled(part) for part in parts], axis=1)
    if actuator is not None:
        values[:, 2 * n_joints :] = actuator.load_nm - actuator.torque_nm
    high = np.apply_along_axis(lambda x: np.convolve(x, _BINOMIALS, mode="same"), 0, values)
    for start in starts:
        block = slice(start, start + BLOCK)
        good = usable[block]
        if good.sum() < BLOCK // 2:
            continue
        square = np.quantile(high[block][good] ** 2, 0.25, axis=0) / (QUARTILE_OF_SQUARE * GAIN)
        blocks.append(square)
        middle = start + BLOCK // 2
        runs.append(stack.run[middle])
        states.append(stack.state[middle])
    if not blocks:
        return ChannelOff("N", "no stretch long enough")
    variance = np.stack(blocks)
    usual = np.repeat(USUAL**2, n_joints)
    has = np.repeat(
        [all(r.has(name) for r in stack.recordings) for name in ("position_rad", "velocity_rad_s", "load_nm")], n_joints
    )
    legs = leg_of_joint(stack.recordings[0].joint_names, stack.recordings[0].foot_names)
    response = np.maximum(variance / usual - 1.0, 0.0)
    return ChannelView(
        name="N",
        rows=rows,
        unit="usual variances",
        response=response,
        usable=np.broadcast_to(has, response.shape).copy(),
        run=np.array(runs, dtype=np.intp),
        state=np.array(states, dtype=np.intp),
        noise=np.ones(len(rows)),
        nuisance=np.zeros((*response.shape, 0)),
        row_joint=np.tile(np.arange(n_joints, dtype=np.intp), len(SIGNALS)),
        row_leg=np.tile(legs, len(SIGNALS)),
        leg_of_joint=legs,
        signals=NoiseSignals(np.sqrt(variance)),
        is_robust=False,
    )
