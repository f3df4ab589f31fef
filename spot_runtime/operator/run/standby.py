"""What is watched while the vendor's controller stands and the policy waits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from spot_model.robot.stamps import NS_PER_S
from spot_model.robot.state import RobotState
from spot_runtime.control.safety.battery import BatteryMemory
from spot_runtime.control.safety.slow_state import check_slow_state
from spot_runtime.control.safety.states import StateMemory, screen_state
from spot_runtime.hal.base import Hal
from spot_runtime.safety_limits import SafetyLimits
from spot_runtime.stops import Stop, StopReason

STATE_SILENCE_S: Final = 1.0
"""The vendor's controller does not need our states, so a short gap is not a reason to sit down."""


def check_standing(
    hal: Hal, newest: Sequence[RobotState], newest_host_ns: int, battery: BatteryMemory, limits: SafetyLimits
) -> tuple[BatteryMemory, Stop | None]:
    """What is known of the battery now, and what ends the waiting, if anything does.

    Args:
        hal: The robot.
        newest: The newest state, if one has come since the last look.
        newest_host_ns: When the newest of all was received, host's clock.
        battery: What was known of the battery.
        limits: By which the state is judged: a robot that was turned over does not stand.
    """
    problems = hal.problems()
    if problems:
        return battery, max(problems, key=lambda stop: stop.reason.reaction.level)
    for state in newest:
        fallen = screen_state(StateMemory(), state, hal.robot_now_ns(), limits)[2]
        if fallen is not None:
            return battery, fallen
    host_ns, slow = hal.host_now_ns(), hal.slow_state
    silent_s = (host_ns - newest_host_ns) / NS_PER_S
    if silent_s > STATE_SILENCE_S:
        values = {"silent_s": silent_s, "bound_s": STATE_SILENCE_S}
        return battery, Stop(StopReason.STATE_LOST, "while standing by", values)
    return (battery, None) if slow is None else check_slow_state(battery, slow, host_ns, limits)
