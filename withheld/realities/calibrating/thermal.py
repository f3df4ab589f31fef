"""Motors that come hot into the run and lose torque as they grow hotter."""

from __future__ import annotations

import numpy as np

from withheld.realities.fault_kind import Ask, Built
from withheld.simulator.robot import Robot

HOT_C = 88.0
WINDING_J_PER_K = 9.0
DERATE_OVER_K = 45.0


def hot_motors(ask: Ask) -> Built:
    """A winding that loses its heat badly: it starts near where the drive derates, and a gait takes it beyond."""
    start = HOT_C + float(ask.rng.uniform(-2.0, 0.0))

    def install(robot: Robot) -> None:
        if ask.size == 0.0:
            return
        t = robot.thermal
        t.start_c = np.where(ask.joints, start, t.start_c)
        # A larger fault is a smaller mass of copper that takes the heat.
        t.winding_j_per_k = np.where(ask.joints, WINDING_J_PER_K / ask.size, t.winding_j_per_k)
        t.winding_to_housing_k_per_w = np.where(ask.joints, 4.0, t.winding_to_housing_k_per_w)
        t.derate_from_c = np.where(ask.joints, HOT_C, t.derate_from_c)
        t.derate_over_k = np.where(ask.joints, DERATE_OVER_K, t.derate_over_k)

    return Built(install)
