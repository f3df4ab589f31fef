"""What the state estimator reports of the body: velocity, attitude and contact."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from spot_model.effects.base import BodyEstimate, Draws, EstimateEffect, JointReading, Memory, parameter
from spot_model.effects.joint_sensors import low_pass
from spot_model.robot.arrays import namespace_of
from spot_model.robot.rotation import AnyArray, multiply_wxyz, rotate_inverse_wxyz


@dataclass(frozen=True, kw_only=True)
class VelocityEstimate(EstimateEffect):
    """Reported v_x, v_y, v_z = scale · low-pass(v) + bias (x and y).

    Source: legged odometry, 2 to 10 % of scale, 0.02 to 0.1 m/s of bias, 10 to 40 ms of lag.
    """

    name: ClassVar[str] = "velocity_estimate"

    scale: Any = parameter(null=1.0, low=0.3, high=2.0, unit="1", source="0.9 to 1.1")
    bias_x_m_s: Any = parameter(null=0.0, low=-1.0, high=1.0, unit="m/s", source="0.02 to 0.1 m/s")
    bias_y_m_s: Any = parameter(null=0.0, low=-1.0, high=1.0, unit="m/s", source="0.02 to 0.1 m/s")
    lag_s: Any = parameter(null=0.0, low=0.0, high=0.5, unit="s", source="0.01 to 0.04 s")

    def start(self, estimate: BodyEstimate) -> Memory:
        """Start at the first velocity."""
        return estimate.linear_vel_of_body_in_body_m_s

    def estimate(
        self, estimate: BodyEstimate, joints: JointReading, dt_s: float, memory: Memory, rng: Draws
    ) -> tuple[BodyEstimate, Memory]:
        """Filter, scale and shift."""
        now = estimate.linear_vel_of_body_in_body_m_s
        xp = namespace_of(now)
        filtered = low_pass(now, memory, self.lag_s, dt_s)
        zero = xp.zeros_like(now[:, :1])
        bias = xp.concat([zero + self.bias_x_m_s, zero + self.bias_y_m_s, zero], axis=1)
        out = self.scale * filtered + bias
        return dataclasses.replace(estimate, linear_vel_of_body_in_body_m_s=out), filtered


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


JOINTS_A_LEG = 3


@dataclass(frozen=True, kw_only=True)
class ContactDelay(EstimateEffect):
    """A contact flag of the joints' legs changes only once the contact has differed from it for a while.

    Source: contact detectors on joint torques, 10 to 40 ms.
    """

    name: ClassVar[str] = "contact_delay"
    by_joint: ClassVar[bool] = True

    delay_s: Any = parameter(null=0.0, low=0.0, high=0.3, unit="s", source="0.01 to 0.04 s")

    def start(self, estimate: BodyEstimate) -> Memory:
        """The flags as they are, and for how long the contact has differed from them."""
        return estimate.foot_contact, namespace_of(estimate.foot_contact).zeros_like(estimate.foot_contact)

    def estimate(
        self, estimate: BodyEstimate, joints: JointReading, dt_s: float, memory: Memory, rng: Draws
    ) -> tuple[BodyEstimate, Memory]:
        """Hold the flags back."""
        xp = namespace_of(estimate.foot_contact)
        flags, differs_s = memory
        # A leg's delay is that of its joints, the largest of the three.
        own_s = xp.where(self.mask_like(estimate.foot_contact), self.delay_s, 0.0)
        own_s = xp.max(xp.reshape(own_s, (own_s.shape[0], -1, JOINTS_A_LEG)), axis=-1)
        differs_s = xp.where(estimate.foot_contact != flags, differs_s + dt_s, 0.0)
        # Half a step of slack: times are sums of steps.
        due = differs_s > own_s + 0.5 * dt_s if math.isfinite(dt_s) else differs_s >= 0.0
        flags = xp.where(due | (own_s <= 0.0), estimate.foot_contact, flags)
        return dataclasses.replace(estimate, foot_contact=flags), (flags, differs_s)
