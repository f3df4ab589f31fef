"""The model that the diagnosis is given: every reality without its faults and small errors."""

from __future__ import annotations

from typing import Final

from spot_model import facts
from spot_model.effects.armature import Armature
from spot_model.effects.command_delay import CommandDelay
from spot_model.effects.coulomb_friction import CoulombFriction
from spot_model.effects.position_torque_limit import PositionTorqueLimit
from spot_model.effects.torque_limit import TorqueLimit
from spot_model.effects.torque_speed_curve import TorqueSpeedCurve
from spot_model.knee_table import KNEE_MOTOR_TORQUE_NM
from spot_model.model_file import RobotModel
from withheld.realities.transport import MEAN_DELAY_S

_PAPER: Final = facts.PAPER_IDENTIFIED

NOMINAL: Final = RobotModel(
    effects=(
        CoulombFriction(joints=("hips",), level_nm=_PAPER.hip_friction_nm),
        CoulombFriction(joints=("knees",), level_nm=_PAPER.knee_friction_nm),
        TorqueLimit(joints=("hips",), limit_nm=facts.HIP_TORQUE_LIMIT_NM),
        TorqueSpeedCurve(
            joints=("knees",),
            torque_max_nm=_PAPER.torque_max_nm,
            torque_min_nm=_PAPER.torque_min_nm,
            speed_max_rad_s=_PAPER.speed_max_rad_s,
            speed_min_rad_s=_PAPER.speed_min_rad_s,
            intersect_max_rad_s=_PAPER.intersect_max_rad_s,
            intersect_min_rad_s=_PAPER.intersect_min_rad_s,
        ),
        PositionTorqueLimit(motor_torque_nm=KNEE_MOTOR_TORQUE_NM),
        Armature(joints=("hips",), inertia_kg_m2=facts.HIP_ARMATURE_KG_M2),
        Armature(joints=("knees",), inertia_kg_m2=facts.KNEE_ARMATURE_KG_M2),
        CommandDelay(delay_s=round(MEAN_DELAY_S, 4)),
    )
)
