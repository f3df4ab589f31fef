"""The last check of a command before it is sent."""

from __future__ import annotations

from typing import Final

from spot_model.robot.stamps import NS_PER_S
from spot_model.robot.state import JointCommand
from spot_runtime.control.safety.values import are_finite, is_between

END_TIME_MAX_S: Final = 0.1
"""No command is ever valid for longer than this."""

KP_MAX: Final = 1000.0
"""N·m/rad; the vendor's stand has 936."""

KD_MAX: Final = 50.0
"""N·m·s/rad; the largest damping that a configuration may ask for."""


def check_command(command: JointCommand, last_key: int, robot_now_ns: int) -> str | None:
    """The last check: what is wrong with a command that must not be sent, or None."""
    if command.key <= last_key:
        return f"its key {command.key} is not above {last_key}"
    ahead_s = (command.end_robot_stamp_ns - robot_now_ns) / NS_PER_S
    if not 0.0 < ahead_s <= END_TIME_MAX_S:
        return f"its end time lies {ahead_s:g} s ahead; allowed: above 0, at most {END_TIME_MAX_S:g}"
    gains = command.gains
    asked = (command.position_rad, command.velocity_rad_s, command.load_nm)
    if not are_finite(*asked, gains.kp_nm_per_rad, gains.kd_nm_s_per_rad):
        return "it holds a value that is no number"
    if not is_between(command.position_rad, command.position_rad):
        return "a set-point lies beyond a joint's stop"
    for name, values, bound in (("kp", gains.kp_nm_per_rad, KP_MAX), ("kd", gains.kd_nm_s_per_rad, KD_MAX)):
        listed = values.tolist()
        if min(listed) < 0.0 or max(listed) > bound:
            return f"its {name} lies outside 0 to {bound:g}"
    return None
