"""What is watched while the vendor's controller stands and the policy waits."""

from __future__ import annotations

from typing import Final

from spot_model.robot.stamps import NS_PER_S
from spot_runtime.control.safety.slow_state import check_slow_state
from spot_runtime.hal.base import Hal
from spot_runtime.safety_limits import SafetyLimits
from spot_runtime.stops import Stop, StopReason

STATE_SILENCE_S: Final = 1.0
"""The vendor's controller does not need our states, so a short gap is not a reason to sit down."""


def check_standing(hal: Hal, newest_host_ns: int, limits: SafetyLimits) -> Stop | None:
    """What ends the waiting, if anything does; the newest state was received at this instant of the host's clock."""
    problems = hal.problems()
    if problems:
        return max(problems, key=lambda stop: stop.reason.reaction.level)
    host_ns = hal.host_now_ns()
    silent_s = (host_ns - newest_host_ns) / NS_PER_S
    if silent_s > STATE_SILENCE_S:
        return Stop(StopReason.STATE_LOST, "while standing by", {"silent_s": silent_s, "bound_s": STATE_SILENCE_S})
    slow = hal.slow_state
    return None if slow is None else check_slow_state(slow, host_ns, limits)
