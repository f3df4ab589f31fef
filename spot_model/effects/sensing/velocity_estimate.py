"""The state estimator's body velocity is scaled, shifted and late."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import BodyEstimate, Draws, EstimateEffect, JointReading, Memory, parameter
from spot_model.effects.sensing.low_pass import low_pass
from spot_model.robot.arrays import namespace_of


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
