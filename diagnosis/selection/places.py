"""Where an effect can act: its units (joints, legs or the robot) and the sets of them that are tried."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from diagnosis.channels.channel_view import Array, Flags, Ints
from diagnosis.library.base import LibraryEffect, Location


@dataclass(frozen=True)
class Robot:
    """Joints of the robot, in groups."""

    joint_names: tuple[str, ...]
    leg_of_joint: Ints
    """Shape (J,), -1 for none."""

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    def types(self) -> dict[str, Flags]:
        """Joints by what stands after the last underscore of their names, each shape (J,)."""
        ends = [name.rsplit("_", 1)[-1] for name in self.joint_names]
        return {end: np.array([e == end for e in ends]) for end in dict.fromkeys(ends)}

    def units(self, location: Location) -> Array:
        """Joints of each unit, shape (U, J), 0 or 1."""
        if location is Location.ROBOT:
            return np.ones((1, self.n_joints))
        if location is Location.LEG:
            legs = [leg for leg in np.unique(self.leg_of_joint) if leg >= 0]
            if legs:
                return np.array([(self.leg_of_joint == leg).astype(np.float64) for leg in legs])
            return np.ones((1, self.n_joints))
        return np.eye(self.n_joints)

    def places(self, effect: LibraryEffect) -> Array:
        """Sets of units that are tried first, shape (L, U), 0 or 1, each once."""
        units = self.units(effect.location)
        n = len(units)
        if effect.location is Location.ROBOT:
            return np.ones((1, 1))
        if effect.singly:
            return np.eye(n)
        sets = [np.ones(n), *np.eye(n)]
        if effect.location is Location.JOINT:
            types = list(self.types().values())
            sets += [t.astype(np.float64) for t in types]
            sets += [(types[i] | types[j]).astype(np.float64) for i in range(len(types)) for j in range(i)]
            sets += list(self.units(Location.LEG)) if self.leg_of_joint.max(initial=-1) >= 0 else []
            legs = self.leg_of_joint
            sets += [(t & np.isin(legs, pair)).astype(np.float64) for t in types for pair in PAIRS]
        sets += [np.isin(np.arange(n), pair).astype(np.float64) for pair in PAIRS] if n == N_LEGS else []
        return np.unique(np.array([s for s in sets if s.any()]), axis=0)

    def joints_of(self, effect: LibraryEffect, place: Array) -> Flags:
        """Joints of a set of units, shape (J,)."""
        return np.asarray(place @ self.units(effect.location) > 0.5)

    def named(self, joints: Flags) -> tuple[str, ...]:
        """Names of joints."""
        return tuple(name for name, there in zip(self.joint_names, joints, strict=True) if there)


N_LEGS = 4
PAIRS: Sequence[tuple[int, int]] = ((0, 1), (2, 3), (0, 2), (1, 3))
"""Front, hind, left and right legs, where there are four in the canonical order."""
