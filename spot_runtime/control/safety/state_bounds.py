"""What one state by itself must not show."""

from __future__ import annotations

import math

import numpy as np

from spot_model.robot import facts
from spot_model.robot.state import RobotState
from spot_runtime.control.safety.body_height import body_height_m, is_body_above
from spot_runtime.control.safety.values import are_finite, is_between
from spot_runtime.safety_limits import SafetyLimits
from spot_runtime.stops import Stop, StopReason


def broken_values(state: RobotState, limits: SafetyLimits) -> Stop | None:
    """A state that is incomplete, holds what is no number or no rotation, or a body that moves as none can."""
    shape = (facts.N_JOINTS,)
    if not (state.position_rad.shape == state.velocity_rad_s.shape == state.load_nm.shape == shape):
        return Stop(StopReason.STATE_NOT_FINITE, f"a state holds {state.position_rad.shape} joint values; needed: 12")
    joints = (state.position_rad, state.velocity_rad_s, state.load_nm)
    linear, angular = state.linear_vel_of_body_in_odom_m_s, state.angular_vel_of_body_in_odom_rad_s
    if not are_finite(*joints, linear, angular, state.position_of_body_in_odom_m, state.odom_from_body_wxyz):
        return Stop(StopReason.STATE_NOT_FINITE)
    error = abs(math.hypot(*state.odom_from_body_wxyz.tolist()) - 1.0)
    if error > limits.quaternion_norm_error:
        values = {"norm_error": error, "bound": limits.quaternion_norm_error}
        return Stop(StopReason.STATE_ATTITUDE, "", values)
    return _out_of_range(linear.tolist(), angular.tolist(), limits)


def _out_of_range(linear_m_s: list[float], angular_rad_s: list[float], limits: SafetyLimits) -> Stop | None:
    speed, turn_rate = math.hypot(*linear_m_s), math.hypot(*angular_rad_s)
    if speed > limits.body_velocity_m_s:
        what, values = "the body's velocity", {"velocity_m_s": speed, "bound_m_s": limits.body_velocity_m_s}
    elif turn_rate > limits.body_turn_rate_rad_s:
        what, values = "its turn rate", {"turn_rate_rad_s": turn_rate, "bound_rad_s": limits.body_turn_rate_rad_s}
    else:
        return None
    return Stop(StopReason.SIGNAL_OUT_OF_RANGE, what, values)


def out_of_bounds(state: RobotState, limits: SafetyLimits) -> Stop | None:
    """A body that tilts too far or is too low, or a joint too fast or beyond its stop."""
    _, x, y, _ = state.odom_from_body_wxyz.tolist()
    tilt_rad = math.acos(max(-1.0, 1.0 - 2.0 * (x * x + y * y)))
    if tilt_rad > limits.tilt_rad:
        return Stop(StopReason.TILT, "", {"tilt_rad": tilt_rad, "bound_rad": limits.tilt_rad})
    if not is_body_above(limits.body_height_m, state.position_rad, state.odom_from_body_wxyz):
        height_m = body_height_m(state.position_rad, state.odom_from_body_wxyz)
        return Stop(StopReason.BODY_LOW, "", {"height_m": height_m, "bound_m": limits.body_height_m})
    bound_rad_s = limits.joint_velocity_rad_s
    # When all squares together are within the bound, each is: true of nearly every state, and cheap to see.
    speed = None if state.velocity_rad_s.dot(state.velocity_rad_s) <= bound_rad_s**2 else np.abs(state.velocity_rad_s)
    if speed is not None and speed.max() > bound_rad_s:
        values = {"velocity_rad_s": float(speed.max()), "bound_rad_s": bound_rad_s}
        return Stop(StopReason.JOINT_VELOCITY, facts.JOINT_NAMES[int(speed.argmax())], values)
    margin_rad = limits.joint_position_margin_rad
    is_within = is_between(state.position_rad, state.position_rad)
    if not is_within and not is_between(state.position_rad - margin_rad, state.position_rad + margin_rad):
        beyond = np.maximum(facts.POSITION_LOW_RAD - state.position_rad, state.position_rad - facts.POSITION_HIGH_RAD)
        values = {"beyond_rad": float(beyond.max()), "bound_rad": margin_rad}
        return Stop(StopReason.JOINT_POSITION, facts.JOINT_NAMES[int(beyond.argmax())], values)
    return None
