"""States as they arrive: which may be used, how old the newest is, and what must stop the run."""

from __future__ import annotations

from typing import NamedTuple

from spot_model.robot import facts
from spot_model.robot.stamps import NS_PER_S
from spot_model.robot.state import RobotState
from spot_runtime.control.safety.leaps import DOUBTFUL_STATES, leap, overload
from spot_runtime.control.safety.state_bounds import broken_values, out_of_bounds
from spot_runtime.safety_limits import SafetyLimits
from spot_runtime.stops import Stop, StopReason


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
    stop = _from_future(state, robot_now_ns, limits) or broken_values(state, limits)
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
    return memory, True, out_of_bounds(state, limits)


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
