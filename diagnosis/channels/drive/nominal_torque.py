"""What the nominal model makes of a requested torque: its torque effects, then what friction and inertia take away."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from diagnosis.channels.channel_view import Array, Ints
from spot_model.effects.base import Effect, LossMotion, Motion, TorqueEffect
from spot_model.effects.friction import has_joint_loss, joint_losses_nm, smooth_sign
from spot_model.errors import BadInputError
from spot_model.robot import facts

FRICTION_SPEED_RAD_S: Final = 0.05
"""Over about this speed the direction of motion counts as known; dry friction is smoothed within."""


def nominal_torque_nm(
    effects: Sequence[Effect],
    request_nm: Array,
    position_rad: Array,
    velocity_rad_s: Array,
    starts: Ints,
    period_s: float,
) -> Array:
    """Motor torque of the nominal model.

    Args:
        effects: The nominal model's.
        request_nm: The servo law's torque. Shape (N, J).
        position_rad: Shape (N, J).
        velocity_rad_s: Shape (N, J).
        starts: First row of each recording: memories start afresh there.
        period_s: Time between rows.

    Raises:
        BadInputError: There are torque effects, and the robot has not Spot's joints.
    """
    torque = request_nm
    for effect in effects:
        if not isinstance(effect, TorqueEffect) or effect.is_null:
            continue
        if request_nm.shape[1] != facts.N_JOINTS:
            raise BadInputError(
                f"the nominal model has effect {effect.name}, and the log {request_nm.shape[1]} joints; effects of a "
                f"nominal model are for Spot's {facts.N_JOINTS}: give a model without effects"
            )
        torque = _applied(effect, torque, position_rad, velocity_rad_s, starts, period_s)
    return torque


def nominal_load_nm(effects: Sequence[Effect], torque_nm: Array, velocity_rad_s: Array) -> Array:
    """Load at the link without what accelerates the armature: motor torque less the model's friction, shape (N, J)."""
    losing = [effect for effect in effects if has_joint_loss(effect)]
    if not losing:
        return torque_nm
    motion = LossMotion(velocity_rad_s, np.zeros_like(velocity_rad_s), direction(velocity_rad_s))
    return np.asarray(torque_nm - joint_losses_nm(losing, motion))


def nominal_armature_kg_m2(effects: Sequence[Effect], n_joints: int) -> Array:
    """Armature of the nominal model, shape (J,)."""
    losing = [effect for effect in effects if has_joint_loss(effect)]
    still = np.zeros((1, n_joints))
    return np.asarray(joint_losses_nm(losing, LossMotion(still, still + 1.0, still))[0])


def direction(velocity_rad_s: Array) -> Array:
    """Sign of a velocity, smooth near zero; same shape."""
    return np.asarray(smooth_sign(velocity_rad_s, FRICTION_SPEED_RAD_S))


def presliding(position_rad: Array, starts: Ints, distance_rad: float) -> Array:
    """Dry friction over its level, as it builds up over a distance after each reversal (Dahl); same shape.

    Args:
        position_rad: Shape (N, J).
        starts: First row of each recording.
        distance_rad: Over which a contact that sticks gives way, > 0.
    """
    moved = np.diff(position_rad, axis=0, prepend=position_rad[:1])
    moved[starts] = 0.0
    towards, keep = np.sign(moved), np.exp(-np.abs(moved) / distance_rad)
    out = np.empty_like(position_rad)
    first = set(starts.tolist())
    held = np.zeros(position_rad.shape[1])
    for i in range(len(out)):
        held = np.zeros_like(held) if i in first else towards[i] + (held - towards[i]) * keep[i]
        out[i] = held
    return out


def _applied(
    effect: TorqueEffect, torque: Array, position: Array, velocity: Array, starts: Ints, period_s: float
) -> Array:
    ready = effect.arrays_like(torque)
    mask = None if effect.mask.all() else effect.mask
    memory = ready.start(torque[:1])
    if not _carries(ready, torque[:1], period_s):
        return np.asarray(ready.apply(torque, Motion(position, velocity, period_s), memory, mask)[0])
    out = np.empty_like(torque)
    bounds = [*starts.tolist(), len(torque)]
    for first, end in pairwise(bounds):
        memory = ready.start(torque[first : first + 1])
        for i in range(first, end):
            motion = Motion(position[i : i + 1], velocity[i : i + 1], period_s)
            out[i : i + 1], memory = ready.apply(torque[i : i + 1], motion, memory, mask)
    return out


def _carries(effect: TorqueEffect, torque: Array, period_s: float) -> bool:
    """Whether the effect carries anything from one step to the next: its memory changes when it is used."""
    memory = effect.start(torque)
    _, after = effect.torque(torque + 1.0, Motion(torque * 0.0, torque * 0.0 + 1.0, period_s), memory)
    return after is not memory
