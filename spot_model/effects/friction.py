"""The direction of dry friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Final

from spot_model.effects.base import Memory, ModelEffect, ModelFields, Motion, TorqueEffect, parameter
from spot_model.robot.arrays import namespace_of
from spot_model.robot.rotation import AnyArray

STICK_SPEED_RAD_S: Final = 0.1
"""Below this speed the sign of the velocity is smoothed, so that a still joint is not shaken."""


def smooth_sign(velocity_rad_s: AnyArray, speed_rad_s: float = STICK_SPEED_RAD_S) -> AnyArray:
    """Sign of a velocity, smooth over ``speed_rad_s`` about zero; any shape."""
    return namespace_of(velocity_rad_s).tanh(velocity_rad_s / speed_rad_s)


def built_up(direction: AnyArray, velocity_rad_s: AnyArray, dt_s: float, distance_rad: Any) -> AnyArray:
    """Direction of dry friction after one more step; it builds up over a distance after a reversal, and holds at rest.

    Exact for a velocity that is constant over the step. Source: Dahl 1968.

    Args:
        direction: Before the step, -1 to 1.
        velocity_rad_s: Same shape.
        dt_s: Length of the step.
        distance_rad: Over which a contact that sticks gives way, > 0.
    """
    xp = namespace_of(velocity_rad_s)
    towards = xp.sign(velocity_rad_s)
    return towards + (direction - towards) * xp.exp(-xp.abs(velocity_rad_s) * dt_s / distance_rad)


@dataclass(frozen=True, kw_only=True)
class CoulombFriction(ModelEffect):
    """Friction torque that opposes motion up to a constant level.

    Source: the paper's friction parameters (hips 0.008, knees 0.180 N·m identified); MuJoCo ``dof_frictionloss``.
    """

    name: ClassVar[str] = "coulomb_friction"

    level_nm: Any = parameter(null=0.0, low=0.0, high=5.0, unit="N·m", source="the paper's optimised parameters")

    def edit(self, fields: ModelFields) -> None:
        """Add the friction level to the model's friction loss."""
        loss = fields["dof_frictionloss"]
        loss[:, fields.joint_dofs] += self.level_nm * self.mask


@dataclass(frozen=True, kw_only=True)
class ViscousFriction(ModelEffect):
    """Torque loss proportional to joint speed; at fixed gains the same as a larger kd.

    Source: MuJoCo ``dof_damping``; 0.02 to 0.3 N·m·s/rad is usual for geared legs (public fits of a Go2: 0.15 to 0.26).
    """

    name: ClassVar[str] = "viscous_friction"

    damping_nm_s_per_rad: Any = parameter(
        null=0.0, low=0.0, high=5.0, unit="N·m·s/rad", source="joint fits, 0.02 to 0.3"
    )

    def edit(self, fields: ModelFields) -> None:
        """Add the damping to the model's."""
        damping = fields["dof_damping"]
        damping[:, fields.joint_dofs] += self.damping_nm_s_per_rad * self.mask


@dataclass(frozen=True, kw_only=True)
class StribeckFriction(TorqueEffect):
    """Torque loss F·exp(−(q̇/v)²)·d, on top of any Coulomb friction, with d the direction in which the joint last moved.

    d builds up over a short distance after each reversal, so a joint at rest is held.

    Source: the Stribeck curve (Armstrong-Hélouvry et al. 1994); +20 to 100 % of Coulomb, v 0.05 to 1 rad/s.
    """

    name: ClassVar[str] = "stribeck_friction"

    level_nm: Any = parameter(null=0.0, low=0.0, high=10.0, unit="N·m", source="20 to 100 % of Coulomb friction")
    speed_rad_s: Any = parameter(null=0.5, low=0.05, high=5.0, unit="rad/s", source="0.05 to 1 rad/s")

    builds_up_rad: Any = parameter(
        null=0.0015, low=1e-4, high=0.1, unit="rad", source="presliding of gears, 0.001 to 0.01 rad"
    )

    def start(self, torque_nm: AnyArray) -> Memory:
        """At rest, and held by nothing yet."""
        return namespace_of(torque_nm).zeros_like(torque_nm)

    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """Subtract the friction."""
        xp = namespace_of(torque_nm)
        ratio = motion.velocity_rad_s / self.speed_rad_s
        held = built_up(memory, motion.velocity_rad_s, motion.dt_s, self.builds_up_rad)
        return torque_nm - self.level_nm * xp.exp(-ratio * ratio) * held, held


@dataclass(frozen=True, kw_only=True)
class LoadFriction(TorqueEffect):
    """Loss of k times the torque that the gear passes on, against the motion: a gear's efficiency.

    Of a motor's torque τ it passes on g = τ − k·|g|·sign(q̇), so g = τ/(1 + k·sign(τ·q̇)): less than τ where the motor
    drives, more where the load drives it back.

    Source: load-dependent friction models of geared actuators (BAM, arXiv 2410.08650); 2 to 10 %, and 10 to 25 %
    in lead screws.
    """

    name: ClassVar[str] = "load_friction"

    share: Any = parameter(null=0.0, low=0.0, high=0.9, unit="1", source="gears 0.02 to 0.10, lead screws 0.10 to 0.25")

    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """What is passed on."""
        xp = namespace_of(torque_nm)
        return torque_nm / (1.0 + self.share * xp.sign(torque_nm) * smooth_sign(motion.velocity_rad_s)), memory


@dataclass(frozen=True, kw_only=True)
class Armature(ModelEffect):
    """Torque lost to accelerate the rotor, −I·q̈; a sensor behind the gear does not see it.

    Source: rotor inertia × gear ratio²; public estimates for Spot 0.040 (hips) and 0.073 kg·m² (knees).
    """

    name: ClassVar[str] = "armature"

    inertia_kg_m2: Any = parameter(
        null=0.0, low=0.0, high=0.5, unit="kg·m²", source="gear ratio² × rotor, 0.01 to 0.08"
    )

    def edit(self, fields: ModelFields) -> None:
        """Add the inertia to the model's armature."""
        armature = fields["dof_armature"]
        armature[:, fields.joint_dofs] += self.inertia_kg_m2 * self.mask
