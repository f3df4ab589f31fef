"""The model that the diagnosis is given: every reality without its faults and small errors."""

from __future__ import annotations

from typing import Final

from spot_model.effects.command.command_delay import CommandDelay
from spot_model.effects.drive.armature import Armature
from spot_model.io.model_file import RobotModel, paper_model
from spot_model.robot import facts
from withheld.realities.transport import MEAN_DELAY_S

NOMINAL: Final = RobotModel(
    effects=(
        *(e for e in paper_model(facts.PAPER_IDENTIFIED).effects if not isinstance(e, CommandDelay)),
        Armature(joints=("hips",), inertia_kg_m2=facts.HIP_ARMATURE_KG_M2),
        Armature(joints=("knees",), inertia_kg_m2=facts.KNEE_ARMATURE_KG_M2),
        CommandDelay(delay_s=round(MEAN_DELAY_S, 4)),
    )
)
