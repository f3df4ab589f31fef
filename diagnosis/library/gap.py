"""Play in the gear: torque is missing while the motor crosses a gap."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Final

import numpy as np

from diagnosis.channels.actuator import ActuatorSignals
from diagnosis.library.base import Coefficient, LibraryEffect, on_joints
from diagnosis.library.drive import ALL_OF_IT
from diagnosis.library.experiments import SLOW_WALK, Experiment
from diagnosis.seam import Array, ChannelView, Flags, Ints, Shape, Views
from spot_model.effects.backlash import Backlash
from spot_model.effects.base import Effect, Motion

SUBSTEPS: Final = 2
"""Steps of the motor's motion in the gap between two states."""


class BacklashEntry(LibraryEffect):
    """Torque missing while the motor crosses a gap after each reversal."""

    name: ClassVar[str] = "backlash"
    title: ClassVar[str] = "play in the gear"
    effect: ClassVar[type[Effect]] = Backlash
    channels: ClassVar[tuple[str, ...]] = ("A",)
    coefficients: ClassVar[tuple[Coefficient, ...]] = (ALL_OF_IT,)
    confused_with: ClassVar[tuple[str, ...]] = ("coulomb_friction", "torque_gain", "torque_bandwidth")
    split_by: ClassVar[Experiment] = SLOW_WALK

    def shapes(self, views: Views, joints: Flags) -> tuple[Shape, ...]:
        """Widths of the gap."""
        return tuple({"gap_rad": g} for g in (0.001, 0.002, 0.004, 0.008, 0.016, 0.032))

    def neighbours(self, shape: Shape) -> tuple[Shape, ...]:
        """Widths nearby."""
        return tuple({"gap_rad": shape["gap_rad"] * f} for f in (0.6, 0.75, 0.87, 1.15, 1.33, 1.6))

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The torque that does not come through, by the simulator's own formula on the requested torque."""
        s: ActuatorSignals = view.signals
        gap_rad = float(shape["gap_rad"])
        key = ("backlash", gap_rad)
        if key not in s.cache:
            s.cache[key] = passed_on_nm(s.torque_nm, gap_rad, s.stack.run, s.period_s)
        through: Array = s.cache[key]
        return on_joints(s.finish(through - s.torque_nm), joints)

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Gap."""
        return {"gap_rad": float(shape["gap_rad"])}


def passed_on_nm(torque_nm: Array, gap_rad: float, run: Ints, period_s: float) -> Array:
    """The torque that a gap lets through, by the simulator's formula, all recordings at once.

    Args:
        torque_nm: Torque of the motor. Shape (N, J).
        gap_rad: Width of the gap.
        run: Recording of each row, rising. Shape (N,).
        period_s: Time between rows.
    """
    numbers, starts, sizes = np.unique(run, return_index=True, return_counts=True)
    longest = int(sizes.max())
    n_joints = torque_nm.shape[1]
    # One simulation a recording, joints side by side; short ones end with zeros.
    padded = np.zeros((longest, len(numbers), n_joints))
    for i, (start, size) in enumerate(zip(starts, sizes, strict=True)):
        padded[:size, i] = torque_nm[start : start + size]
    effect = Backlash(gap_rad=gap_rad).arrays_like(padded[0])
    memory = effect.start(padded[0])
    motion = Motion(padded[0], padded[0], period_s / SUBSTEPS)
    out = np.empty_like(padded)
    for k in range(longest):
        # The load at a state is that of the last step before it.
        for _ in range(SUBSTEPS):
            out[k], memory = effect.torque(padded[k], motion, memory)
    result = np.empty_like(torque_nm)
    for i, (start, size) in enumerate(zip(starts, sizes, strict=True)):
        result[start : start + size] = out[:size, i]
    return result
