"""Isaac Lab's ``env.yaml`` (or the same as JSON): what it says of a policy.

Joint order is not in the file: unless ``preserve_order`` fixes it, it is the articulation's, breadth first.
"""

from __future__ import annotations

import re
import reprlib
from collections.abc import Mapping
from typing import Any, Final

from spot_model.errors import BadInputError
from trainer.foreign.description import (
    BREADTH_FIRST,
    JOINT_FIELDS,
    LAST_ACTION,
    ForeignPolicy,
    Term,
    by_joint,
    canonical_joints,
    history_length,
    mapping,
    matching,
    meaning_of,
    number,
)
from trainer.foreign.environment import action_clip, command_ranges, gains_of, get, pair, rate_of

_ABSOLUTE: Final = "joint_pos"
"""The function that gives joint positions as they are; the term of that name usually calls ``joint_pos_rel``."""
_ACTION: Final = "JointPositionAction"
_ASSUMED_ORDER: Final = "joints breadth first (all hx, all hy, all kn); --joint-order names another order"
_NOT_TERMS: Final = frozenset(
    {"concatenate_terms", "concatenate_dim", "enable_corruption", "history_length", "flatten_history_dim"}
)


def describe(
    environment: Mapping[str, Any],
    name: str,
    *,
    agent: Mapping[str, Any] | None = None,
    joint_order: tuple[str, ...] = (),
) -> ForeignPolicy:
    """What the configuration says.

    Args:
        environment: See :func:`trainer.foreign.environment.read_environment`.
        name: The policy's name.
        agent: The learner's configuration, as far as there is one: which groups it observes, and its actions' clip.
        joint_order: The articulation's joints, where it is not breadth first.

    Raises:
        BadInputError: Something is missing, or cannot be done here; the message names it.
    """
    pose = get(environment, "scene.robot.init_state.joint_pos")
    natural = canonical_joints(joint_order, "--joint-order") if joint_order else BREADTH_FIRST
    natural += _others(pose)
    action = mapping(get(environment, "actions.joint_pos"), "actions.joint_pos")
    _check_action(action)
    joints = _ordered(action, natural, "actions.joint_pos")
    default = by_joint(pose, joints, "init_state.joint_pos")
    (low, high), assumed = command_ranges(environment)
    agent = agent or {}
    groups = _groups(agent)
    terms = _observed(environment, groups, natural, joints)
    other = natural[::-1]
    order_of_other = _ordered(action, other, "actions.joint_pos")
    is_told = order_of_other == joints and _observed(environment, groups, other, joints) == terms
    order = () if joint_order or is_told else (_ASSUMED_ORDER,)
    return ForeignPolicy(
        name=name,
        terms=terms,
        joint_names=joints,
        default_position_rad=default,
        action_scale_rad=by_joint(action.get("scale", 1.0), joints, "actions.joint_pos.scale"),
        kp_nm_per_rad=gains_of(environment, "stiffness", joints),
        kd_nm_s_per_rad=gains_of(environment, "damping", joints),
        rate_hz=rate_of(environment),
        command_low=low,
        command_high=high,
        action_clip=action_clip(agent),
        assumed=(*order, *assumed),
    )


def _others(pose: Any) -> tuple[str, ...]:
    """Joints beside the legs' that the robot has, as an arm's: a term that means all joints means these too."""
    names = [str(name) for name in pose] if isinstance(pose, Mapping) else []
    return tuple(name for name in names if re.fullmatch(r"\w+", name) and name not in BREADTH_FIRST)


def _check_action(action: Mapping[str, Any]) -> None:
    """Raise ``BadInputError`` unless set-points are the default pose plus the scaled action, and nothing else."""
    kind = str(action.get("class_type") or _ACTION).rpartition(":")[2].rpartition(".")[2]
    if kind != _ACTION:
        raise BadInputError(f"actions.joint_pos.class_type is {kind}; only {_ACTION} is supported")
    if not action.get("use_default_offset", True):
        raise BadInputError("actions.joint_pos.use_default_offset is false; set-points must start at the default pose")
    if action.get("clip"):
        raise BadInputError("actions.joint_pos.clip is not supported; train without it")


def _groups(agent: Mapping[str, Any]) -> tuple[str, ...]:
    """Groups of observations that the actor sees, one after the other."""
    sets = agent.get("obs_groups") or {}
    groups = sets.get("actor") or sets.get("policy") or ["policy"] if isinstance(sets, Mapping) else None
    if not isinstance(groups, list) or not all(isinstance(group, str) for group in groups):
        raise BadInputError(f"agent.yaml: obs_groups = {reprlib.repr(sets)}; it must name lists of groups")
    return tuple(groups)


def _observed(
    environment: Mapping[str, Any], groups: tuple[str, ...], natural: tuple[str, ...], acted: tuple[str, ...]
) -> tuple[Term, ...]:
    terms: list[Term] = []
    for name in groups:
        where = f"observations.{name}"
        terms += _terms(mapping(get(environment, where), where), where, natural, acted)
    return tuple(terms)


def _terms(group: Mapping[str, Any], where: str, natural: tuple[str, ...], acted: tuple[str, ...]) -> list[Term]:
    terms = []
    of_all = group.get("history_length")
    if group.get("concatenate_terms") is False:
        raise BadInputError(f"{where}.concatenate_terms is false; a network here sees one row of numbers")
    for name, config in group.items():
        if name in _NOT_TERMS or config is None:
            continue
        terms.append(_term(f"{where}.{name}", mapping(config, f"{where}.{name}"), natural, acted, of_all))
    if not terms:
        raise BadInputError(f"{where} has no terms")
    return terms


def _term(where: str, config: Mapping[str, Any], natural: tuple[str, ...], acted: tuple[str, ...], of_all: Any) -> Term:
    """One term; the last action has the joints of the action, ``acted``, the others those of the robot, ``natural``."""
    function = str(config.get("func", "")).rpartition(":")[2].rpartition(".")[2]
    meaning = meaning_of("joint_pos_abs" if function == _ABSOLUTE else function or where.rpartition(".")[2], where)
    params = mapping(config.get("params"), f"{where}.params")
    asset = mapping(params.get("asset_cfg"), f"{where}.params.asset_cfg")
    joints: tuple[str, ...] = acted if meaning.field == LAST_ACTION else ()
    if meaning.field in JOINT_FIELDS - {LAST_ACTION}:
        joints = _ordered(asset, natural, where)
    scale = config.get("scale")
    clip = config.get("clip")
    asked = config.get("history_length") if of_all is None else of_all
    history = history_length(1 if asked is None else asked, f"{where}.history_length")
    if config.get("modifiers"):
        raise BadInputError(f"{where}.modifiers are not supported; train without them")
    return Term(
        meaning.field,
        joint_names=joints,
        is_absolute=meaning.is_absolute,
        scale=_numbers(1.0 if scale is None else scale, f"{where}.scale"),
        clip=Term.clip if clip is None else pair(clip, f"{where}.clip"),
        history=history,
    )


def _ordered(config: Mapping[str, Any], natural: tuple[str, ...], where: str) -> tuple[str, ...]:
    """The joints that a term or action names, in its order."""
    matches = matching(config.get("joint_names") or [".*"], natural, f"{where}.joint_names")
    chosen = [name for group in matches for name in group]
    if not config.get("preserve_order", False):
        chosen = [name for name in natural if name in chosen]
    return canonical_joints(chosen, where)


def _numbers(value: Any, where: str) -> tuple[float, ...]:
    return tuple(number(v, where) for v in (value if isinstance(value, (list, tuple)) else [value]))
