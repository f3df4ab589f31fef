"""Loads against what was asked: of their own joint, not of another leg's, and while a measured pose is held.

While joint control takes hold, the set-point is the pose that the robot reports and the feed-forward torque is the load
that carries it. A servo that sees its joint elsewhere adds its stiffness times the difference, which shows in its load.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot_model.robot import facts
from spot_model.robot.facts import KNEE_TABLE_POSITION_RAD, KNEE_TABLE_TORQUE_NM, Array
from spot_model.robot.state import JointCommand, RobotState
from spot_runtime.control.safety.signals import bounds
from spot_runtime.control.safety.signals.window import Window


def disagreeing(window: Window, commands: Sequence[JointCommand]) -> NDArray[np.bool_]:
    """Joints whose load lies far from whatever the servo law could have asked of them. Shape (12,).

    The load may answer any of these recent commands, of which there is at least one.
    """
    state = window.last
    asked = np.array([torque_nm(command, state.position_rad, state.velocity_rad_s) for command in commands])
    least, largest = asked.min(axis=0), asked.max(axis=0)
    gains = commands[-1].gains
    # Between what is reported and what the servo acts on, position and velocity move on.
    lag = bounds.LOAD_LAG_S * (
        gains.kp_nm_per_rad * np.abs(state.velocity_rad_s)
        + gains.kd_nm_s_per_rad * window.velocity_range_rad_s / window.duration_s
    )
    allowed = bounds.LOAD_NM + bounds.LOAD_SHARE * np.maximum(np.abs(least), np.abs(largest)) + lag
    # Less torque than was asked is what limits and weak motors do; it never turns round.
    low, high = np.minimum(least, 0.0) - allowed, np.maximum(largest, 0.0) + allowed
    return np.asarray((state.load_nm < low) | (state.load_nm > high))


def at_stop(position_rad: Array) -> NDArray[np.bool_]:
    """Joints that may lie on their stops, whose force their loads contain. Shape (12,)."""
    low, high = facts.POSITION_LOW_RAD + bounds.STOP_RAD, facts.POSITION_HIGH_RAD - bounds.STOP_RAD
    return np.asarray((position_rad < low) | (position_rad > high))


def motor_torque_nm(position_rad: Array) -> Array:
    """Most that the motors give at these positions: that of a knee depends on its lever. Shape (12,)."""
    most = np.full(facts.N_JOINTS, facts.HIP_TORQUE_LIMIT_NM)
    most[2::3] = np.interp(position_rad[2::3], KNEE_TABLE_POSITION_RAD, KNEE_TABLE_TORQUE_NM)
    return most


def torque_nm(command: JointCommand, position_rad: Array, velocity_rad_s: Array) -> Array:
    """What a command asks of the joints at these positions and velocities. Shape (12,)."""
    gains = command.gains
    torque = gains.kp_nm_per_rad * (command.position_rad - position_rad) + command.load_nm
    return np.asarray(torque - gains.kd_nm_s_per_rad * velocity_rad_s)


_NO_JOINTS: Final = np.zeros(facts.N_JOINTS)
_NO_LEGS: Final = np.zeros((facts.N_LEGS, facts.N_LEGS))


_NO_JOINT_COUNTS: Final = np.zeros(facts.N_JOINTS, dtype=np.int64)
_NO_LEG_COUNTS: Final = np.zeros(facts.N_LEGS, dtype=np.int64)


class AnswerMemory(NamedTuple):
    """Sums over a time that fades, N²·m²·s, and what they said."""

    felt_s: float = 0.0
    """Time over which these sums are taken; it fades as they do, s."""
    asked_asked: Array = _NO_JOINTS
    """Squares of the torque that was asked of each joint. Shape (12,)."""
    asked_load: Array = _NO_JOINTS
    """Its product with the measured load. Shape (12,)."""
    load_load: Array = _NO_JOINTS
    """Squares of that load. Shape (12,)."""
    unasked: Array = _NO_JOINTS
    """Load beside what was asked, within what the motors give, N·m·s. Shape (12,)."""
    given_given: Array = _NO_JOINTS
    """Squares of what was asked within that. Shape (12,)."""
    apart: Array = _NO_LEGS
    """Squares of what each leg would have been asked with the set-points of another, less what it was. Shape (4, 4)."""
    missed: Array = _NO_LEGS
    """Squares of each leg's loads, less what it would have been asked with the set-points of another. Shape (4, 4)."""
    wrong_windows: NDArray[np.int64] = _NO_JOINT_COUNTS
    """In a row in which the load turned against what was asked, far exceeded it, or lay beside it. Shape (12,)."""
    anothers_windows: NDArray[np.int64] = _NO_LEG_COUNTS
    """In a row in which a leg's loads answered another leg. Shape (4,)."""


def after_window(
    memory: AnswerMemory, window: Window, command: JointCommand, is_measured: NDArray[np.bool_]
) -> AnswerMemory:
    """The memory after one more window, given the newest command that the robot says it has.

    Where ``is_measured``, shape (12,), is False, a load repeats itself and says nothing about its joint.
    """
    state = window.last
    asked = torque_nm(command, state.position_rad, state.velocity_rad_s)
    most = motor_torque_nm(state.position_rad)
    given = np.minimum(np.maximum(asked, -most), most)
    load = np.where(is_measured, state.load_nm, given)
    apart = _apart(command)
    missed = _legs(load - asked)[:, np.newaxis] - apart
    fade = max(0.0, 1.0 - window.duration_s / bounds.ANSWER_MEMORY_S)

    def summed(before: Array, now: Array) -> Array:
        return before * fade + now * window.duration_s

    after = AnswerMemory(
        memory.felt_s * fade + window.duration_s,
        summed(memory.asked_asked, asked * asked),
        summed(memory.asked_load, asked * load),
        summed(memory.load_load, load * load),
        summed(memory.unasked, load - given),
        summed(memory.given_given, given * given),
        summed(memory.apart, (apart * apart).sum(axis=2)),
        summed(memory.missed, (missed * missed).sum(axis=2)),
    )
    if after.felt_s < bounds.ANSWER_LEAST_S:
        return after
    return after._replace(
        wrong_windows=np.where(_is_wrong(after), memory.wrong_windows + 1, 0),
        anothers_windows=np.where(_is_anothers(after), memory.anothers_windows + 1, 0),
    )


def _is_wrong(memory: AnswerMemory) -> NDArray[np.bool_]:
    is_known = memory.asked_asked >= bounds.ANSWER_NM**2 * memory.felt_s
    is_turned = is_known & ((memory.asked_load < 0.0) | (memory.asked_load > bounds.ANSWER_MOST * memory.asked_asked))
    allowed_nm = bounds.UNASKED_NM + bounds.UNASKED_SHARE * np.sqrt(memory.given_given / memory.felt_s)
    return is_turned | (np.abs(memory.unasked) > allowed_nm * memory.felt_s)


def _is_anothers(memory: AnswerMemory) -> NDArray[np.bool_]:
    """Whether another leg's set-points explain a leg's loads better than its own do, taken times any factor."""
    is_known = memory.apart >= len(facts.JOINT_TYPES) * bounds.ANSWER_NM**2 * memory.felt_s
    explained = memory.asked_load**2 / np.maximum(memory.asked_asked, 1e-9)
    own = _legs(memory.load_load - explained).sum(axis=1)
    return np.asarray((is_known & (memory.missed < own[:, np.newaxis])).any(axis=1))


def _apart(command: JointCommand) -> Array:
    """What leg a would be asked with leg b's set-points, less what it is asked: a, b, joint; N·m."""
    position, load, kp = (_legs(x) for x in (command.position_rad, command.load_nm, command.gains.kp_nm_per_rad))
    return kp[:, np.newaxis] * (position - position[:, np.newaxis]) + (load - load[:, np.newaxis])


def _legs(joints: Array) -> Array:
    return joints.reshape(facts.N_LEGS, len(facts.JOINT_TYPES))


_NO_COUNTS: Final = np.zeros(facts.N_JOINTS, dtype=np.int64)
_ALIKE: Final = 1.0 / 3.0
"""An angle within this share of the error is taken for the true one."""


class HoldMemory(NamedTuple):
    """What the loads have shown since joint control began."""

    windows: NDArray[np.int64] = _NO_COUNTS
    """In a row in which a load lay beside what was asked. Shape (12,)."""
    said_rad: Array = _NO_JOINTS
    """Mean reported position of the last window. Shape (12,)."""
    answers_rad: Array = _NO_JOINTS
    """Position by the servo law. Shape (12,)."""

    @property
    def is_wrong(self) -> NDArray[np.bool_]:
        """Joints whose servo acts on another position than the reported one. Shape (12,)."""
        return self.windows >= bounds.HELD_WINDOWS


def after_hold_window(
    memory: HoldMemory, states: Sequence[RobotState], command: JointCommand, is_measured: NDArray[np.bool_]
) -> HoldMemory:
    """The memory after one more window of states; arguments as in :func:`answer.after_window`."""
    position, velocity, load = (
        np.mean([getattr(state, name) for state in states], axis=0)
        for name in ("position_rad", "velocity_rad_s", "load_nm")
    )
    asked = torque_nm(command, position, velocity)
    unasked = load - asked
    is_beside = np.abs(unasked) > bounds.UNASKED_NM + bounds.UNASKED_SHARE * np.abs(asked)
    windows = np.where(is_measured & is_beside, memory.windows + 1, 0)
    return HoldMemory(windows, position, position - unasked / command.gains.kp_nm_per_rad)


def hold_words(memory: HoldMemory) -> str:
    """Which joints are wrong, where their servos see them, and what single error that looks like."""
    wrong = np.flatnonzero(memory.is_wrong)
    said, answers = memory.said_rad, memory.answers_rad

    def looks_like(joint: int) -> str:
        angles_rad = {", as if mirrored": -said[joint]}
        for other in wrong[wrong != joint]:
            angles_rad[f", as if exchanged with {facts.JOINT_NAMES[other]}"] = said[other]
        alike = min(angles_rad, key=lambda name: abs(answers[joint] - angles_rad[name]))
        is_alike = abs(answers[joint] - angles_rad[alike]) < _ALIKE * abs(answers[joint] - said[joint])
        return alike if is_alike else ""

    return "; ".join(
        f"{facts.JOINT_NAMES[joint]} reports {said[joint]:+.2f} rad and answers as at about {answers[joint]:+.2f}"
        + looks_like(int(joint))
        for joint in wrong
    )
