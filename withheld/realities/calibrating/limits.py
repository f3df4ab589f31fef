"""Drives that hold less than they should: currents that bend, levers that slip, motors that run out of volts."""

from __future__ import annotations

import numpy as np

from spot_model.robot.facts import Array, per_joint
from withheld.realities.fault_kind import Ask, Built
from withheld.simulator.robot import Robot

LARGEST_NM: Array = per_joint(42.0, 42.0, 95.0)
SMALLEST_NM: Array = per_joint(14.0, 18.0, 32.0)
SOFTNESS = 0.12


def soft_limit(ask: Ask) -> Built:
    """A current limit with a soft knee, from just under the rated torque down to what a walk needs."""
    limit = LARGEST_NM + ask.size * (SMALLEST_NM - LARGEST_NM)

    def install(robot: Robot) -> None:
        if ask.size == 0.0:
            return
        d = robot.drive
        d.current_high_nm = np.where(ask.joints, np.minimum(d.current_high_nm, limit), d.current_high_nm)
        d.current_low_nm = np.where(ask.joints, np.maximum(d.current_low_nm, -limit), d.current_low_nm)
        d.limit_softness = np.where(ask.joints, SOFTNESS, d.limit_softness)

    chosen = limit[ask.joints]
    one = ask.size > 0.0 and float(np.ptp(chosen)) == 0.0
    return Built(install, {"torque_limit.limit_nm": float(chosen[0])} if one else {})
