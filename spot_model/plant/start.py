"""Start states of simulated runs, such as those of logged ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from spot_model.plant.plant import Plant
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.leg_kinematics import foot_position_in_body_m
from spot_model.robot.rotation import rotate_inverse_wxyz, rotate_wxyz

SETTLED_M: Final = 1e-6
"""The lowest foot starts so far in the ground: exactly on it, a GPU's rounding would decide whether it touches."""


@dataclass(frozen=True)
class StartState:
    """One robot at its first policy tick."""

    position_rad: Array
    """Shape (12,), canonical order."""
    velocity_rad_s: Array
    world_from_body_wxyz: Array
    linear_vel_of_body_in_world_m_s: Array
    angular_vel_of_body_in_world_rad_s: Array
    last_action: NDArray[np.float32]
    """Shape (12,), policy order."""


def standing_height_m(start: StartState) -> float:
    """Height of the body's origin at which the lowest foot just touches level ground."""
    feet = rotate_wxyz(start.world_from_body_wxyz[None, :], foot_position_in_body_m(start.position_rad))
    return float(facts.FOOT_RADIUS_M - np.min(np.asarray(feet)[..., 2]))


def put_at(plant: Plant, starts: Sequence[StartState]) -> NDArray[np.float32]:
    """Put each simulation into its start, on level ground; return the last actions, shape (n_sims, 12).

    Raises:
        ValueError: There is not one start a simulation.
    """

    def each(name: str) -> Array:
        return np.stack([getattr(start, name) for start in starts])

    height = np.array([standing_height_m(start) - SETTLED_M for start in starts])
    attitude = each("world_from_body_wxyz")
    attitude /= np.linalg.norm(attitude, axis=1, keepdims=True)
    plant.reset(
        position_of_body_in_world_m=np.stack([0.0 * height, 0.0 * height, height], axis=1),
        world_from_body_wxyz=attitude,
        joint_position_rad=each("position_rad"),
        linear_vel_of_body_in_world_m_s=each("linear_vel_of_body_in_world_m_s"),
        angular_vel_of_body_in_body_rad_s=np.asarray(
            rotate_inverse_wxyz(attitude, each("angular_vel_of_body_in_world_rad_s"))
        ),
        joint_velocity_rad_s=each("velocity_rad_s"),
    )
    return each("last_action").astype(np.float32)
