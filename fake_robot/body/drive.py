"""From set-points to motor torque at one physics step: what the servos follow, their law, then the torque effects."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from spot_model.effects.base import IdleBox, JointReading, Motion, TorqueEffect
from spot_model.plant.command_channel import ServoCommand
from spot_model.plant.effect_chains import TorqueChain
from spot_model.robot import facts
from spot_model.robot.control import pd_torque
from spot_model.robot.facts import KNEE_TABLE_TORQUE_NM, N_JOINTS, Array

LOAD_LIMIT_NM: Final[Array] = facts.per_joint(
    facts.HIP_TORQUE_LIMIT_NM, facts.HIP_TORQUE_LIMIT_NM, float(np.max(KNEE_TABLE_TORQUE_NM))
)
"""A feed-forward load saturates here: the hips' limit, and the knee's at its best angle. Shape (12,)."""

_ZERO: Final[Array] = np.zeros((1, facts.N_JOINTS))
_STAND_KP: Final[Array] = facts.STAND_KP_NM_PER_RAD[np.newaxis]
_STAND_KD: Final[Array] = facts.STAND_KD_NM_S_PER_RAD[np.newaxis]


def damping_servo(damping_nm_s_per_rad: float) -> ServoCommand:
    """Servos that only brake."""
    return ServoCommand(_ZERO, _ZERO, _ZERO, _ZERO, np.full((1, facts.N_JOINTS), damping_nm_s_per_rad))


def torque_servo(load_nm: Array) -> ServoCommand:
    """Servos that give a fixed torque, shape (12,)."""
    return ServoCommand(_ZERO, _ZERO, load_nm[np.newaxis].copy(), _ZERO, _ZERO)


def stand_servo(position_rad: Array, load_nm: Array | None = None) -> ServoCommand:
    """Servos with the gains of the vendor's own stand; arguments of shape (12,), kept and not copied."""
    load = _ZERO if load_nm is None else load_nm[np.newaxis]
    return ServoCommand(position_rad[np.newaxis], _ZERO, load, _STAND_KP, _STAND_KD)


class Drive:
    """The drives of one robot.

    The effects cost more than the physics. While every joint stays inside the idle boxes of all effects none of them
    changes a bit, so they are left out; the result is the same bit for bit.
    """

    def __init__(self, effects: Sequence[TorqueEffect]) -> None:
        self._chain = TorqueChain(effects, np.zeros((1, N_JOINTS)))
        boxes = [(effect.idle_box(), effect.mask) for effect in effects]
        self._can_idle = all(box is not None for box, _ in boxes)
        # Rows: torque, velocity, position.
        self._low = np.full((3, N_JOINTS), -np.inf)
        self._high = np.full((3, N_JOINTS), np.inf)
        for box, mask in boxes:
            if box is not None:
                low, high = _rows(box)
                self._low = np.where(mask, np.maximum(self._low, low), self._low)
                self._high = np.where(mask, np.minimum(self._high, high), self._high)
        self._now = np.empty((3, N_JOINTS))

    def torque_nm(self, servo: ServoCommand, motion: Motion, reading: JointReading | Motion) -> Array:
        """Motor torque at this physics step, shape (1, 12), N·m."""
        own_damping = isinstance(reading, JointReading) and reading.servo_velocity_rad_s is not None
        if not self._can_idle or own_damping:
            return np.asarray(self._chain.torque_nm(servo, motion, reading))
        torque: Array = pd_torque(
            position_rad=reading.position_rad,
            velocity_rad_s=reading.velocity_rad_s,
            setpoint_position_rad=servo.position_rad,
            setpoint_velocity_rad_s=servo.velocity_rad_s,
            feedforward_nm=servo.load_nm,
            kp_nm_per_rad=servo.kp_nm_per_rad,
            kd_nm_s_per_rad=servo.kd_nm_s_per_rad,
        )
        now = self._now
        now[0], now[1], now[2] = torque, motion.velocity_rad_s, motion.position_rad
        if (now > self._high).any() or (now < self._low).any():
            return np.asarray(self._chain.torque_nm(servo, motion, reading))
        return torque

    def reset(self) -> None:
        """Start the effects' memories afresh."""
        self._chain.reset_from_rest(np.array([True]))


def _rows(box: IdleBox) -> tuple[Array, Array]:
    both = np.array([box.torque_nm, box.velocity_rad_s, box.position_rad])
    return both[:, :1], both[:, 1:]
