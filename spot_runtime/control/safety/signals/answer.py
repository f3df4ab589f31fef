"""Loads as answers: to what was asked of their own joints, and not of another leg's."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot_model.robot import facts
from spot_model.robot.state import Array, JointCommand
from spot_runtime.control.safety.signals import bounds
from spot_runtime.control.safety.signals.load import motor_torque_nm, torque_nm
from spot_runtime.control.safety.signals.window import Window

_NO_JOINTS: Final = np.zeros(facts.N_JOINTS)
_NO_LEGS: Final = np.zeros((facts.N_LEGS, facts.N_LEGS))


_NO_JOINT_COUNTS: Final = np.zeros(facts.N_JOINTS, dtype=np.int64)
_NO_LEG_COUNTS: Final = np.zeros(facts.N_LEGS, dtype=np.int64)


class AnswerMemory(NamedTuple):
    """Sums over a time that fades, N²·m²·s, and what they said."""

    felt_s: float = 0.0
    """That time."""
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
    """The memory after one more window.

    Args:
        memory: Before it.
        window: The states.
        command: The newest that the robot says it has.
        is_measured: Joints whose load lives; one that repeats itself says nothing about its joint. Shape (12,).
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
