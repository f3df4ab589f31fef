"""Channel *sensor noise*: noise of the joint sensors, over short blocks, beyond what is usual for a Spot.

Sixth differences leave nothing of a leg's motion; the lower quartile of their squares is blind to impacts and to the
steps of new set-points: that is the white noise. Knocks of a load, such as a gear's play makes, are what the upper
quartile has more, while little is asked for. The load's noise is that of the load less the servo law, where channel
*set-point to load* has it; without it there are no knocks, since nobody knows what was asked for.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelOff, ChannelView, Flags
from diagnosis.channels.drive.actuator import ActuatorSignals
from diagnosis.channels.stack import Stack

SIGNALS: Final = {"position": "position_rad", "velocity": "velocity_rad_s", "load": "load_nm", "knocks": "load_nm"}
"""The groups of rows, and what a log must have for each."""
USUAL: Final = np.array([4e-4, 0.06, 0.5])
"""Usual standard deviations, rad, rad/s, N·m: an encoder, its derivative with what motion leaks in, a strain gauge."""
BLOCK: Final = 128
ORDER: Final = 6
_BINOMIALS: Final = np.array([1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0])
GAIN: Final = float(np.sum(_BINOMIALS**2))
QUARTILE_OF_SQUARE: Final = 0.1015
UPPER_QUARTILE_OF_SQUARE: Final = 1.3233
"""Lower and upper quartile of the square of a standard normal number."""
LITTLE_NM: Final = 8.0
"""Under so much torque a load's knocks are counted: harder ones are a foot's."""
STEPS_TOO: Final = 2.0
"""Times what the steps of set-points leave in the torque that is asked for: the load follows them late."""
KNOCK_FLOOR: Final = 2.0
MIN_SAMPLES: Final = 24


def noise_view(stack: Stack, actuator: ActuatorSignals | None = None) -> ChannelView | ChannelOff:
    """Build the channel *sensor noise*, variances in units of the usual ones; ``actuator`` where that channel is on."""
    if not stack.has("position_rad"):
        return ChannelOff(Channel.SENSOR_NOISE, "no measured joint positions")
    n_joints = len(stack.joint_names)
    blocks, middles = [], []
    usable = stack.inner(stack.used, ORDER, ORDER)
    load = stack.filled(lambda r: r.load_nm) if actuator is None else actuator.load_nm - actuator.torque_nm
    joints = stack.filled(lambda r: np.concatenate([r.position_rad, r.velocity_rad_s], axis=1))
    square = _high_squares(np.concatenate([joints, load], axis=1))
    steps = _high_squares(actuator.torque_nm) if actuator is not None else None
    for start in range(0, stack.n - BLOCK, BLOCK):
        block = slice(start, start + BLOCK)
        good = usable[block]
        if good.sum() < BLOCK // 2:
            continue
        white = np.quantile(square[block][good], 0.25, axis=0) / QUARTILE_OF_SQUARE
        knocks = np.full(n_joints, np.nan)
        if actuator is not None and steps is not None:
            little = np.abs(actuator.torque_nm[block]) < LITTLE_NM
            high = square[block, 2 * n_joints :]
            knocks = _knocks(high, steps[block], little & good[:, None], white[2 * n_joints :])
        blocks.append(np.concatenate([white, knocks]))
        middles.append(start + BLOCK // 2)
    if not blocks:
        return ChannelOff(Channel.SENSOR_NOISE, "no stretch long enough")
    variance = np.stack(blocks)
    usual = np.repeat([*USUAL**2, USUAL[2] ** 2], n_joints)
    has = np.repeat([stack.has(signal) for signal in SIGNALS.values()], n_joints) & np.isfinite(variance)
    # A knock has no usual size: what is left of the steps is taken off already.
    beyond = np.repeat([1.0, 1.0, 1.0, 0.0], n_joints)
    response = np.maximum(np.nan_to_num(variance) / usual - beyond, 0.0)
    return stack.view(
        Channel.SENSOR_NOISE,
        np.array(middles),
        response,
        rows=tuple(f"{joint}_{group}" for group in SIGNALS for joint in stack.joint_names),
        unit="usual variances",
        usable=has,
        noise=np.repeat([1.0, 1.0, 1.0, KNOCK_FLOOR], n_joints),
        row_joint=np.tile(np.arange(n_joints), len(SIGNALS)),
        row_leg=np.tile(stack.legs, len(SIGNALS)),
        leg_of_joint=stack.legs,
        signals=None,
        is_robust=False,
    )


def _high_squares(values: Array) -> Array:
    """Squares of sixth differences, in units of a white signal's variance."""
    high = np.apply_along_axis(lambda x: np.convolve(x, _BINOMIALS, mode="same"), 0, values)
    return np.asarray(high**2 / GAIN)


def _knocks(load: Array, steps: Array, counted: Flags, white: Array) -> Array:
    """Variance of each joint's knocks in one block: upper quartile less white noise and the steps of set-points."""
    out = np.full(load.shape[1], np.nan)
    for joint, mine in enumerate(counted.T):
        if mine.sum() >= MIN_SAMPLES:
            upper, step = np.quantile(load[mine, joint], 0.75), np.quantile(steps[mine, joint], 0.75)
            out[joint] = max((upper - STEPS_TOO * step) / UPPER_QUARTILE_OF_SQUARE - white[joint], 0.0)
    return out
