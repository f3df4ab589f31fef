"""Channels of the joint sensors and of the battery.

Channel *joint rates*: reported joint velocities against the derivative of reported positions, joint by joint.

Time convention: position and velocity of one state belong to one instant, but for a given offset of the velocity, half
of the load's lag: over the step that ends at a state, a discrete servo and its motion have one mean velocity.

Channel *sensor noise*: noise of the joint sensors, over short blocks, beyond what is usual for a Spot.

Sixth differences leave nothing of a leg's motion; the lower quartile of their squares is blind to impacts and to the
steps of new set-points: that is the white noise. Knocks of a load, such as a gear's play makes, are what the upper
quartile has more, while little is asked for. The load's noise is that of the load less the servo law, where channel
*set-point to load* has it; without it there are no knocks, since nobody knows what was asked for.

Channel *battery power*: the battery's power against what the joints' loads and speeds account for.

Time convention: voltage and current are means over a short time before the poll; the joints' power is averaged over the
same. Fitted beside any effect: the power of all but the motors, the mechanical power's efficiency, and copper loss.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.signal import lfilter

from diagnosis.channels import Array, Channel, ChannelOff, ChannelView, Flags, Ints
from diagnosis.channels.actuator import ActuatorSignals
from diagnosis.channels.stack import Stack
from trainer.signals.smoothing import smooth

RATE_STRIDE: Final = 2
FLOOR_RAD_S: Final = 0.02


@dataclass(frozen=True)
class RateSignals:
    """Signals of channel *joint rates*."""

    stack: Stack
    stride: int = RATE_STRIDE
    """Every so many rows one is kept."""

    def thinned(self, apart: int) -> tuple[RateSignals, slice]:
        """Signals of rows ``apart`` states from each other, or a little less, and these rows."""
        every = max(1, apart // self.stride)
        return replace(self, stride=self.stride * every), slice(None, None, every)

    def finish_rate(self, raw: Array) -> Array:
        """The derivative of (N, J) as the channel's rows have it."""
        return self.stack.rate(raw, slice(None, None, self.stride))


def rate_view(stack: Stack, velocity_age_s: float) -> ChannelView:
    """Build the channel *joint rates*; by convention a reported velocity is so much older than its stamp."""
    velocity, position = stack.states.velocity_rad_s, stack.states.position_rad
    kept, n_joints = slice(None, None, RATE_STRIDE), velocity.shape[1]
    response = (smooth(velocity) + velocity_age_s * stack.rate(velocity) - stack.rate(position))[kept]
    return stack.joint_view(
        Channel.JOINT_RATES,
        kept,
        response,
        stack.legs,
        unit="rad/s",
        usable=np.repeat(stack.inner(stack.used)[kept, None], n_joints, axis=1),
        noise=np.full(n_joints, FLOOR_RAD_S),
        signals=RateSignals(stack),
    )


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
MIN_SAMPLES: Final = 24
BEYOND: Final = 1e300
"""In place of a square that does not count."""


def noise_view(stack: Stack, actuator: ActuatorSignals | None) -> ChannelView | ChannelOff:
    """Build the channel *sensor noise*, variances in units of the usual ones; ``actuator`` where that channel is on."""
    n_joints = len(stack.joint_names)
    blocks, middles = [], []
    usable = stack.inner(stack.used, ORDER, ORDER)
    load = stack.states.load_nm if actuator is None else actuator.load_nm - actuator.torque_nm
    square = _high_squares(np.concatenate([stack.states.position_rad, stack.states.velocity_rad_s, load], axis=1))
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
        noise=np.repeat([1.0, 1.0, 1.0, 2.0], n_joints),
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
    enough, none = counted.sum(axis=0) >= MIN_SAMPLES, np.full(load.shape[1], np.nan)
    if not enough.any():
        return none
    upper, step = (_upper_quartile(np.where(counted, x, BEYOND), counted.sum(axis=0)) for x in (load, steps))
    return np.where(enough, np.maximum((upper - STEPS_TOO * step) / UPPER_QUARTILE_OF_SQUARE - white, 0.0), none)


def _upper_quartile(values: Array, counts: Ints) -> Array:
    """Upper quartile of the smallest ``counts`` values of each column, shapes (m, J) and (J,) to (J,)."""
    at, ordered = 0.75 * (np.maximum(counts, 1) - 1), np.sort(values, axis=0)
    below = at.astype(np.intp)
    low, high = (np.take_along_axis(ordered, row[None], axis=0)[0] for row in (below, np.minimum(below + 1, counts)))
    return np.asarray(low + (at - below) * (high - low))


FLOOR_W: Final = 10.0
MIN_POLLS: Final = 15


@dataclass(frozen=True)
class PowerSignals:
    """What the battery tells of the supply."""

    open_voltage_v: float
    resistance_ohm: float
    copper_w_per_nm2: float


def power_view(stack: Stack) -> ChannelView | ChannelOff:
    """Build the channel *battery power*."""
    rows, volts, amps = [], [], []
    for first, recording in zip(stack.starts(), stack.recordings, strict=True):
        slow = recording.slow_states
        row = recording.rows_at(slow.robot_stamp_ns)
        good = np.isfinite(slow.battery_voltage_v) & np.isfinite(slow.battery_current_a) & (row > 40)
        rows.append(first + row[good])
        volts.append(slow.battery_voltage_v[good])
        amps.append(-slow.battery_current_a[good])
    at, volt, ampere = np.concatenate(rows), np.concatenate(volts), np.concatenate(amps)
    if len(at) < MIN_POLLS or np.ptp(ampere) == 0.0:
        return ChannelOff(Channel.BATTERY_POWER, f"{len(at)} polls of the battery; {MIN_POLLS} that differ are needed")
    velocity, load = stack.states.velocity_rad_s, stack.states.load_nm
    mechanical = averaged(stack, np.maximum(load * velocity, 0.0).sum(axis=1))[at]
    squared = averaged(stack, (load**2).sum(axis=1))[at]
    beside = np.stack([np.ones_like(mechanical), mechanical, squared], axis=1)
    power = volt * ampere
    fitted, *_ = np.linalg.lstsq(beside, power, rcond=None)
    (open_v, slope), *_ = np.linalg.lstsq(np.stack([np.ones_like(ampere), ampere], axis=1), volt, rcond=None)
    return stack.view(
        Channel.BATTERY_POWER,
        at,
        power[:, None],
        rows=("power",),
        unit="W",
        usable=stack.used[at][:, None],
        noise=np.array([max(FLOOR_W, 1.4826 * float(np.median(np.abs(power - beside @ fitted))))]),
        nuisance=beside[:, None],
        signals=PowerSignals(float(open_v), float(-slope), float(fitted[2])),
    )


def averaged(stack: Stack, power_w: Array) -> Array:
    """Running mean with the battery's time constant, each recording by itself; shape (N,)."""
    keep = float(np.exp(-stack.period_s / 0.05))
    return stack.by_run(lambda part: lfilter([1.0 - keep], [1.0, -keep], part), power_w)
