"""The model that the diagnosis is given: the published robot without faults and without ordinary errors."""

from __future__ import annotations

from typing import Final

from spot_model.effects.commands import CommandDelay
from spot_model.effects.friction import Armature
from spot_model.io.model_file import RobotModel, paper_model
from spot_model.robot import facts
from withheld.simulator.parameters import LinkParameters
from withheld.simulator.recording.transport import mean_delay_s

NOMINAL: Final = RobotModel(
    effects=(
        *(e for e in paper_model(facts.PAPER_IDENTIFIED).effects if not isinstance(e, CommandDelay)),
        Armature(joints=("hips",), inertia_kg_m2=facts.HIP_ARMATURE_KG_M2),
        Armature(joints=("knees",), inertia_kg_m2=facts.KNEE_ARMATURE_KG_M2),
        CommandDelay(delay_s=round(mean_delay_s(LinkParameters()), 4)),
    )
)
