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
    """Mass of the links that the chosen joints move is scaled.

    What is added is spread as the link's own mass is, or, with ``down_m``, a point so far down from the link's joint: a
    boot or a weight strapped on, which adds hardly any inertia of its own.

    Source: cables, boots and covers; CAD masses are off by up to 20 %. A lower leg has 0.33 kg, so a boot doubles it.
    """

    name: ClassVar[str] = "leg_mass"

    scale: Any = parameter(null=1.0, low=0.3, high=5.0, unit="1", source="0.8 to 1.2; a boot 2 to 3")
    down_m: Any = parameter(null=0.0, low=0.0, high=0.4, unit="m", source="a link is 0.32 m long; 0: spread")

    def edit(self, fields: ModelFields) -> None:
        """Scale mass and inertia, or add a point (parallel-axis theorem about the principal axes)."""
        mass, com, inertia = fields["body_mass"], fields["body_ipos"], fields["body_inertia"]
        for joint, chosen in zip(JOINT_NAMES, self.mask, strict=True):
            if chosen:
                leg, kind = joint.split("_")
                link = fields.body_id(f"{leg}_{LINK_OF_JOINT[kind]}")
                scale = per_sim(self.scale) + 0.0 * mass[:, link]
                is_point = (per_sim(self.down_m) > 0.0) + 0.0 * scale
                place = (0.0, 0.0, -per_sim(self.down_m))
                offsets = [is_point * (p - com[:, link, axis]) for axis, p in enumerate(place)]
                added = (scale - 1.0) * mass[:, link]
                reduced = added / scale
                for axis in range(3):
                    one, two = (offsets[k] for k in range(3) if k != axis)
                    inertia[:, link, axis] *= 1.0 + (1.0 - is_point) * (scale - 1.0)
                    inertia[:, link, axis] += reduced * (one * one + two * two)
                for axis in range(3):
                    com[:, link, axis] += offsets[axis] * added / (scale * mass[:, link])
                mass[:, link] *= scale
