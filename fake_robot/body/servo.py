"""What the joint servos follow at one physics step."""

from __future__ import annotations

from typing import Final

import numpy as np

from spot_model.plant.command_channel import ServoCommand
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.knee_table import KNEE_TABLE_TORQUE_NM

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
