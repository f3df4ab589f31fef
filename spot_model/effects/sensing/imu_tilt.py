"""A tilted inertial unit: attitude and turn rates are reported in a tilted frame."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from spot_model.effects.base import BodyEstimate, Draws, EstimateEffect, JointReading, Memory, parameter
from spot_model.robot.arrays import namespace_of
from spot_model.robot.rotation import AnyArray, multiply_wxyz, rotate_inverse_wxyz


@dataclass(frozen=True, kw_only=True)
class ImuTilt(EstimateEffect):
    """The body frame that the estimator believes in is the true one, rolled and pitched.

    Source: mounting tolerances, 0.5 to 3 degrees.
    """

    name: ClassVar[str] = "imu_tilt"

    roll_rad: Any = parameter(null=0.0, low=-0.3, high=0.3, unit="rad", source="0.01 to 0.05 rad")
    pitch_rad: Any = parameter(null=0.0, low=-0.3, high=0.3, unit="rad", source="0.01 to 0.05 rad")

    def estimate(
        self, estimate: BodyEstimate, joints: JointReading, dt_s: float, memory: Memory, rng: Draws
    ) -> tuple[BodyEstimate, Memory]:
        """Tilt attitude, turn rates and velocity."""
        body_from_imu = self._body_from_imu_wxyz
        linear = rotate_inverse_wxyz(body_from_imu, estimate.linear_vel_of_body_in_body_m_s)
        angular = rotate_inverse_wxyz(body_from_imu, estimate.angular_vel_of_body_in_body_rad_s)
        tilted = dataclasses.replace(
            estimate,
            world_from_body_wxyz=multiply_wxyz(estimate.world_from_body_wxyz, body_from_imu),
            angular_vel_of_body_in_body_rad_s=angular,
            linear_vel_of_body_in_body_m_s=linear,
        )
        return tilted, memory

    @cached_property
    def _body_from_imu_wxyz(self) -> AnyArray:
        """The tilt, shape (1, 4) or (n, 4)."""
        xp = namespace_of(self.roll_rad)
        roll, pitch = xp.broadcast_arrays(0.5 * self.roll_rad, 0.5 * self.pitch_rad)
        zero = xp.zeros_like(roll)
        about_x = xp.concat([xp.cos(roll), xp.sin(roll), zero, zero], axis=1)
        about_y = xp.concat([xp.cos(pitch), zero, xp.sin(pitch), zero], axis=1)
        return multiply_wxyz(about_x, about_y)
