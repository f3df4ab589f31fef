"""Drives that hold less than they should: currents that bend, and motors that lose torque as they grow hotter."""

from __future__ import annotations

import numpy as np

from spot_model.robot.facts import Array, per_joint
from withheld.realities.fault_kind import Ask, Parameters
from withheld.simulator.robot import Robot

LARGEST_NM: Array = per_joint(42.0, 42.0, 95.0)
SMALLEST_NM: Array = per_joint(14.0, 18.0, 32.0)
SOFTNESS = 0.12
HOT_C = 88.0
WINDING_J_PER_K = 9.0
DERATE_OVER_K = 45.0


def soft_limit(robot: Robot, ask: Ask) -> Parameters:
    """A current limit with a soft knee, from just under the rated torque down to what a walk needs."""
    limit = LARGEST_NM + ask.size * (SMALLEST_NM - LARGEST_NM)

    d = robot.drive
    d.current_high_nm = np.where(ask.joints, np.minimum(d.current_high_nm, limit), d.current_high_nm)
    d.current_low_nm = np.where(ask.joints, np.maximum(d.current_low_nm, -limit), d.current_low_nm)
    d.limit_softness = np.where(ask.joints, SOFTNESS, d.limit_softness)

    chosen = limit[ask.joints]
    one = ask.size > 0.0 and float(np.ptp(chosen)) == 0.0
    return {"torque_limit.limit_nm": float(chosen[0])} if one else {}


def hot_motors(robot: Robot, ask: Ask) -> Parameters:
    """A winding that loses its heat badly: it starts near where the drive derates, and a gait takes it beyond."""
    start = HOT_C + float(ask.rng.uniform(-2.0, 0.0))

    t = robot.thermal
    t.start_c = np.where(ask.joints, start, t.start_c)
    # A larger fault is a smaller mass of copper that takes the heat.
    t.winding_j_per_k = np.where(ask.joints, WINDING_J_PER_K / ask.size, t.winding_j_per_k)
    t.winding_to_housing_k_per_w = np.where(ask.joints, 4.0, t.winding_to_housing_k_per_w)
    t.derate_from_c = np.where(ask.joints, HOT_C, t.derate_from_c)
    t.derate_over_k = np.where(ask.joints, DERATE_OVER_K, t.derate_over_k)
    return {}
