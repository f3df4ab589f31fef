"""Drives that hold less than they should: currents that bend, levers that slip, motors that run out of volts."""

from __future__ import annotations

import numpy as np

from spot_model.robot.facts import Array, per_joint
from spot_model.robot.knee_table import KNEE_MOTOR_TORQUE_NM
from withheld.realities.fault_kind import Ask, Built
from withheld.realities.robot import HIP_NO_LOAD_RAD_S, Robot

LARGEST_NM: Array = per_joint(42.0, 42.0, 95.0)
SMALLEST_NM: Array = per_joint(14.0, 18.0, 32.0)
SOFTNESS = 0.12
LEVER_LOSS = 0.72
SLOWEST_RAD_S: Array = per_joint(3.0, 5.0, 7.0)


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


def weak_lever(ask: Ask) -> Built:
    """A knee's linkage that holds less: the motor slips before the published torque."""
    share = 1.0 - ask.size * LEVER_LOSS

    def install(robot: Robot) -> None:
        robot.drive.lever_share = np.where(ask.joints, robot.drive.lever_share * share, robot.drive.lever_share)

    return Built(install, {"position_torque_limit.motor_torque_nm": KNEE_MOTOR_TORQUE_NM * share})


def few_volts(ask: Ask) -> Built:
    """A motor wound for more volts than it gets: back-EMF eats the bus at an ordinary speed."""

    def install(robot: Robot) -> None:
        d = robot.drive
        for name in ("no_load_high_rad_s", "no_load_low_rad_s"):
            now = getattr(d, name)
            slowest = np.abs(SLOWEST_RAD_S / now)
            setattr(d, name, np.where(ask.joints, now * slowest**ask.size, now))

    knees = bool(ask.joints[2::3].any()) and not bool(ask.joints[0::3].any() or ask.joints[1::3].any())
    rated = 25.03 if knees else HIP_NO_LOAD_RAD_S
    chosen = SLOWEST_RAD_S[ask.joints]
    if float(np.ptp(chosen)) > 0.0:
        return Built(install)
    speed = rated * (float(chosen[0]) / rated) ** ask.size
    return Built(install, {"torque_speed_curve.speed_max_rad_s": speed, "torque_speed_curve.speed_min_rad_s": -speed})
