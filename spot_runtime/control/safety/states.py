"""States as they arrive: which may be used, how old the newest is, and what must stop the run."""

from __future__ import annotations

import math
from operator import ge, le, sub
from typing import Final, NamedTuple

import numpy as np

from spot_model.robot import facts
from spot_model.robot.facts import NS_PER_S, Array
from spot_model.robot.state import RobotState
from spot_runtime.control.safety.body_height import body_height_m, is_body_above
from spot_runtime.safety_limits import SafetyLimits
from spot_runtime.stops import Stop, StopReason

_LOWS_RAD: Final = facts.POSITION_LOW_RAD.tolist()
_HIGHS_RAD: Final = facts.POSITION_HIGH_RAD.tolist()


def are_finite(*arrays: Array) -> bool:
    """Whether all values are: their sum is not as soon as one of them is not."""
    return math.isfinite(sum(map(sum, map(np.ndarray.tolist, arrays))))


def is_between(least_rad: Array, largest_rad: Array) -> bool:
    """Whether, joint by joint, one value is at most the upper stop and the other at least the lower. Shapes (12,)."""
    return all(map(le, least_rad.tolist(), _HIGHS_RAD)) and all(map(ge, largest_rad.tolist(), _LOWS_RAD))


_SIGNALS: Final = ("position", "velocity", "load", "body velocity", "turn rate", "body position", "attitude")
DOUBTFUL_STATES: Final = 3
"""So many states in a row with a load beyond its bound, or a leap, end the run; fewer are not used. An impact on a
rotor does not last longer. A torque of 300 N·m beyond the motor's changes the speed of 0.073 kg·m² by 12 rad/s in
3 ms. No joint has three times that to lose."""

LEAP_RAD: Final = 0.1
"""What sensors' errors may add to the motion of a joint, or of the body's attitude, between two states."""


class StateMemory(NamedTuple):
    """What the screening of states remembers."""

    newest: RobotState | None = None
    """The newest state that was accepted."""
    arrived_robot_stamp_ns: int = 0
    """Newest stamp of all that have arrived, usable or not; 0 before any."""
    rejected_in_row: int = 0
    rejected: int = 0
    """Duplicated and back-dated states since the start."""
    missed: int = 0
    """States since the first that never came, counted by the gaps between stamps."""
    changed_robot_stamp_ns: int = 0
    """Stamp of the last state whose joint values differed from the one before."""
    echo_robot_stamp_ns: int = 0
    """Stamp of the last state in which the confirmed command key rose; 0 before any."""
    doubtful_in_row: int = 0
    """States that were not used because of a load beyond its bound, or a leap."""


def screen_state(
    memory: StateMemory, state: RobotState, robot_now_ns: int, limits: SafetyLimits
) -> tuple[StateMemory, bool, Stop | None]:
    """Judge one state as it arrives.

    Returns:
        The new memory, whether the state may be used, and a stop where one is due. A duplicated or back-dated state is
        never used; neither is one with an impossible load or a leap, or one that causes a stop.
    """
    newest = memory.newest
    if newest is not None and state.robot_stamp_ns <= newest.robot_stamp_ns:
        in_row = memory.rejected_in_row + 1
        memory = memory._replace(rejected_in_row=in_row, rejected=memory.rejected + 1)
        return memory, False, _rejected(in_row, state, newest, limits)
    stop = _from_future(state, robot_now_ns, limits) or _broken_values(state, limits)
    if stop is not None:
        arrived_ns = max(memory.arrived_robot_stamp_ns, state.robot_stamp_ns)
        return memory._replace(arrived_robot_stamp_ns=arrived_ns), False, stop
    doubt = _overload(state, limits) or _leap(newest, state, limits)
    if doubt is not None:
        in_row = memory.doubtful_in_row + 1
        memory = memory._replace(arrived_robot_stamp_ns=state.robot_stamp_ns, doubtful_in_row=in_row)
        return memory, False, doubt if in_row >= DOUBTFUL_STATES else None
    has_changed = newest is None or not _same_joints(newest, state)
    echo_rose = state.last_command_key != (0 if newest is None else newest.last_command_key)
    memory = StateMemory(
        newest=state,
        arrived_robot_stamp_ns=state.robot_stamp_ns,
        rejected=memory.rejected,
        missed=memory.missed + (0 if newest is None else _missed_between(newest, state)),
        changed_robot_stamp_ns=state.robot_stamp_ns if has_changed else memory.changed_robot_stamp_ns,
        echo_robot_stamp_ns=state.robot_stamp_ns if echo_rose else memory.echo_robot_stamp_ns,
    )
    frozen_s = (state.robot_stamp_ns - memory.changed_robot_stamp_ns) / NS_PER_S
    if frozen_s >= limits.frozen_s:
        return memory, False, Stop(StopReason.STATE_FROZEN, "", {"frozen_s": frozen_s, "bound_s": limits.frozen_s})
    return memory, True, _out_of_bounds(state, limits)


def check_age(memory: StateMemory, robot_now_ns: int, limits: SafetyLimits) -> Stop | None:
    """Judge how old the newest state is; without any state there is nothing to judge.

    Damping answers a usable state that is too old; silence, a link over which nothing comes at all.
    """
    if memory.newest is None:
        return None
    silent_s = (robot_now_ns - memory.arrived_robot_stamp_ns) / NS_PER_S
    if silent_s >= limits.state_age_stop_s:
        return Stop(StopReason.STATE_LOST, "", {"age_s": silent_s, "bound_s": limits.state_age_stop_s})
    age_s = (robot_now_ns - memory.newest.robot_stamp_ns) / NS_PER_S
    if age_s >= limits.state_age_damp_s:
        return Stop(StopReason.STATE_STALE, "", {"age_s": age_s, "bound_s": limits.state_age_damp_s})
    return None


def check_echo(memory: StateMemory, active_since_robot_ns: int, limits: SafetyLimits) -> Stop | None:
    """Judge whether the robot still confirms commands, counted from the start of joint control."""
    if memory.newest is None:
        return None
    confirmed_ns = max(memory.echo_robot_stamp_ns, active_since_robot_ns)
    silent_s = (memory.newest.robot_stamp_ns - confirmed_ns) / NS_PER_S
    if silent_s < limits.command_echo_s:
        return None
    return Stop(StopReason.COMMAND_UNCONFIRMED, "", {"silent_s": silent_s, "bound_s": limits.command_echo_s})


def _from_future(state: RobotState, robot_now_ns: int, limits: SafetyLimits) -> Stop | None:
    ahead_s = (state.robot_stamp_ns - robot_now_ns) / NS_PER_S
    if ahead_s <= limits.state_from_future_s:
        return None
    values = {"ahead_s": ahead_s, "bound_s": limits.state_from_future_s}
    return Stop(StopReason.CLOCK_JUMPED, "a state is stamped in the future", values)


def _rejected(in_row: int, state: RobotState, newest: RobotState, limits: SafetyLimits) -> Stop | None:
    if in_row < limits.rejected_states:
        return None
    behind_s = (newest.robot_stamp_ns - state.robot_stamp_ns) / NS_PER_S
    values = {"in_row": float(in_row), "bound": float(limits.rejected_states), "behind_s": behind_s}
    return Stop(StopReason.STATE_REJECTED, "", values)


def _missed_between(before: RobotState, after: RobotState) -> int:
    """States that should have come between two."""
    return round((after.robot_stamp_ns - before.robot_stamp_ns) / facts.STATE_PERIOD_NS) - 1


def _same_joints(a: RobotState, b: RobotState) -> bool:
    return (
        a.position_rad.tobytes() == b.position_rad.tobytes()
        and a.velocity_rad_s.tobytes() == b.velocity_rad_s.tobytes()
        and a.load_nm.tobytes() == b.load_nm.tobytes()
    )


def _broken_values(state: RobotState, limits: SafetyLimits) -> Stop | None:
    """A state that is incomplete, holds what is no number or no rotation, or a body that moves as none can."""
    shape = (facts.N_JOINTS,)
    if not (state.position_rad.shape == state.velocity_rad_s.shape == state.load_nm.shape == shape):
        return Stop(StopReason.STATE_NOT_FINITE, f"a state holds {state.position_rad.shape} joint values; needed: 12")
    joints = (state.position_rad, state.velocity_rad_s, state.load_nm)
    linear, angular = state.linear_vel_of_body_in_odom_m_s, state.angular_vel_of_body_in_odom_rad_s
    signals = (*joints, linear, angular, state.position_of_body_in_odom_m, state.odom_from_body_wxyz)
    if not are_finite(*signals):
        broken = [name for name, values in zip(_SIGNALS, signals, strict=True) if not are_finite(values)]
        return Stop(StopReason.STATE_NOT_FINITE, ", ".join(broken))
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


def _out_of_bounds(state: RobotState, limits: SafetyLimits) -> Stop | None:
    """A body that tilts too far or is too low, or a joint too fast or beyond its stop."""
    _, x, y, _ = state.odom_from_body_wxyz.tolist()
    tilt_rad = math.acos(max(-1.0, 1.0 - 2.0 * (x * x + y * y)))
    if tilt_rad > limits.tilt_rad:
        return Stop(StopReason.TILT, "", {"tilt_rad": tilt_rad, "bound_rad": limits.tilt_rad})
    if not is_body_above(limits.body_height_m, state.position_rad, state.odom_from_body_wxyz):
        height_m = body_height_m(state.position_rad, state.odom_from_body_wxyz)
        return Stop(StopReason.BODY_LOW, "", {"height_m": height_m, "bound_m": limits.body_height_m})
    bound_rad_s = limits.joint_velocity_rad_s
    speeds = list(map(abs, state.velocity_rad_s.tolist()))
    speed = max(speeds)
    if speed > bound_rad_s:
        values = {"velocity_rad_s": speed, "bound_rad_s": bound_rad_s}
        return Stop(StopReason.JOINT_VELOCITY, facts.JOINT_NAMES[speeds.index(speed)], values)
    margin_rad = limits.joint_position_margin_rad
    is_within = is_between(state.position_rad, state.position_rad)
    if not is_within and not is_between(state.position_rad - margin_rad, state.position_rad + margin_rad):
        beyond = np.maximum(facts.POSITION_LOW_RAD - state.position_rad, state.position_rad - facts.POSITION_HIGH_RAD)
        values = {"beyond_rad": float(beyond.max()), "bound_rad": margin_rad}
        return Stop(StopReason.JOINT_POSITION, facts.JOINT_NAMES[int(beyond.argmax())], values)
    return None


def _overload(state: RobotState, limits: SafetyLimits) -> Stop | None:
    """A load that no motor gives."""
    listed = state.load_nm.tolist()
    load_nm = max(*listed, -min(listed))
    if load_nm <= limits.load_nm:
        return None
    values = {"load_nm": load_nm, "bound_nm": limits.load_nm}
    return Stop(StopReason.SIGNAL_OUT_OF_RANGE, "a joint's load", values)


def _leap(newest: RobotState | None, state: RobotState, limits: SafetyLimits) -> Stop | None:
    """A joint, or the attitude, that moved further since the newest state than it can."""
    if newest is None:
        return None
    passed_s = (state.robot_stamp_ns - newest.robot_stamp_ns) / NS_PER_S
    moves_rad = list(map(abs, map(sub, state.position_rad.tolist(), newest.position_rad.tolist())))
    moved_rad, bound_rad = max(moves_rad), limits.joint_velocity_rad_s * passed_s + LEAP_RAD
    if moved_rad > bound_rad:
        values = {"moved_rad": moved_rad, "bound_rad": bound_rad}
        joint = facts.JOINT_NAMES[moves_rad.index(moved_rad)]
        return Stop(StopReason.SIGNAL_OUT_OF_RANGE, f"position of {joint}", values)
    cosine = abs(float(state.odom_from_body_wxyz.dot(newest.odom_from_body_wxyz)))
    turned_rad, bound_rad = 2.0 * math.acos(min(1.0, cosine)), limits.body_turn_rate_rad_s * passed_s + LEAP_RAD
    if turned_rad > bound_rad:
        values = {"turned_rad": turned_rad, "bound_rad": bound_rad}
        return Stop(StopReason.SIGNAL_OUT_OF_RANGE, "the attitude", values)
    return None
