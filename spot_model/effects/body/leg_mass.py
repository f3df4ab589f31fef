"""Leg links heavier or lighter than the model's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import ModelEffect, ModelFields, parameter, per_sim
from spot_model.robot.facts import JOINT_NAMES, JOINT_TYPES

LINK_OF_JOINT = dict(zip(JOINT_TYPES, ("hip", "uleg", "lleg"), strict=True))
"""Which link each joint type moves, as named in the MuJoCo model."""


@dataclass(frozen=True, kw_only=True)
class LegMass(ModelEffect):
    """Mass and inertia of the links that the chosen joints move are scaled together.

    Source: cables, boots and covers; CAD masses are off by up to 20 %.
    """

    name: ClassVar[str] = "leg_mass"

    scale: Any = parameter(null=1.0, low=0.3, high=5.0, unit="1", source="0.8 to 1.2")

    def edit(self, fields: ModelFields) -> None:
        """Scale mass and inertia."""
        mass, inertia = fields["body_mass"], fields["body_inertia"]
        for joint, chosen in zip(JOINT_NAMES, self.mask, strict=True):
            if chosen:
                leg, kind = joint.split("_")
                link = fields.body_id(f"{leg}_{LINK_OF_JOINT[kind]}")
                mass[:, link] *= per_sim(self.scale)
                for axis in range(3):
                    inertia[:, link, axis] *= per_sim(self.scale)
