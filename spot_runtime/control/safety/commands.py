"""Commands: set-points within the joints' stops and the step limit, and the last check before one is sent."""

from __future__ import annotations

from itertools import compress
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot_model.robot import facts
from spot_model.robot.facts import KNEE_TABLE_TORQUE_NM, NS_PER_S, Array
from spot_model.robot.state import JointCommand
from spot_runtime.control.safety.states import are_finite, is_between
from spot_runtime.safety_limits import SafetyLimits
from spot_runtime.stops import Stop, StopReason

END_TIME_MAX_S: Final = 0.1
"""No command is ever valid for longer than this."""

KP_MAX: Final = 1000.0
"""N·m/rad; the vendor's stand has 936."""

KD_MAX: Final = 50.0
"""N·m·s/rad; the largest damping that a configuration may ask for."""

_TORQUE_NM: Final = facts.per_joint(
    facts.HIP_TORQUE_LIMIT_NM, facts.HIP_TORQUE_LIMIT_NM, float(KNEE_TABLE_TORQUE_NM.max())
)
"""Most that each joint's motor gives. A set-point so far beyond a stop that the servo law asks for this asks for all
there is, wherever the joint may be; policies use that. One that lies further means nothing to a robot. Shape (12,)."""

_SOFTEST: Final = 1.0
"""N·m/rad; a softer joint is held to this."""

_NOTHING_CUT: Final = np.zeros(facts.N_JOINTS, dtype=np.bool_)
_NOTHING_CUT.flags.writeable = False


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


def limit_setpoint(
    memory: SetpointMemory, requested_rad: Array, kp_nm_per_rad: Array, limits: SafetyLimits
) -> tuple[SetpointMemory, LimitedSetpoint, Stop | None]:
    """Bring one tick's request, shape (12,), canonical order, within the joint stops and the step limit.

    Returns:
        The new memory, the set-point that may be sent (with a stop: the one sent before, or the default pose), and a
        stop if the request is not finite or was cut too often in a row.
    """
    if is_between(requested_rad, requested_rad) and _is_small_step(memory.sent_rad, requested_rad, limits):
        return SetpointMemory(requested_rad, cut_ticks=memory.cut_ticks), LimitedSetpoint(requested_rad), None
    return _limit_closely(memory, requested_rad, kp_nm_per_rad, limits)


def _limit_closely(
    memory: SetpointMemory, requested_rad: Array, kp_nm_per_rad: Array, limits: SafetyLimits
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
    overshoot_rad = np.maximum(limits.setpoint_overshoot_rad, _TORQUE_NM / np.maximum(kp_nm_per_rad, _SOFTEST))
    is_overshoot = bool((beyond > overshoot_rad).any())
    cut = position != requested_rad
    memory = SetpointMemory(
        sent_rad=position,
        step_ticks=memory.step_ticks + 1 if is_step else 0,
        overshoot_ticks=memory.overshoot_ticks + 1 if is_overshoot else 0,
        cut_ticks=memory.cut_ticks + int(cut.any()),
    )
    return memory, LimitedSetpoint(position, cut), _cut_too_often(memory, beyond, overshoot_rad, cut, limits)


def _cut_too_often(
    memory: SetpointMemory, beyond: Array, overshoot_rad: Array, cut: NDArray[np.bool_], limits: SafetyLimits
) -> Stop | None:
    if memory.overshoot_ticks >= limits.setpoint_overshoot_ticks:
        joint = int((beyond - overshoot_rad).argmax())
        values = {"beyond_rad": float(beyond[joint]), "bound_rad": float(overshoot_rad[joint])}
        return Stop(StopReason.SETPOINT_OVERSHOOT, facts.JOINT_NAMES[joint], values)
    if memory.step_ticks >= limits.setpoint_step_ticks:
        return Stop(StopReason.SETPOINT_STEP, _names(cut), {"bound_rad": limits.setpoint_step_rad})
    return None


def _is_small_step(sent_rad: Array | None, requested_rad: Array, limits: SafetyLimits) -> bool:
    if sent_rad is None:
        return True
    step_rad = limits.setpoint_step_rad
    pairs = zip(sent_rad.tolist(), requested_rad.tolist(), strict=True)
    return all(sent - step_rad <= requested <= sent + step_rad for sent, requested in pairs)


def _names(mask: NDArray[np.bool_]) -> str:
    return ", ".join(compress(facts.JOINT_NAMES, mask))


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
