"""What a state may show for an instant, and is then not used: loads and leaps that no robot makes."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from spot_model.robot import facts
from spot_model.robot.stamps import NS_PER_S
from spot_model.robot.state import RobotState
from spot_runtime.safety_limits import SafetyLimits
from spot_runtime.stops import Stop, StopReason

DOUBTFUL_STATES: Final = 3
"""So many states in a row with a load beyond its bound, or a leap, end the run; fewer are not used. An impact on a
rotor does not last longer: 300 N·m more than the motor gives change the speed of 0.073 kg·m² by 12 rad/s in 3 ms, and
no joint has three times that to lose."""

LEAP_RAD: Final = 0.1
"""What sensors' errors may add to the motion of a joint, or of the body's attitude, between two states."""


def overload(state: RobotState, limits: SafetyLimits) -> Stop | None:
    """A load that no motor gives."""
    listed = state.load_nm.tolist()
    load_nm = max(*listed, -min(listed))
    if load_nm <= limits.load_nm:
        return None
    values = {"load_nm": load_nm, "bound_nm": limits.load_nm}
    return Stop(StopReason.SIGNAL_OUT_OF_RANGE, "a joint's load", values)


def leap(newest: RobotState | None, state: RobotState, limits: SafetyLimits) -> Stop | None:
    """A joint, or the attitude, that moved further since the newest state than it can."""
    if newest is None:
        return None
    passed_s = (state.robot_stamp_ns - newest.robot_stamp_ns) / NS_PER_S
    moved_rad = state.position_rad - newest.position_rad
    bound_rad = limits.joint_velocity_rad_s * passed_s + LEAP_RAD
    # When all squares together are within the bound, each is: true of nearly every state, and cheap to see.
    if moved_rad.dot(moved_rad) > bound_rad**2 and np.abs(moved_rad).max() > bound_rad:
        joint = int(np.abs(moved_rad).argmax())
        values = {"moved_rad": float(np.abs(moved_rad[joint])), "bound_rad": bound_rad}
        return Stop(StopReason.SIGNAL_OUT_OF_RANGE, f"position of {facts.JOINT_NAMES[joint]}", values)
    cosine = abs(float(state.odom_from_body_wxyz.dot(newest.odom_from_body_wxyz)))
    turned_rad, bound_rad = 2.0 * math.acos(min(1.0, cosine)), limits.body_turn_rate_rad_s * passed_s + LEAP_RAD
    if turned_rad > bound_rad:
        values = {"turned_rad": turned_rad, "bound_rad": bound_rad}
        return Stop(StopReason.SIGNAL_OUT_OF_RANGE, "the attitude", values)
    return None
