"""Channel *battery power*: the battery's power against what the joints' loads and speeds account for.

Time convention: voltage and current are means over a short time before the poll; the joints' power is averaged over the
same. Fitted beside any effect: the power of all but the motors, the mechanical power's efficiency, and copper loss.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelOff, ChannelView
from diagnosis.channels.stack import Stack

AVERAGE_S: Final = 0.05
FLOOR_W: Final = 10.0
MIN_POLLS: Final = 15


@dataclass(frozen=True)
class PowerSignals:
    """Signals of channel *battery power*."""

    stack: Stack
    rows: NDArray[np.intp]
    """Rows of the stack at the polls."""
    velocity_rad_s: Array
    load_nm: Array

    def finish(self, power_w: Array) -> Array:
        """A power of shape (N,) averaged as the battery's, at the polls; shape (n, 1)."""
        return averaged(self.stack, power_w)[self.rows][:, None]


def power_view(stack: Stack) -> ChannelView | ChannelOff:
    """Build the channel *battery power*."""
    if any(len(r.slow_states) == 0 for r in stack.recordings):
        return ChannelOff(Channel.BATTERY_POWER, "no battery record")
    if not all(r.has("load_nm") and r.has("velocity_rad_s") for r in stack.recordings):
        return ChannelOff(Channel.BATTERY_POWER, "no joint torques or velocities")
    first = stack.starts()
    rows, volts, amps, runs = [], [], [], []
    for number, recording in enumerate(stack.recordings):
        slow = recording.slow_states
        row = recording.rows_at(slow.robot_stamp_ns)
        good = np.isfinite(slow.battery_voltage_v) & np.isfinite(slow.battery_current_a) & (row > 40)
        rows.append(first[number] + row[good])
        volts.append(slow.battery_voltage_v[good])
        amps.append(-slow.battery_current_a[good])
        runs.append(np.full(int(good.sum()), number, dtype=np.intp))
    at, volt, ampere = np.concatenate(rows), np.concatenate(volts), np.concatenate(amps)
    if len(at) < MIN_POLLS or np.ptp(ampere) == 0.0:
        return ChannelOff(Channel.BATTERY_POWER, f"{len(at)} polls of the battery; {MIN_POLLS} that differ are needed")
    velocity, load = stack.filled(lambda r: r.velocity_rad_s), stack.filled(lambda r: r.load_nm)
    signals = PowerSignals(stack, at, velocity, load)
    mechanical = signals.finish(np.maximum(load * velocity, 0.0).sum(axis=1))
    squared = signals.finish((load**2).sum(axis=1))
    nuisance = np.stack([np.ones_like(mechanical), mechanical, squared], axis=2)
    power = volt * ampere
    fitted, *_ = np.linalg.lstsq(nuisance[:, 0], power, rcond=None)
    (open_v, slope), *_ = np.linalg.lstsq(np.stack([np.ones_like(ampere), ampere], axis=1), volt, rcond=None)
    none = np.full(1, -1, dtype=np.intp)
    return ChannelView(
        name=Channel.BATTERY_POWER,
        rows=("power",),
        unit="W",
        response=power[:, None],
        usable=stack.used[at][:, None],
        run=np.concatenate(runs),
        state=stack.state[at],
        noise=np.array([max(FLOOR_W, 1.4826 * float(np.median(np.abs(power - nuisance[:, 0] @ fitted))))]),
        nuisance=nuisance,
        row_joint=none,
        row_leg=none,
        leg_of_joint=np.full(velocity.shape[1], -1, dtype=np.intp),
        signals=signals,
        measured={
            "idle_power_w": float(fitted[0]),
            "mechanical_efficiency": float(1.0 / fitted[1]) if fitted[1] > 0.0 else float("nan"),
            "copper_w_per_nm2": float(fitted[2]),
            "open_voltage_v": float(open_v),
            "resistance_ohm": float(-slope),
            "largest_power_w": float(np.max(power)),
        },
    )


def averaged(stack: Stack, power_w: Array) -> Array:
    """Running mean with the battery's time constant, each recording by itself; shape (N,)."""
    keep = float(np.exp(-stack.period_s / AVERAGE_S))
    out = np.empty_like(power_w)
    for number in range(len(stack.recordings)):
        rows = stack.run == number
        out[rows] = lfilter([1.0 - keep], [1.0, -keep], power_w[rows])
    return out
