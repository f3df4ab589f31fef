"""Predicted load at a sample: servo law, the model's torque effects, and what friction and inertia take away."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from spot_model import facts
from spot_model.effects.armature import Armature
from spot_model.effects.base import Effect, Motion, TorqueEffect
from spot_model.effects.coulomb_friction import CoulombFriction
from spot_model.effects.viscous_friction import ViscousFriction
from spot_model.joints import select_joints
from trainer.sysid.space import SearchSpace
from trainer.sysid.torque_samples import TorqueSamples

Array = NDArray[np.float64]

NUISANCE_NAMES: Final = (
    "time offset",
    "hip viscosity",
    "knee viscosity",
    "hip inertia",
    "knee inertia",
    "hip friction while turning",
    "knee friction while turning",
)
"""Numbers that are fitted beside the searched ones, so that what the model lacks does not bend them."""

NUISANCE_SCALE: Final = np.array([1e-3, 0.1, 0.1, 0.02, 0.02, 0.1, 0.1])
"""Their usual sizes: s, then twice each N·m·s/rad, kg·m², N·m."""

MIN_SPEED_RAD_S: Final = 0.3
"""A slower joint may stick: its friction has no known size, and none is predicted."""
TURNING_TIME_S: Final = 0.03
"""A joint that at its present acceleration would come to rest sooner is turning: the same holds for it."""
STEADY_RAD_S2: Final = 60.0
"""So does it for a joint that accelerates more than this, whose inertia outweighs its friction by far."""


@dataclass(frozen=True)
class TorqueModel:
    """Predicts load for values of a search space's parameters."""

    space: SearchSpace

    def covered(self) -> NDArray[np.bool_]:
        """Which parameters this prediction depends on by its form, shape (n,).

        An effect that carries something from one step to the next is not among them: samples stand alone here.
        """
        effects = self.space.model.effects
        return np.array([_covers(effects[p.effect_index]) for p in self.space.parameters])

    def load_nm(self, samples: TorqueSamples, values: Array, nuisance: Array) -> Array:
        """Predicted load.

        Args:
            samples: n rows.
            values: Parameters of the search space. Shape (n_parameters,).
            nuisance: In the order of :data:`NUISANCE_NAMES`. The time offset is how much earlier than the sampled
                motion the torque was made.

        Returns:
            Shape (n, 12), N·m.
        """
        offset_s = nuisance[0]
        acceleration = samples.acceleration_rad_s2
        velocity = samples.velocity_rad_s - offset_s * acceleration
        position = samples.position_rad - offset_s * samples.velocity_rad_s
        torque = samples.kp_nm_per_rad * (samples.setpoint_rad - position) - samples.kd_nm_s_per_rad * velocity
        motion = Motion(position, velocity, facts.STATE_PERIOD_NS * 1e-9)
        effects = self.space.effects(values[None, :])
        for effect in effects:
            if isinstance(effect, TorqueEffect) and not effect.is_null and is_memoryless(effect):
                ready = effect.arrays_like(torque)
                torque, _ = ready.apply(torque, motion, ready.start(torque), effect.mask)
        viscosity = _by_joint(nuisance[1], nuisance[2])
        level = np.zeros(facts.N_JOINTS)
        for effect in effects:
            if isinstance(effect, CoulombFriction):
                level = level + np.ravel(effect.level_nm)[0] * effect.mask
            elif isinstance(effect, ViscousFriction):
                viscosity = viscosity + np.ravel(effect.damping_nm_s_per_rad)[0] * effect.mask
        inertia = self.inertia_kg_m2(values, nuisance)
        steady = friction_direction(velocity, acceleration)
        turning = np.sign(velocity) - steady
        friction = level * steady + _by_joint(nuisance[5], nuisance[6]) * turning
        return np.asarray(torque - friction - viscosity * velocity - inertia * acceleration)

    def inertia_kg_m2(self, values: Array, nuisance: Array) -> Array:
        """Inertia between motor and torque sensor, shape (12,), kg·m²."""
        inertia = _by_joint(nuisance[3], nuisance[4])
        for effect in self.space.effects(values[None, :]):
            if isinstance(effect, Armature):
                inertia = inertia + np.ravel(effect.inertia_kg_m2)[0] * effect.mask
        return inertia


def friction_direction(velocity_rad_s: Array, acceleration_rad_s2: Array) -> Array:
    """Sign of the velocity where dry friction surely has its full size against it, 0 elsewhere. Any shape.

    Left at 0 are slow joints, and those in an impact or at a reversal, where the friction of a real joint is not
    fully built up, and where a simulator's friction constraint opposes the impact and not the motion. There the
    friction has a size of its own, a nuisance.
    """
    speed = np.abs(velocity_rad_s)
    slow_change = np.abs(acceleration_rad_s2) < np.minimum(speed / TURNING_TIME_S, STEADY_RAD_S2)
    steady = (speed > MIN_SPEED_RAD_S) & slow_change
    return np.asarray(np.sign(velocity_rad_s) * steady)


def is_memoryless(effect: TorqueEffect) -> bool:
    """Whether an effect hands its memory on unchanged, so that a sample needs nothing from the one before."""
    probe = np.array([np.full(facts.N_JOINTS, 30.0), np.full(facts.N_JOINTS, -30.0)])
    ready = effect.arrays_like(probe)
    memory = ready.start(probe)
    motion = Motion(np.tile(facts.DEFAULT_POSITION_RAD, (2, 1)), 0.1 * probe, 0.003)
    return ready.torque(probe, motion, memory)[1] is memory


def _covers(effect: Effect) -> bool:
    if isinstance(effect, (CoulombFriction, ViscousFriction, Armature)):
        return True
    return isinstance(effect, TorqueEffect) and is_memoryless(effect)


def _by_joint(hip: float, knee: float) -> Array:
    return np.where(select_joints(("knees",)), knee, hip)
