"""Channel *battery power*: the battery's power against what the joints' loads and speeds account for.

Time convention: voltage and current are means over a short time before the poll; the joints' power is averaged over the
same. Fitted beside any effect: the power of all but the motors, the mechanical power's efficiency, and copper loss.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.signal import lfilter

from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelOff, ChannelView
from diagnosis.channels.stack import Stack

AVERAGE_S: Final = 0.05
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
    if any(len(r.slow_states) == 0 for r in stack.recordings):
        return ChannelOff(Channel.BATTERY_POWER, "no battery record")
    if not stack.has("load_nm") or not stack.has("velocity_rad_s"):
        return ChannelOff(Channel.BATTERY_POWER, "no joint torques or velocities")
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
    velocity, load = stack.filled(lambda r: r.velocity_rad_s), stack.filled(lambda r: r.load_nm)
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
    keep = float(np.exp(-stack.period_s / AVERAGE_S))
    return stack.by_run(lambda part: lfilter([1.0 - keep], [1.0, -keep], part), power_w)
