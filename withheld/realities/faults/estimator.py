"""State estimators that are wrong about lengths, or tuned to be lazy."""

from __future__ import annotations

import numpy as np

from withheld.realities.fault_kind import Ask, Built, sign
from withheld.realities.robot import Robot

SCALE = 0.12
BIAS_M_S = 0.08
LAG_S = 0.045


def wrong_lengths(ask: Ask) -> Built:
    """Legs of another length in the estimator's own model, and a foot that it takes for another."""
    scale = 1.0 + sign(ask.rng) * ask.size * SCALE
    bias = ask.size * BIAS_M_S * ask.rng.uniform(-1.0, 1.0, 2)

    def install(robot: Robot) -> None:
        robot.estimator.odometry_scale *= scale
        robot.estimator.odometry_bias_m_s = robot.estimator.odometry_bias_m_s + bias

    return Built(install, {
        "velocity_estimate.scale": scale, "velocity_estimate.bias_x_m_s": float(bias[0]),
        "velocity_estimate.bias_y_m_s": float(bias[1]),
    })  # fmt: skip


def lazy(ask: Ask) -> Built:
    """A low pass on the velocity that is handed out."""
    lag = ask.size * LAG_S

    def install(robot: Robot) -> None:
        robot.estimator.output_lag_s = float(np.hypot(robot.estimator.output_lag_s, lag))

    return Built(install, {"velocity_estimate.lag_s": lag})
