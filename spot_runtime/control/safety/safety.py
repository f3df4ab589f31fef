"""The safety core: pure functions from what was seen and asked to what may be sent, or to a stop with its reason.

Nothing here reads a clock, logs, or sends. Memory goes in and comes out; every bound is in :class:`SafetyLimits`.
"""

from __future__ import annotations

import math
from operator import ge, le
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot_model.robot import facts
from spot_model.robot.stamps import NS_PER_S
from spot_model.robot.state import Array, JointCommand, RobotState, SlowState
from spot_runtime.control.safety.battery import unknown
from spot_runtime.control.safety.body_height import body_height_m, is_body_above
from spot_runtime.control.safety.leaps import DOUBTFUL_STATES, leap, overload
from spot_runtime.safety_limits import SafetyLimits
from spot_runtime.stops import CRITICAL, Stop, StopReason

END_TIME_MAX_S: Final = 0.1
"""No command is ever valid for longer than this."""

KP_MAX: Final = 1000.0
"""N·m/rad; the vendor's stand has 936."""

KD_MAX: Final = 50.0
"""N·m·s/rad; the largest damping that a configuration may ask for."""

_LOWS_RAD: Final = facts.POSITION_LOW_RAD.tolist()
_HIGHS_RAD: Final = facts.POSITION_HIGH_RAD.tolist()
_NOTHING_CUT: Final = np.zeros(facts.N_JOINTS, dtype=np.bool_)
_NOTHING_CUT.flags.writeable = False


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


class SetpointMemory(NamedTuple):
    """What the limits of set-points remember."""

    sent_rad: Array | None = None
    """The set-point of the tick before, as sent. Shape (12,)."""
    step_ticks: int = 0
    overshoot_ticks: int = 0
    cut_ticks: int = 0
    """Ticks since the start in which a limit cut the request."""


class LimitedSetpoint(NamedTuple):
    """A set-point within all limits."""

    position_rad: Array
    """Shape (12,)."""
    cut: NDArray[np.bool_] = _NOTHING_CUT
    """Joints whose request was changed. Shape (12,)."""

    @property
    def is_cut(self) -> bool:
        """Whether any request was changed."""
        return self.cut is not _NOTHING_CUT and bool(self.cut.any())


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
    doubt = overload(state, limits) or leap(newest, state, limits)
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
    return memory, True, _body_out_of_bounds(state, limits)


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


def limit_setpoint(
    memory: SetpointMemory, requested_rad: Array, limits: SafetyLimits
) -> tuple[SetpointMemory, LimitedSetpoint, Stop | None]:
    """Bring one tick's request within the joint stops and the step limit.

    Args:
        memory: From the tick before.
        requested_rad: What the policy or the ramp asks for. Shape (12,), canonical order.
        limits: The bounds.

    Returns:
        The new memory, the set-point that may be sent (with a stop: the one sent before, or the default pose), and a
        stop if the request is not finite or was cut too often in a row.
    """
    if _is_between(requested_rad, requested_rad) and _is_small_step(memory.sent_rad, requested_rad, limits):
        return SetpointMemory(requested_rad, cut_ticks=memory.cut_ticks), LimitedSetpoint(requested_rad), None
    return _limit_closely(memory, requested_rad, limits)


def _limit_closely(
    memory: SetpointMemory, requested_rad: Array, limits: SafetyLimits
) -> tuple[SetpointMemory, LimitedSetpoint, Stop | None]:
    """The rest of :func:`limit_setpoint`, for a request that is not within all limits."""
    if not bool(np.isfinite(requested_rad).all()):
        names = _names(~np.isfinite(requested_rad))
        kept = facts.DEFAULT_POSITION_RAD if memory.sent_rad is None else memory.sent_rad
        return memory, LimitedSetpoint(kept), Stop(StopReason.POLICY_NOT_FINITE, names)
    beyond = np.maximum(facts.POSITION_LOW_RAD - requested_rad, requested_rad - facts.POSITION_HIGH_RAD)
    position = np.clip(requested_rad, facts.POSITION_LOW_RAD, facts.POSITION_HIGH_RAD)
    is_step = False
    if memory.sent_rad is not None:
        step = limits.setpoint_step_rad
        is_step = bool(np.abs(position - memory.sent_rad).max() > step)
        if is_step:
            position = np.clip(position, memory.sent_rad - step, memory.sent_rad + step)
            # What was sent lies within the stops, so this only takes back what rounding added.
            position = np.clip(position, facts.POSITION_LOW_RAD, facts.POSITION_HIGH_RAD)
    is_overshoot = bool(beyond.max() > limits.setpoint_overshoot_rad)
    cut = position != requested_rad
    memory = SetpointMemory(
        sent_rad=position,
        step_ticks=memory.step_ticks + 1 if is_step else 0,
        overshoot_ticks=memory.overshoot_ticks + 1 if is_overshoot else 0,
        cut_ticks=memory.cut_ticks + int(cut.any()),
    )
    return memory, LimitedSetpoint(position, cut), _cut_too_often(memory, beyond, cut, limits)


def check_slow_state(slow: SlowState, host_now_ns: int, limits: SafetyLimits) -> Stop | None:
    """Judge battery, temperatures, power, e-stop and faults, and how old that knowledge is."""
    age_s = (host_now_ns - slow.host_stamp_ns) / NS_PER_S
    if age_s > limits.slow_state_age_s:
        return Stop(StopReason.LINK_LOST, "", {"age_s": age_s, "bound_s": limits.slow_state_age_s})
    if slow.estopped:
        return Stop(StopReason.ESTOPPED)
    if slow.behavior_faults:
        return Stop(StopReason.BEHAVIOR_FAULT, ", ".join(slow.behavior_faults))
    if not slow.motors_powered:
        return Stop(StopReason.MOTORS_OFF)
    names = unknown(slow)
    if names:
        return Stop(StopReason.BATTERY_UNKNOWN, names)
    if slow.battery_charge_percent < limits.battery_percent:
        values = {"charge_percent": slow.battery_charge_percent, "bound_percent": limits.battery_percent}
        return Stop(StopReason.BATTERY_LOW, "", values)
    for name, temperature_c in slow.motor_temperature_c.items():
        if temperature_c > limits.motor_temperature_c:
            values = {"temperature_c": temperature_c, "bound_c": limits.motor_temperature_c}
            return Stop(StopReason.MOTOR_HOT, name, values)
    critical = [fault for fault in slow.system_faults if fault.startswith(CRITICAL)]
    if critical:
        return Stop(StopReason.SYSTEM_FAULT, ", ".join(critical))
    return None


def check_command(command: JointCommand, last_key: int, robot_now_ns: int) -> str | None:
    """The last check: what is wrong with a command that must not be sent, or None."""
    if command.key <= last_key:
        return f"its key {command.key} is not above {last_key}"
    ahead_s = (command.end_robot_stamp_ns - robot_now_ns) / NS_PER_S
    if not 0.0 < ahead_s <= END_TIME_MAX_S:
        return f"its end time lies {ahead_s:g} s ahead; allowed: above 0, at most {END_TIME_MAX_S:g}"
    gains = command.gains
    asked = (command.position_rad, command.velocity_rad_s, command.load_nm)
    if not _are_finite(*asked, gains.kp_nm_per_rad, gains.kd_nm_s_per_rad):
        return "it holds a value that is no number"
    if not _is_between(command.position_rad, command.position_rad):
        return "a set-point lies beyond a joint's stop"
    for name, values, bound in (("kp", gains.kp_nm_per_rad, KP_MAX), ("kd", gains.kd_nm_s_per_rad, KD_MAX)):
        listed = values.tolist()
        if min(listed) < 0.0 or max(listed) > bound:
            return f"its {name} lies outside 0 to {bound:g}"
    return None


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


def _broken_values(state: RobotState, limits: SafetyLimits) -> Stop | None:
    shape = (facts.N_JOINTS,)
    if not (state.position_rad.shape == state.velocity_rad_s.shape == state.load_nm.shape == shape):
        return Stop(StopReason.STATE_NOT_FINITE, f"a state holds {state.position_rad.shape} joint values; needed: 12")
    joints = (state.position_rad, state.velocity_rad_s, state.load_nm)
    linear, angular = state.linear_vel_of_body_in_odom_m_s, state.angular_vel_of_body_in_odom_rad_s
    if not _are_finite(*joints, linear, angular, state.position_of_body_in_odom_m, state.odom_from_body_wxyz):
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


def _body_out_of_bounds(state: RobotState, limits: SafetyLimits) -> Stop | None:
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
    is_within = _is_between(state.position_rad, state.position_rad)
    if not is_within and not _is_between(state.position_rad - margin_rad, state.position_rad + margin_rad):
        beyond = np.maximum(facts.POSITION_LOW_RAD - state.position_rad, state.position_rad - facts.POSITION_HIGH_RAD)
        values = {"beyond_rad": float(beyond.max()), "bound_rad": margin_rad}
        return Stop(StopReason.JOINT_POSITION, facts.JOINT_NAMES[int(beyond.argmax())], values)
    return None


def _missed_between(before: RobotState, after: RobotState) -> int:
    """States that should have come between two."""
    return round((after.robot_stamp_ns - before.robot_stamp_ns) / facts.STATE_PERIOD_NS) - 1


def _cut_too_often(memory: SetpointMemory, beyond: Array, cut: NDArray[np.bool_], limits: SafetyLimits) -> Stop | None:
    if memory.overshoot_ticks >= limits.setpoint_overshoot_ticks:
        values = {"beyond_rad": float(beyond.max()), "bound_rad": limits.setpoint_overshoot_rad}
        return Stop(StopReason.SETPOINT_OVERSHOOT, facts.JOINT_NAMES[int(beyond.argmax())], values)
    if memory.step_ticks >= limits.setpoint_step_ticks:
        return Stop(StopReason.SETPOINT_STEP, _names(cut), {"bound_rad": limits.setpoint_step_rad})
    return None


def _are_finite(*arrays: Array) -> bool:
    """Whether all values are: their sum is not as soon as one of them is not."""
    return math.isfinite(sum(map(sum, map(np.ndarray.tolist, arrays))))


def _is_between(least_rad: Array, largest_rad: Array) -> bool:
    """Whether, joint by joint, one value is at most the upper stop and the other at least the lower. Shapes (12,)."""
    # On lists, which are faster than arrays of this size.
    return all(map(le, least_rad.tolist(), _HIGHS_RAD)) and all(map(ge, largest_rad.tolist(), _LOWS_RAD))


def _is_small_step(sent_rad: Array | None, requested_rad: Array, limits: SafetyLimits) -> bool:
    if sent_rad is None:
        return True
    step_rad = limits.setpoint_step_rad
    pairs = zip(sent_rad.tolist(), requested_rad.tolist(), strict=True)
    return all(sent - step_rad <= asked <= sent + step_rad for sent, asked in pairs)


def _same_joints(a: RobotState, b: RobotState) -> bool:
    return (
        a.position_rad.tobytes() == b.position_rad.tobytes()
        and a.velocity_rad_s.tobytes() == b.velocity_rad_s.tobytes()
        and a.load_nm.tobytes() == b.load_nm.tobytes()
    )


def _names(mask: NDArray[np.bool_]) -> str:
    return ", ".join(name for name, chosen in zip(facts.JOINT_NAMES, mask, strict=True) if chosen)
