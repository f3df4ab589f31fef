"""What effects make of a requested torque, without a simulation: the effects' own formulas on the logged motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from spot_model.effects.base import Effect, Motion, TorqueEffect
from spot_model.effects.friction import smooth_sign
from spot_model.errors import BadInputError
from spot_model.robot import facts
from spot_model.robot.facts import Array

Ints = NDArray[np.intp]

FRICTION_SPEED_RAD_S: Final = 0.05
"""Over about this speed the direction of motion counts as known; dry friction is smoothed within."""


def nominal_torque_nm(
    effects: Sequence[Effect], request_nm: Array, position_rad: Array, velocity_rad_s: Array, run: Ints, period_s: float
) -> Array:
    """Motor torque of the nominal model, of the servo law's request; arguments as of :func:`torque_after_nm`.

    Raises:
        BadInputError: There are torque effects, and the robot has not Spot's joints.
    """
    torque = request_nm
    for effect in effects:
        if isinstance(effect, TorqueEffect) and not effect.is_null:
            check_joints(effect, request_nm.shape[1])
            changed = torque_after_nm(effect, torque, position_rad, velocity_rad_s, run, period_s)
            torque = np.where(effect.mask, changed, torque)
    return torque


def check_joints(effect: Effect, n_joints: int) -> None:
    """Raise :class:`BadInputError` if a nominal model's effect meets a robot without Spot's joints."""
    if n_joints != facts.N_JOINTS:
        raise BadInputError(
            f"the nominal model has effect {effect.name}, and the log {n_joints} joints; effects of a nominal model "
            f"are for Spot's {facts.N_JOINTS}: give a model without effects"
        )


def torque_after_nm(
    effect: TorqueEffect, torque_nm: Array, position_rad: Array, velocity_rad_s: Array, run: Ints, period_s: float
) -> Array:
    """The effect's formula at every joint, recordings side by side where it carries something from step to step.

    Signals and result have shape (N, J); ``run`` is the recording of each row, rising, shape (N,). The effect's
    parameters are numbers, or arrays of shape (12,).
    """
    ready = effect.arrays_like(torque_nm)
    if effect.is_memoryless:
        motion = Motion(position_rad, velocity_rad_s, period_s)
        return np.asarray(ready.torque(torque_nm, motion, ready.start(torque_nm))[0])
    (torque, position, velocity), place = runs_side_by_side(run, torque_nm, position_rad, velocity_rad_s)
    out, memory = np.empty_like(torque), ready.start(torque[0])
    for k in range(len(out)):
        out[k], memory = ready.torque(torque[k], Motion(position[k], velocity[k], period_s), memory)
    return np.asarray(out[place])


def runs_side_by_side(run: Ints, *values: Array) -> tuple[Array, tuple[Ints, Ints]]:
    """Recordings beside each other, zero after their ends, so that one step serves all; values of shape (N, J).

    Returns:
        Shape (number of values, longest recording, number of recordings, J), and the place of each row in it.
    """
    numbers, first, sizes = np.unique(run, return_index=True, return_counts=True)
    place = np.arange(len(run)) - np.repeat(first, sizes), np.repeat(np.arange(len(numbers)), sizes)
    out = np.zeros((len(values), int(sizes.max()), len(numbers), values[0].shape[1]))
    for padded, value in zip(out, values, strict=True):
        padded[place] = value
    return out, place


def direction(velocity_rad_s: Array) -> Array:
    """Sign of a velocity, smooth near zero; same shape."""
    return np.asarray(smooth_sign(velocity_rad_s, FRICTION_SPEED_RAD_S))


def presliding(position_rad: Array, run: Ints, distance_rad: float) -> Array:
    """Dry friction over its level, as it builds up over a distance after each reversal (Dahl); shape (N, J)."""
    (position,), place = runs_side_by_side(run, position_rad)
    moved = np.diff(position, axis=0, prepend=position[:1])
    towards, keep = np.sign(moved), np.exp(-np.abs(moved) / distance_rad)
    out = np.empty_like(position)
    held = np.zeros(position.shape[1:])
    for i in range(len(out)):
        held = towards[i] + (held - towards[i]) * keep[i]
        out[i] = held
    return np.asarray(out[place])
