"""Effects on the rigid bodies, the feet and the ground."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import ModelEffect, ModelFields, legs_of, parameter, per_sim
from spot_model.robot.arm import ARM_MASS_KG, STOWED_RAD, arm_as_one_body
from spot_model.robot.facts import JOINT_NAMES, JOINT_TYPES


@dataclass(frozen=True, kw_only=True)
class PayloadMass(ModelEffect):
    """A point mass fixed to the body, which also moves the centre of mass and adds inertia.

    Source: the paper randomises ±2.5 kg; Spot carries up to 14 kg.
    """

    name: ClassVar[str] = "payload_mass"

    mass_kg: Any = parameter(null=0.0, low=-5.0, high=20.0, unit="kg", source="the paper ±2.5 kg; data sheet 14 kg")
    x_m: Any = parameter(null=0.0, low=-0.5, high=0.5, unit="m", source="rails on the back")
    y_m: Any = parameter(null=0.0, low=-0.2, high=0.2, unit="m", source="rails on the back")
    z_m: Any = parameter(null=0.0, low=-0.3, high=0.5, unit="m", source="rails on the back")

    def edit(self, fields: ModelFields) -> None:
        """Add the mass."""
        _add_to_body(fields, self.mass_kg, (self.x_m, self.y_m, self.z_m))


def _add_to_body(
    fields: ModelFields, added_kg: Any, place_m: tuple[Any, Any, Any], own_m2: tuple[float, ...] = (0.0, 0.0, 0.0)
) -> None:
    """Add a mass at a place and its own inertia, m² a kilogram, about the principal axes (parallel-axis theorem)."""
    body = fields.body_id("body")
    mass, com, inertia = fields["body_mass"], fields["body_ipos"], fields["body_inertia"]
    old = mass[:, body] + 0.0
    added = per_sim(added_kg) + 0.0 * old
    new = old + added
    reduced = old * added / new
    offsets = [per_sim(v) - com[:, body, axis] for axis, v in enumerate(place_m)]
    for axis in range(3):
        others = [offsets[k] for k in range(3) if k != axis]
        inertia[:, body, axis] += reduced * (others[0] * others[0] + others[1] * others[1]) + added * own_m2[axis]
        com[:, body, axis] += offsets[axis] * added / new
    mass[:, body] += added


_STOWED = arm_as_one_body(STOWED_RAD)


@dataclass(frozen=True, kw_only=True)
class StowedArm(ModelEffect):
    """Spot's arm, stowed, as a rigid part of the body: its mass, with its inertia, over the front of the back.

    Stiff servos hold its joints, so that it moves with the body. A model of ``robot: spot_with_arm`` has it.

    Source: the links of the vendor's published model, 7.47 kg; data sheet 8 kg with the gripper.
    """

    name: ClassVar[str] = "stowed_arm"

    mass_kg: Any = parameter(null=0.0, low=0.0, high=15.0, unit="kg", source="published model 7.47 kg")

    def edit(self, fields: ModelFields) -> None:
        """Add the arm; its products of inertia, under 2 % of its moments, are left out."""
        own_m2 = tuple(moment / ARM_MASS_KG for moment in _STOWED.inertia_kg_m2[:3])
        _add_to_body(fields, self.mass_kg, _STOWED.com_m, own_m2)

    @staticmethod
    def published() -> StowedArm:
        """The arm as it is published."""
        return StowedArm(mass_kg=round(ARM_MASS_KG, 3))


@dataclass(frozen=True, kw_only=True)
class ComOffset(ModelEffect):
    """The body's centre of mass is moved; its mass and inertia stay.

    Source: batteries, payload rails and cables move it by centimetres.
    """

    name: ClassVar[str] = "com_offset"

    x_m: Any = parameter(null=0.0, low=-0.2, high=0.2, unit="m", source="0 to 5 cm")
    y_m: Any = parameter(null=0.0, low=-0.1, high=0.1, unit="m", source="0 to 5 cm")
    z_m: Any = parameter(null=0.0, low=-0.1, high=0.1, unit="m", source="0 to 5 cm")

    def edit(self, fields: ModelFields) -> None:
        """Move the body's centre of mass."""
        com = fields["body_ipos"]
        body = fields.body_id("body")
        for axis, value in enumerate((self.x_m, self.y_m, self.z_m)):
            com[:, body, axis] += per_sim(value)


@dataclass(frozen=True, kw_only=True)
class BodyInertia(ModelEffect):
    """The body's principal inertias are scaled.

    Source: CAD inertias are off by up to 20 %.
    """

    name: ClassVar[str] = "body_inertia"

    scale: Any = parameter(null=1.0, low=0.3, high=3.0, unit="1", source="0.8 to 1.2")

    def edit(self, fields: ModelFields) -> None:
        """Scale the inertias."""
        inertia = fields["body_inertia"]
        body = fields.body_id("body")
        for axis in range(3):
            inertia[:, body, axis] *= per_sim(self.scale)


LINK_OF_JOINT = dict(zip(JOINT_TYPES, ("hip", "uleg", "lleg"), strict=True))
"""Which link each joint type moves, as named in the MuJoCo model."""


@dataclass(frozen=True, kw_only=True)
class LegMass(ModelEffect):
    """Mass of the links that the chosen joints move is scaled.

    The added mass is spread as the link's own mass is. With ``down_m`` it is a point so far down from the link's joint,
    such as a boot or a weight strapped on, which adds hardly any inertia of its own.

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


@dataclass(frozen=True, kw_only=True)
class FootRadius(ModelEffect):
    """The foot sphere's radius changes; its centre stays. Acts on the legs of ``joints``.

    Source: rubber feet wear by millimetres.
    """

    name: ClassVar[str] = "foot_radius"

    change_m: Any = parameter(null=0.0, low=-0.02, high=0.02, unit="m", source="wear, ±5 mm")

    def edit(self, fields: ModelFields) -> None:
        """Change the radius."""
        size = fields["geom_size"]
        for leg in legs_of(self.mask):
            size[:, fields.geom_id(f"{leg}_foot"), 0] += per_sim(self.change_m)


@dataclass(frozen=True, kw_only=True)
class GroundFriction(ModelEffect):
    """The sliding friction coefficient between foot and ground, 0.8 in the simulator, is scaled.

    Acts on the legs of ``joints``.

    Source: the paper randomises static friction in 0.3 to 1.0.
    """

    name: ClassVar[str] = "ground_friction"

    scale: Any = parameter(null=1.0, low=0.05, high=3.0, unit="1", source="coefficients 0.3 to 1.0")

    def edit(self, fields: ModelFields) -> None:
        """Scale the feet's friction, which the contact takes over the ground's."""
        friction = fields["geom_friction"]
        for leg in legs_of(self.mask):
            friction[:, fields.geom_id(f"{leg}_foot"), 0] *= per_sim(self.scale)


STIFFEST_S = 1e-3
"""Shortest time constant of a contact; MuJoCo itself takes no less than two physics steps."""


@dataclass(frozen=True, kw_only=True)
class GroundCompliance(ModelEffect):
    """Another time constant of the contact of the legs of ``joints``: with a longer one it gives way further and later.

    Source: MuJoCo ``geom_solref``; grass, mats and rubber, 20 to 200 kN/m.
    """

    name: ClassVar[str] = "ground_compliance"

    time_constant_s: Any = parameter(null=0.0, low=-0.015, high=0.2, unit="s", source="added to the contact's 0.02 s")
    damping_ratio: Any = parameter(null=0.0, low=-0.8, high=4.0, unit="1", source="added to the contact's 1")

    def edit(self, fields: ModelFields) -> None:
        """Add to the feet's contact, which stays above 0: MuJoCo reads a negative one as a stiffness."""
        solref = fields["geom_solref"]
        for leg in legs_of(self.mask):
            foot = fields.geom_id(f"{leg}_foot")
            solref[:, foot, 0] = (solref[:, foot, 0] + per_sim(self.time_constant_s)).clip(min=STIFFEST_S)
            solref[:, foot, 1] += per_sim(self.damping_ratio)
