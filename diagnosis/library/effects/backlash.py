"""Play in the gear: torque is missing while the motor crosses a gap, and it knocks where it arrives."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Final

import numpy as np

from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelView, Flags, Ints, Shape, Views
from diagnosis.channels.drive.actuator import ActuatorSignals
from diagnosis.library.base import ALL_OF_IT, Coefficient, LibraryEffect, on_joints
from diagnosis.library.experiments import SLOW_WALK, Experiment
from spot_model.effects.base import Effect, Motion
from spot_model.effects.drive.backlash import Backlash

GRID_RAD: Final = tuple(round(0.0008 * 1.2**i, 7) for i in range(24))
"""Widths that are tried, up to 0.053 rad; computed together, they cost little more than one."""
COARSE: Final = 4
GAP_PER_KNOCK_RAD: Final = 7.5e-4
"""Width of a gap by the variance of its knocks, in usual variances of a load; 6 to 9e-4 on three simulated robots.

A rotor that crosses a gap of twice the width arrives with twice the energy.
"""
SUBSTEPS: Final = 2
"""Steps of the motor's motion in the gap between two states."""


class BacklashEntry(LibraryEffect):
    """Torque missing while the motor crosses a gap after each reversal; knocks, and a load that rattles."""

    title: ClassVar[str] = "play in the gear"
    effect: ClassVar[type[Effect]] = Backlash
    channels: ClassVar[tuple[Channel, ...]] = (Channel.SET_POINT_TO_LOAD, Channel.SENSOR_NOISE)
    coefficients: ClassVar[tuple[Coefficient, ...]] = (
        ALL_OF_IT,
        Coefficient("knocks", "usual variances", 0.0, 40.0),
        Coefficient("rattle", "usual variances", 0.0, 40.0),
    )
    confused_with: ClassVar[tuple[str, ...]] = (
        "coulomb_friction",
        "torque_gain",
        "torque_bandwidth",
        "sensor_noise",
        "joint_compliance",
        "viscous_friction",
    )
    split_by: ClassVar[Experiment] = SLOW_WALK

    def shapes(self, views: Views, joints: Flags) -> tuple[Shape, ...]:
        """Widths of the gap."""
        return tuple({"gap_rad": g} for g in GRID_RAD[1::COARSE])

    def neighbours(self, shape: Shape) -> tuple[Shape, ...]:
        """Widths nearby."""
        at = GRID_RAD.index(shape["gap_rad"])
        return tuple({"gap_rad": GRID_RAD[i]} for i in (at - 2, at - 1, at + 1, at + 2) if 0 <= i < len(GRID_RAD))

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The torque that does not come through, by the simulator's own formula; knocks and noise of the load."""
        n_joints = len(joints)
        out = np.zeros((view.n, len(view.rows), 3))
        if view.name == Channel.SENSOR_NOISE:
            out[:, 3 * n_joints :, 1] = joints
            out[:, 2 * n_joints : 3 * n_joints, 2] = joints
            return out
        s: ActuatorSignals = view.signals
        if "backlash" not in s.cache:
            s.cache["backlash"] = passed_on_nm(s.torque_nm, np.array(GRID_RAD), s.stack.run, s.period_s)
        through: Array = s.cache["backlash"][GRID_RAD.index(shape["gap_rad"])]
        out[:, :, :1] = on_joints(s.finish(through - s.torque_nm), joints)
        return out

    def rows(self, view: ChannelView, joints: Flags) -> Flags:
        """The joints' own, in both channels."""
        return np.asarray(joints[view.row_joint])

    def show(self, views: Views) -> tuple[Channel, ...]:
        """Without channel *set-point to load* nobody knows what a load should be."""
        return super().show(views) if Channel.SET_POINT_TO_LOAD in views else ()

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Gap: from the missing torque, or from the knocks where they speak of a wider one."""
        return {"gap_rad": max(float(shape["gap_rad"]), GAP_PER_KNOCK_RAD * float(coefficients[1]))}


def passed_on_nm(torque_nm: Array, gap_rad: Array, run: Ints, period_s: float) -> Array:
    """The torque that gaps let through, by the simulator's formula, all recordings at once.

    Args:
        torque_nm: Torque of the motor. Shape (N, J).
        gap_rad: Widths. Shape (G,).
        run: Recording of each row, rising. Shape (N,).
        period_s: Time between rows.

    Returns:
        Shape (G, N, J), in single precision: it is large.
    """
    numbers, starts, sizes = np.unique(run, return_index=True, return_counts=True)
    longest, n_joints, n_gaps = int(sizes.max()), torque_nm.shape[1], len(gap_rad)
    # One simulation a recording, joints side by side; short ones end with zeros.
    padded = np.zeros((longest, len(numbers), n_joints))
    for i, (start, size) in enumerate(zip(starts, sizes, strict=True)):
        padded[:size, i] = torque_nm[start : start + size]
    whole = np.empty((n_gaps, len(numbers), n_joints))
    effect = Backlash(gap_rad=gap_rad[:, None, None]).arrays_like(whole)
    memory = effect.start(whole)
    out = np.empty((longest, *whole.shape), dtype=np.float32)
    for k in range(longest):
        whole[:] = padded[k]
        motion = Motion(whole, whole, period_s / SUBSTEPS)
        # The load at a state is that of the last step before it.
        for _ in range(SUBSTEPS):
            passed, memory = effect.torque(whole, motion, memory)
        out[k] = passed
    result = np.empty((n_gaps, *torque_nm.shape), dtype=np.float32)
    for i, (start, size) in enumerate(zip(starts, sizes, strict=True)):
        result[:, start : start + size] = np.swapaxes(out[:size, :, i], 0, 1)
    return result
