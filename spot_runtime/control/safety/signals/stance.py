"""Joints, loads and gravity of a robot that stands: its feet lie in a plane, and the forces on them carry it.

A joint that is mirrored, taken for another or far from where it is said to be breaks that balance.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np

from spot_model.robot import facts
from spot_model.robot.state import Array
from spot_runtime.control.safety.signals import bounds
from spot_runtime.control.safety.signals.legs import foot_jacobians, ground_forces_n
from spot_runtime.control.safety.signals.window import Window
from spot_runtime.control.safety.values import is_between

_DIAGONALS: Final = np.array([facts.end_sign(leg) * facts.side_sign(leg) for leg in facts.LEG_NAMES])


class Stance(NamedTuple):
    """What joints and loads say of a robot that stands; forces as shares of its weight."""

    carried: float
    """Upward force on all feet."""
    pulled: float
    """Largest downward force on a foot; negative where the ground pushes each of them up."""
    sideways: float
    """Sum of the forces along the ground, of which a robot at rest has none."""
    pressing: float
    """Largest force along the ground on a foot beyond what friction holds."""
    twist_m: float
    """Height of the feet of one diagonal over those of the other, both feet added; 0 where the four lie in a plane."""

    @property
    def is_possible(self) -> bool:
        """Whether a robot can stand so."""
        return (
            bounds.CARRIED_LEAST <= self.carried <= bounds.CARRIED_MOST
            and self.pulled <= bounds.PULL_SHARE
            and self.sideways <= bounds.NET_SIDEWAYS_SHARE
            and self.pressing <= bounds.FOOT_ERROR_SHARE
            and abs(self.twist_m) <= bounds.TWIST_M
        )


def stance_of(position_rad: Array, load_nm: Array, up: Array) -> Stance:
    """What these joint positions and loads, both of shape (12,), mean with ``up`` as the vertical in the body's frame.

    Loads that are all zero are not reported; then the feet's plane alone is judged.
    """
    feet_m, _ = foot_jacobians(position_rad)
    twist_m = float(_DIAGONALS @ (feet_m @ up))
    if not load_nm.any():
        return Stance(1.0, -0.25, 0.0, 0.0, twist_m)
    forces_n = ground_forces_n(position_rad, load_nm)
    carried_n = forces_n @ up
    along_n = forces_n - np.outer(carried_n, up)
    pressing_n = np.linalg.norm(along_n, axis=1) - bounds.SIDEWAYS_SHARE * np.maximum(carried_n, 0.0)
    return Stance(
        float(carried_n.sum()) / bounds.WEIGHT_N,
        -float(carried_n.min()) / bounds.WEIGHT_N,
        float(np.linalg.norm(along_n.sum(axis=0))) / bounds.WEIGHT_N,
        float(pressing_n.max()) / bounds.WEIGHT_N,
        twist_m,
    )


def is_stance_wrong(window: Window) -> bool:
    """Whether a robot cannot stand as its joints and loads say."""
    return not stance_of(window.last.position_rad, window.last.load_nm, window.odom_from_body[2]).is_possible


def explanations(window: Window) -> tuple[str, ...]:
    """Single errors of joint positions after which a wrong stance would be possible, in words."""
    state, up = window.last, window.odom_from_body[2]
    return tuple(
        words
        for words, position_rad in _changed(state.position_rad)
        if is_between(position_rad, position_rad) and stance_of(position_rad, state.load_nm, up).is_possible
    )


def _changed(position_rad: Array) -> Iterator[tuple[str, Array]]:
    joints = range(facts.N_JOINTS)
    groups = [[joint] for joint in joints] + [list(joints)[kind::3] for kind in range(3)]
    for group in groups:
        mirrored = position_rad.copy()
        mirrored[group] *= -1.0
        yield f"{', '.join(facts.JOINT_NAMES[joint] for joint in group)} mirrored", mirrored
    for a, b in combinations(joints, 2):
        exchanged = position_rad.copy()
        exchanged[[a, b]] = position_rad[[b, a]]
        yield f"{facts.JOINT_NAMES[a]} and {facts.JOINT_NAMES[b]} exchanged", exchanged
