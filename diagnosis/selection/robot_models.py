"""This robot's ordinary errors as effects: what stands in every model that is compared, and in its model file."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from diagnosis.channels import Array, Flags, Shape
from diagnosis.library import JointGroups, LibraryEffect, Location, acts_last, less
from diagnosis.library.held import groups_of
from diagnosis.library.rigid_body import PayloadEntry, with_mass
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.ordinary_errors import ErrorKind
from diagnosis.selection.scoring import Scored, by_term
from spot_model.effects.base import Effect, ModelEffect, TorqueEffect
from spot_model.io.model_file import RobotModel
from spot_model.robot.facts import JOINT_NAMES
from spot_model.robot.joints import describe_joints

ALIKE: Mapping[str, tuple[str, ...]] = {
    "torque_gain": ("gain",),
    "torque_offset": ("offset_nm",),
    "load_sensor_gain": ("gain", "bias_nm"),
    "coulomb_friction": ("level_nm",),
    "viscous_friction": ("damping_nm_s_per_rad",),
    "load_friction": ("share",),
    "stribeck_friction": ("level_nm",),
    "armature": ("inertia_kg_m2",),
    "load_filter": ("time_constant_s",),
    "torque_bandwidth": ("time_constant_s",),
    "velocity_filter": ("time_constant_s",),
    "joint_compliance": ("compliance_rad_per_nm",),
    "encoder_offset": ("offset_rad",),
    "leg_mass": ("scale",),
    "body_inertia": ("scale",),
    "foot_radius": ("change_m",),
    "velocity_estimate": ("scale", "bias_x_m_s", "bias_y_m_s", "lag_s"),
    "imu_tilt": ("roll_rad", "pitch_rad"),
    "ground_slope": ("rise_x_rad", "rise_y_rad"),
    "contact_delay": ("delay_s",),
    "ground_friction": ("scale",),
    "ground_compliance": ("time_constant_s", "damping_ratio"),
    "command_jitter": ("mean_s",),
    "command_drop": ("probability",),
    "sensor_noise": ("position_rad", "velocity_rad_s", "load_nm"),
}
"""Ordinary errors of which two after another are one, to the second order, and the parameters that make it up."""


def with_errors(model: RobotModel, board: Evidence, pulls: Array, effects: Container[str] | None = None) -> RobotModel:
    """The model with ordinary errors, within the bounds of each parameter.

    ``pulls`` are in published spreads, shape (Q,); ``effects`` names those that are added, None for all.
    """
    size = pulls * board.ordinary.scale
    for kind in board.ordinary.kinds:
        if effects is None or kind.effect.name in effects:
            model = with_kind(model, board.robot, kind, kind.coefficients(size))
    return model


def corrected_model(nominal: RobotModel, board: Evidence, scored: Scored, fold: int | None = None) -> RobotModel:
    """The nominal model with this robot's ordinary errors and the effects, as fitted without a fold or to everything.

    A number beyond its parameter's bound is put at the bound.
    """
    pulls, coefficients = scored.pulls, scored.coefficients
    if fold is not None:
        pulls, coefficients = scored.fold_pulls[fold], by_term(scored.terms, scored.spread[fold])
    named = {t.effect.name for t in scored.terms}
    others = {kind.effect.name for kind in board.ordinary.kinds} - named
    model = with_errors(nominal, board, pulls, others)
    for term, own in sorted(zip(scored.terms, coefficients, strict=True), key=lambda pair: acts_last(pair[0].effect)):
        values, _ = within(term.effect, term.effect.values(own, term.shape))
        model = term.effect.add_to(model, values, board.robot.words_for(term.effect, term.place))
    # Errors of what is a difference here are counted from it: a joint may have less of it than the others.
    return with_errors(model, board, pulls, named)


def within(entry: LibraryEffect, values: Mapping[str, float]) -> tuple[dict[str, float], dict[str, float]]:
    """Values within their parameters' bounds, and the bounds of those that were beyond."""
    known = {p.name: p for p in entry.effect.parameters()}
    least = {c.name: c.low for c in entry.coefficients if c.name in known and c.low < known[c.name].low - 1e-12}
    least |= dict(entry.taken_away)
    out, held = dict(values), dict[str, float]()
    for name, value in values.items():
        if name not in known:
            continue
        low, high = least.get(name, known[name].low), known[name].high
        out[name] = float(np.clip(value, low, high))
        if out[name] != value:
            held[name] = out[name]
    return out, held


def with_kind(model: RobotModel, robot: JointGroups, kind: ErrorKind, coefficients: Array) -> RobotModel:
    """The model with errors of one kind; coefficients by unit, shape (U, C).

    What effects of the kind have in all stays within the bounds of each parameter.
    """
    entry, effect = kind.effect, kind.effect.effect
    if isinstance(entry, PayloadEntry):
        return with_mass(model, float(coefficients[0, 0]), coefficients[0, 1:])
    asked, units = [_asked(entry, kind.at, own) for own in coefficients], robot.units(entry.location) > 0.5
    sizes = [p for p in effect.parameters() if p.name in asked[0] and (p.name not in kind.at or _is_sized(entry))]
    acts, columns = np.zeros(robot.n_joints, dtype=np.bool_), dict[str, Any]()
    for p in sizes:
        into, back = less.sums(effect, p)
        more = into(np.array([own[p.name] for own in asked])) @ units
        before = less.in_all(model, effect, p)
        after = np.where(more == 0.0, before, np.clip(before + more, into(p.low), into(p.high)))
        change = after - before
        added = np.clip(change, into(p.low), into(p.high))
        model = less.with_less(model, effect, p, change - added)
        acts |= added != 0.0
        columns[p.name] = np.clip(back(added), p.low, p.high)
    if not acts.any():
        return model
    shape = {name: value for name, value in asked[0].items() if name not in columns}
    numbers = {k: _plain(v[None], acts) for k, v in columns.items()}
    made: Effect = effect(joints=describe_joints(acts), **numbers, **shape)
    if entry.location is Location.JOINT and not isinstance(made, ModelEffect):
        # One effect with a number for each joint: a step costs no more than one effect's.
        return model.with_effects(made)
    for own in _apart(made):
        model = entry.add_to(model, own.values, own.joints)
    return model


def _is_sized(entry: LibraryEffect) -> bool:
    """Whether an effect's size is in its shape."""
    return not all(c.is_free for c in entry.coefficients)


def _asked(entry: LibraryEffect, at: Shape, own: Array) -> dict[str, float]:
    """Parameters from the coefficients of one unit, beyond their bounds, too; a size in the shape goes with its own."""
    share = next((float(x) for c, x in zip(entry.coefficients, own, strict=True) if not c.is_free), 1.0)
    shape = {name: share * value for name, value in at.items()}
    if type(entry).values is not LibraryEffect.values:
        return dict(entry.values(own, shape))
    nulls = {p.name: p.null for p in entry.effect.parameters()}
    free = {c.name: float(x) for c, x in zip(entry.coefficients, own, strict=True) if c.is_free and c.name in nulls}
    return {k: v for k, v in shape.items() if k in nulls} | {name: nulls[name] + x for name, x in free.items()}


def effects_merged(model: RobotModel) -> RobotModel:
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
    # Effects on the model's fields do not all take a number for each joint.
    return replace(model, effects=tuple(own for e in effects for own in ([e], _apart(e))[isinstance(e, ModelEffect)]))


def _mergeable(before: Sequence[Effect], effect: Effect) -> int | None:
    """Number of the effect with which one goes together; None for none."""
    for at in reversed(range(len(before))):
        if _are_alike(before[at], effect):
            return at
        if isinstance(effect, TorqueEffect) and isinstance(before[at], TorqueEffect) and before[at].name not in ALIKE:
            return None
    return None


def _are_alike(one: Effect, other: Effect) -> bool:
    """Whether they differ in no numbers but those that add up, or multiply."""
    names = ALIKE.get(one.name, ())
    rest = [p.name for p in one.parameters() if p.name not in names]
    return bool(names) and type(one) is type(other) and all(_is_same(one.values[n], other.values[n]) for n in rest)


def _is_same(one: Any, other: Any) -> bool:
    return np.size(one) == np.size(other) == 1 and bool(np.all(one == other))


def _one_of_two(first: Effect, second: Effect) -> Effect:
    mask, columns = first.mask | second.mask, dict[str, Any]()
    for p in first.parameters():
        if p.name in ALIKE[first.name]:
            into, back = less.sums(type(first), p)
            total = into(less.value_by_joint(first, p)) + into(less.value_by_joint(second, p))
            columns[p.name] = _plain(np.clip(back(total), p.low, p.high)[None], mask)
    return replace(first, joints=describe_joints(mask), **columns)


def _plain(values: Array, acts: Flags) -> Any:
    """One number where those of all joints that an effect acts on are the same; shape (1, J)."""
    own = values[0, acts]
    return float(own[0]) if np.all(own == own[0]) else values


def model_by_joint(model: RobotModel, joint_names: tuple[str, ...]) -> RobotModel:
    """The same model with plain numbers alone, one effect for joints of the same numbers: what goes into a file."""
    return replace(model, effects=tuple(own for effect in model.effects for own in _apart(effect, joint_names)))


def _apart(effect: Effect, joint_names: tuple[str, ...] = JOINT_NAMES) -> list[Effect]:
    if all(np.ndim(v) == 0 for v in effect.values.values()):
        return [effect]
    effects: list[Effect] = []
    for joints, values in groups_of(effect):
        named = tuple(name for name, there in zip(joint_names, joints, strict=True) if there)
        plain: dict[str, Any] = dict(values)
        effects.append(replace(effect, joints=named, **plain))
    return [e for e in effects if not e.is_null]
