"""State estimators that are wrong about lengths, or tuned to be lazy."""

from __future__ import annotations

import numpy as np

from withheld.realities.fault_kind import Ask, Built
from withheld.simulator.robot import Robot

LAG_S = 0.045


def lazy(ask: Ask) -> Built:
    """A low pass on the velocity that is handed out."""
    lag = ask.size * LAG_S

    def install(robot: Robot) -> None:
        robot.estimator.output_lag_s = float(np.hypot(robot.estimator.output_lag_s, lag))

    return Built(install, {"velocity_estimate.lag_s": lag})
