"""This robot's ordinary errors as effects: what stands in every model that is compared, and in its model file."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from diagnosis.channels import Array, Shape
from diagnosis.decision_constants import ERROR_SCALES
from diagnosis.library import LibraryEffect, Location, Robot, acts_last
from diagnosis.library.less import with_less
from diagnosis.library.repairs import size_of
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.ordinary_errors import ErrorKind
from diagnosis.selection.scoring import Scored, by_term
from spot_model.effects.base import Effect, ModelEffect, TorqueEffect
from spot_model.effects.commands import CommandDelay
from spot_model.io.model_file import RobotModel
from spot_model.robot.facts import JOINT_NAMES, N_JOINTS
from spot_model.robot.joints import describe_joints

ALIKE: Mapping[str, tuple[str, ...]] = {
    "torque_gain": ("gain",),
    "torque_offset": ("offset_nm",),
    "coulomb_friction": ("level_nm",),
    "viscous_friction": ("damping_nm_s_per_rad",),
    "load_friction": ("share",),
    "armature": ("inertia_kg_m2",),
    "velocity_filter": ("time_constant_s",),
    "encoder_offset": ("offset_rad",),
    "leg_mass": ("scale",),
    "body_inertia": ("scale",),
    "velocity_estimate": ("scale", "bias_x_m_s", "bias_y_m_s", "lag_s"),
    "imu_tilt": ("roll_rad", "pitch_rad"),
    "command_jitter": ("mean_s",),
    "ground_compliance": ("time_constant_s", "damping_ratio"),
}
"""Ordinary errors of which two after another are one, to the second order, and the parameters that make it up."""
SMALLEST = 0.02
"""Errors under this share of their published range are left out of a model: they change nothing."""


def with_errors(model: RobotModel, board: Evidence, pulls: Array, effects: Container[str] | None = None) -> RobotModel:
    """The model with ordinary errors that change how the robot moves, within the bounds of each parameter.

    ``pulls`` are in usual sizes, shape (Q,); ``effects`` names those that are added, None for all.
    """
    size = pulls * board.ordinary.scale
    for kind in board.ordinary.kinds:
        name = kind.effect.name
        if ERROR_SCALES[name].acts_in_closed_loop and (effects is None or name in effects):
            model = with_kind(model, board.robot, kind, kind.coefficients(size))
    return model


def size_of_errors(board: Evidence, pulls: Array) -> float:
    """How large a robot's ordinary errors (in usual sizes, shape (Q,)) are, in published standard deviations.

    The geometric mean over kinds that act in closed loops, so that a fault which one kind takes up hardly counts.
    """
    size = np.abs(pulls) * board.ordinary.scale / board.ordinary.published
    names = np.array(board.ordinary.names)
    acting = [kind.effect.name for kind in board.ordinary.kinds if ERROR_SCALES[kind.effect.name].acts_in_closed_loop]
    by_kind = [float(np.sqrt(np.mean(size[names == name] ** 2))) for name in acting]
    return float(np.exp(np.mean(np.log(np.maximum(by_kind, SMALLEST))))) if by_kind else 1.0


def model_of(nominal: RobotModel, board: Evidence, scored: Scored, fold: int | None = None) -> RobotModel:
    """The nominal model with this robot's ordinary errors and the effects, as fitted without a fold or to everything.

    Raises:
        BadInputError: A value is out of its effect's bounds.
    """
    pulls, coefficients = scored.pulls, scored.coefficients
    if fold is not None:
        pulls, coefficients = scored.fold_pulls[fold], by_term(scored.terms, scored.spread[fold])
    named = {t.effect.name for t in scored.terms}
    others = {kind.effect.name for kind in board.ordinary.kinds} - named
    model = with_errors(nominal, board, pulls, others)
    for term, own in sorted(zip(scored.terms, coefficients, strict=True), key=lambda pair: acts_last(pair[0].effect)):
        model = term.effect.add_to(
            model, term.effect.values(own, term.shape), board.robot.words_for(term.effect, term.place)
        )
    # Errors of what is a difference here are counted from it: a joint may have less of it than the others.
    return with_errors(model, board, pulls, named)


def with_kind(model: RobotModel, robot: Robot, kind: ErrorKind, coefficients: Array) -> RobotModel:
    """The model with errors of one kind; coefficients by unit, shape (U, C)."""
    effect = kind.effect
    if robot.joint_names == JOINT_NAMES and effect.location is Location.JOINT and len(effect.coefficients) == 1:
        model = _with_less(model, effect, coefficients[:, 0])
    scales = np.array([ERROR_SCALES[effect.name].scales.get(c.name, np.inf) for c in effect.coefficients])
    values = {}
    for unit, own in enumerate(coefficients):
        if np.any(np.abs(own) > SMALLEST * scales):
            values[unit] = _within(effect, effect.values(*_parts(effect, own, kind.at)))
    if effect.location is Location.JOINT and not issubclass(effect.effect, ModelEffect) and values:
        return _side_by_side(model, robot, effect, values)
    for unit, own_values in values.items():
        joints = robot.named(robot.units(effect.location)[unit] > 0.5)
        model = effect.add_to(model, own_values, ("all",) if len(joints) == robot.n_joints else joints)
    return model


def _with_less(model: RobotModel, effect: LibraryEffect, change: Array) -> RobotModel:
    """The model's own effects of a kind lowered where the change is below what an effect added to them can have.

    The effect has one coefficient and is local to joints; change by joint, shape (12,).
    """
    p = size_of(effect)
    return (
        model if p is None else with_less(model, effect.effect, p, np.minimum(change - effect.coefficients[0].low, 0))
    )


def _parts(effect: LibraryEffect, own: Array, at: Shape) -> tuple[Array, Shape]:
    """Coefficients within their bounds; where the size is in the shape, the shape times the coefficient."""
    low = np.array([c.low for c in effect.coefficients])
    high = np.array([c.high for c in effect.coefficients])
    fixed = low == high
    shape = dict(at)
    if fixed.any():
        shape = {k: v * max(0.0, float(own[fixed][0])) for k, v in at.items()}
    return np.clip(own, low, high), shape


def _within(effect: LibraryEffect, values: Mapping[str, float]) -> dict[str, float]:
    bounds = {p.name: (p.low, p.high) for p in effect.effect.parameters()}
    # A delay in place of the model's own may be shorter.
    bounds |= {c.name: (c.low, c.high) for c in effect.coefficients if effect.effect is CommandDelay}
    return {k: float(np.clip(v, *bounds[k])) for k, v in values.items()}


def _side_by_side(
    model: RobotModel, robot: Robot, effect: LibraryEffect, values: dict[int, dict[str, float]]
) -> RobotModel:
    """One effect with a number for each joint: a step costs no more than one effect's."""
    some = next(iter(values.values()))
    made: Effect = effect.effect()
    nulls = {p.name: p.null for p in made.parameters()}
    columns: dict[str, Any] = {k: np.full((1, robot.n_joints), nulls[k]) for k in some}
    for unit, own in values.items():
        for k, v in own.items():
            columns[k][0, unit] = v
    return model.with_effects(replace(made, **columns))


def merged(model: RobotModel) -> RobotModel:
    """The same model with one effect, with a number for each joint, in place of several of :data:`ALIKE`'s.

    So a model that is corrected time and again does not grow. Between two effects on the torque there may be others of
    :data:`ALIKE`, but no limit.
    """
    effects: list[Effect] = []
    for effect in model.effects:
        at = _mergeable(effects, effect)
        if at is None:
            effects.append(effect)
        else:
            effects[at] = _one_of_two(effects[at], effect)
    return replace(model, effects=tuple(effects))


def _mergeable(before: Sequence[Effect], effect: Effect) -> int | None:
    """Number of the effect with which one goes together; None for none."""
    for at in reversed(range(len(before))):
        if type(before[at]) is type(effect) and _is_alike(before[at]) and _is_alike(effect):
            return at
        if isinstance(effect, TorqueEffect) and isinstance(before[at], TorqueEffect) and before[at].name not in ALIKE:
            return None
    return None


def _is_alike(effect: Effect) -> bool:
    """Whether it has no numbers but those that add up, or multiply."""
    names = ALIKE.get(effect.name, ())
    return bool(names) and all(
        p.name in names or np.all(np.asarray(getattr(effect, p.name)) == p.null) for p in effect.parameters()
    )


def _one_of_two(first: Effect, second: Effect) -> Effect:
    columns: dict[str, Any] = {}
    for p in first.parameters():
        one, two = (
            np.where(e.mask, np.broadcast_to(getattr(e, p.name), (1, N_JOINTS)), p.null) for e in (first, second)
        )
        columns[p.name] = np.clip(one * two if p.null == 1.0 else one + two, p.low, p.high)
    return replace(
        first, joints=describe_joints(first.mask | second.mask), **{k: _plain(v) for k, v in columns.items()}
    )


def _plain(values: Array) -> Any:
    """One number where all are the same."""
    return float(values[0, 0]) if np.all(values == values[0, 0]) else values


def by_joint(model: RobotModel, joint_names: tuple[str, ...]) -> RobotModel:
    """The same model with plain numbers alone, one effect a joint where numbers differ: what goes into a file."""
    effects: list[Effect] = []
    for effect in model.effects:
        if all(np.ndim(v) == 0 for v in effect.values.values()):
            effects.append(effect)
            continue
        nulls = {p.name: p.null for p in effect.parameters()}
        for j, name in enumerate(joint_names):
            row = {k: np.broadcast_to(v, (1, len(joint_names)))[0] for k, v in effect.values.items()}
            own: dict[str, Any] = {k: float(v[j]) for k, v in row.items()}
            if any(v != nulls[k] for k, v in own.items()):
                effects.append(replace(effect, joints=(name,), **own))
    return replace(model, effects=tuple(effects))
