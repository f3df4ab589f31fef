"""Requested and measured torque at every state message."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from spot_model.robot import facts
from trainer.signals.recording import Recording
from trainer.signals.smoothing import eroded

Array = NDArray[np.float64]

SLOPE_WEIGHTS: Final = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
"""Slope in the middle of five neighbouring samples, per sample period; exact for polynomials up to the fourth degree.

A least-squares line would be three times less noisy, but 17 % short at 30 Hz: at a knee's reversal, where the largest
torques are, that is several N·m of inertia that would be taken for a limit.
"""
BEND_WEIGHTS: Final = np.array([2.0, -1.0, -2.0, -1.0, 2.0]) / 7.0
"""Second derivative of the least-squares parabola through them, per squared sample period."""
STOP_MARGIN_RAD: Final = 0.05
"""Nearer than this to a joint stop, the stop's own torque is in the load."""


@dataclass(frozen=True)
class TorqueSamples:
    """Rows of all runs; arrays of shape (n, 12) in canonical joint order."""

    run: NDArray[np.intp]
    """Which run a row comes from, shape (n,)."""
    state: NDArray[np.intp]
    """Number of the state within its run's stretch, shape (n,); rising within a run."""
    setpoint_rad: Array
    position_rad: Array
    velocity_rad_s: Array
    acceleration_rad_s2: Array
    """Slope of the measured velocity, from five samples."""
    jerk_rad_s3: Array
    """Its change, from the same five samples."""
    velocity_doubt_rad_s: Array
    """How far the velocity may have been from the measured one when the torque was made: half the largest second
    difference around the sample. Large in impacts.
    """
    kp_nm_per_rad: Array
    kd_nm_s_per_rad: Array
    load_nm: Array

    def __len__(self) -> int:
        return len(self.run)

    @property
    def request_nm(self) -> Array:
        """Torque that the servo's law asks for, before any limit."""
        return self.asked_nm(self.position_rad, self.velocity_rad_s)

    def asked_nm(self, position_rad: Array, velocity_rad_s: Array) -> Array:
        """The same of joints elsewhere, shape (n, 12)."""
        return self.kp_nm_per_rad * (self.setpoint_rad - position_rad) - self.kd_nm_s_per_rad * velocity_rad_s

    @property
    def is_off_the_stops(self) -> NDArray[np.bool_]:
        """Joints whose stops have no part in the load, shape (n, 12)."""
        above = self.position_rad > facts.POSITION_LOW_RAD + STOP_MARGIN_RAD
        below = self.position_rad < facts.POSITION_HIGH_RAD - STOP_MARGIN_RAD
        return np.asarray(above & below)

    def rows(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> TorqueSamples:
        """A selection of rows."""
        return replace(self, **{f.name: getattr(self, f.name)[index] for f in fields(self)})


def torque_samples(logs: Sequence[Recording]) -> TorqueSamples:
    """Collect the samples of logs, numbered in their order.

    Left out are the states before the first command, those by which a new set-point has just arrived (their load may
    still belong to the one before), those whose command is not in the log, and those without five neighbours at the
    stream's own period; and logs that do not say when commands were received.
    """
    parts = [_of_log(number, log) for number, log in enumerate(logs)]
    return TorqueSamples(**{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(TorqueSamples)})


def _of_log(number: int, log: Recording) -> TorqueSamples:
    n, commands, row = len(log), log.commands, log.command_row()
    known = (row >= 0) & log.has_receipts
    settled = np.zeros(n, dtype=np.bool_)
    acceleration, jerk, doubt = (np.zeros((n, facts.N_JOINTS)) for _ in range(3))
    if len(commands):
        setpoints = commands.position_rad[row]
        settled[1:] = known[:-1] & np.all(setpoints[1:] == setpoints[:-1], axis=1)
    if n >= len(SLOPE_WEIGHTS):
        windows = np.lib.stride_tricks.sliding_window_view(log.velocity_rad_s, len(SLOPE_WEIGHTS), axis=0)
        acceleration[2:-2] = windows @ SLOPE_WEIGHTS / log.period_s
        jerk[2:-2] = windows @ BEND_WEIGHTS / log.period_s**2
        bend = np.abs(np.diff(log.velocity_rad_s, n=2, axis=0)) / 2.0
        doubt[2:-2] = np.maximum.reduce([bend[:-2], bend[1:-1], bend[2:]])
    keep = known & settled & eroded(log.present, 2, 2) & np.isfinite(log.load_nm).all(axis=1)
    chosen = row[keep]
    return TorqueSamples(
        run=np.full(len(chosen), number, dtype=np.intp),
        state=np.flatnonzero(keep),
        setpoint_rad=commands.position_rad[chosen],
        position_rad=log.position_rad[keep],
        velocity_rad_s=log.velocity_rad_s[keep],
        acceleration_rad_s2=acceleration[keep],
        jerk_rad_s3=jerk[keep],
        velocity_doubt_rad_s=doubt[keep],
        kp_nm_per_rad=commands.kp_nm_per_rad[chosen],
        kd_nm_s_per_rad=commands.kd_nm_s_per_rad[chosen],
        load_nm=log.load_nm[keep],
    )
