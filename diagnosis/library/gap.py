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

COARSE_RAD: Final = (0.001, 0.002, 0.004, 0.008, 0.016, 0.032)
FACTORS: Final = (0.6, 0.75, 0.87, 1.15, 1.33, 1.6)
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
        _remember(views["A"].signals, COARSE_RAD)
        return tuple({"gap_rad": g} for g in COARSE_RAD)

    def neighbours(self, shape: Shape) -> tuple[Shape, ...]:
        """Widths nearby."""
        return tuple({"gap_rad": shape["gap_rad"] * f} for f in FACTORS)

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The torque that does not come through, by the simulator's own formula on the requested torque."""
        s: ActuatorSignals = view.signals
        gap_rad = float(shape["gap_rad"])
        if ("backlash", gap_rad) not in s.cache:
            _remember(s, (gap_rad, *(gap_rad * f for f in FACTORS)))
        through: Array = s.cache["backlash", gap_rad]
        return on_joints(s.finish(through - s.torque_nm), joints)

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Gap."""
        return {"gap_rad": float(shape["gap_rad"])}


def _remember(s: ActuatorSignals, gaps_rad: tuple[float, ...]) -> None:
    """Put what several gaps let through into the cache: together they cost little more than one."""
    new = [g for g in dict.fromkeys(gaps_rad) if ("backlash", g) not in s.cache]
    if new:
        found = passed_on_nm(s.torque_nm, np.array(new), s.stack.run, s.period_s)
        for gap_rad, through in zip(new, found, strict=True):
            s.cache["backlash", gap_rad] = through


def passed_on_nm(torque_nm: Array, gap_rad: Array, run: Ints, period_s: float) -> Array:
    """The torque that gaps let through, by the simulator's formula, all recordings at once.

    Args:
        torque_nm: Torque of the motor. Shape (N, J).
        gap_rad: Widths. Shape (G,).
        run: Recording of each row, rising. Shape (N,).
        period_s: Time between rows.

    Returns:
        Shape (G, N, J).
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
    out = np.empty((longest, *whole.shape))
    for k in range(longest):
        whole[:] = padded[k]
        motion = Motion(whole, whole, period_s / SUBSTEPS)
        # The load at a state is that of the last step before it.
        for _ in range(SUBSTEPS):
            out[k], memory = effect.torque(whole, motion, memory)
    result = np.empty((n_gaps, *torque_nm.shape))
    for i, (start, size) in enumerate(zip(starts, sizes, strict=True)):
        result[:, start : start + size] = np.swapaxes(out[:size, :, i], 0, 1)
    return result
