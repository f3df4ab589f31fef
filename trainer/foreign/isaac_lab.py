"""Isaac Lab's ``env.yaml`` (or the same as JSON): what it says of a policy.

Joint order is not in the file: unless ``preserve_order`` fixes it, it is the articulation's, breadth first.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

from spot_model.errors import BadInputError
from spot_model.robot.facts import BREADTH_FIRST
from trainer.foreign.description import (
    ABSOLUTE,
    COMMAND,
    JOINT_FIELDS,
    LAST_ACTION,
    ForeignPolicy,
    SeenTerm,
    canonical_joints,
    field_of,
)
from trainer.foreign.environment import (
    NOT_FLAT,
    Action,
    Agent,
    Environment,
    Joints,
    ObservationGroup,
    ObservationTerm,
    for_each_joint,
    normaliser_of,
    parsed,
)

_ABSOLUTE: Final = "joint_pos"
"""The function that gives joint positions as they are; the term of that name usually calls ``joint_pos_rel``."""
_ACTION: Final = "JointPositionAction"
_ASSUMED_LAYOUT: Final = (
    "the history as Isaac Lab stacks it: each term's ticks together, the oldest first; in the group of observations "
    "'history_layout: frames' names whole frames, 'terms' this, and 'history_newest_first: true' the other direction"
)
_ASSUMED_ORDER: Final = "joints breadth first (all hx, all hy, all kn); --joint-order names another order"


def policy_of_isaac_lab(
    data: Mapping[str, Any], name: str, *, agent: Mapping[str, Any] | None = None, joint_order: tuple[str, ...] = ()
) -> ForeignPolicy:
    """What the configuration says.

    Args:
        data: Of the environment's file.
        name: The policy's name.
        agent: Of the learner's file, as far as there is one: which groups the actor sees, and its actions' clip.
        joint_order: The articulation's joints, where it is not breadth first.

    Raises:
        BadInputError: Something is missing, or cannot be done here; the message names it.
    """
    environment = parsed(Environment, data, "the environment file")
    learner = parsed(Agent, agent or {}, "agent.yaml")
    rate_hz, action = environment.rate_hz, environment.action
    if rate_hz is None:
        raise BadInputError("the environment file has no sim.dt or no decimation; give the training run's env.yaml")
    _check_action(action)
    natural = canonical_joints(joint_order, "--joint-order") if joint_order else BREADTH_FIRST
    natural += _others(environment.pose)
    joints, terms = _read_in(environment, learner, natural)
    is_told = _read_in(environment, learner, natural[::-1]) == (joints, terms)
    keys = {key for name in learner.actor_groups for key in environment.observations[name]}
    is_by_hand = any(term.history > 1 for term in terms) and not keys & {"history_layout", "flatten_history_dim"}
    low, high, assumed = environment.command_bounds(next((term.command for term in terms if term.command), None))
    assumed = (*((_ASSUMED_LAYOUT,) if is_by_hand else ()), *assumed)
    return ForeignPolicy(
        name=name,
        terms=terms,
        joint_names=joints,
        default_position_rad=for_each_joint(environment.pose, joints, "init_state.joint_pos"),
        action_scale_rad=for_each_joint(action.scale, joints, "actions.joint_pos.scale"),
        kp_nm_per_rad=environment.gains("stiffness", joints),
        kd_nm_s_per_rad=environment.gains("damping", joints),
        rate_hz=rate_hz,
        command_low=low,
        command_high=high,
        action_clip=learner.clip_actions or math.inf,
        normaliser=normaliser_of(agent or {}),
        assumed=(*(() if joint_order or is_told else (_ASSUMED_ORDER,)), *assumed),
    )


def _others(pose: float | dict[re.Pattern[str], float]) -> tuple[str, ...]:
    """Joints beside the legs' that the robot has, as an arm's: a term that means all joints means these too."""
    names = [e.pattern for e in pose] if isinstance(pose, dict) else []
    return tuple(name for name in names if re.fullmatch(r"\w+", name) and name not in BREADTH_FIRST)


def _check_action(action: Action) -> None:
    """Raise ``BadInputError`` unless set-points are the default pose plus the scaled action, and nothing else."""
    kind = _last_word(action.class_type or _ACTION)
    if kind != _ACTION:
        raise BadInputError(f"actions.joint_pos.class_type is {kind}; only {_ACTION} is supported")
    if not action.use_default_offset:
        raise BadInputError("actions.joint_pos.use_default_offset is false; set-points must start at the default pose")
    if action.clip:
        raise BadInputError("actions.joint_pos.clip is not supported; train without it")


def _read_in(
    environment: Environment, agent: Agent, natural: tuple[str, ...]
) -> tuple[tuple[str, ...], tuple[SeenTerm, ...]]:
    """The action's joints and the terms that the actor sees, for a robot with its joints in the order ``natural``."""
    acted = _ordered(environment.action, natural, "actions.joint_pos")
    terms: list[SeenTerm] = []
    for name in agent.actor_groups:
        where = f"observations.{name}"
        if name not in environment.observations:
            raise BadInputError(f"the environment file has no {where}; give the env.yaml of the training run")
        group = parsed(ObservationGroup, environment.observations[name], where)
        if not group.concatenate_terms:
            raise BadInputError(f"{where}.concatenate_terms is false; a network here sees one row of numbers")
        given = {key: term for key, term in (group.model_extra or {}).items() if term is not None}
        if not given:
            raise BadInputError(f"{where} has no terms")
        own = [_term(f"{where}.{key}", term, group, natural, acted) for key, term in given.items()]
        if group.history_layout == "frames":
            if len({term.ages for term in own}) > 1:
                raise BadInputError(f"{where}.history_layout is frames; its terms have histories of several lengths")
            own = [replace(term, ages=(age,)) for age in own[0].ages for term in own]
        terms += own
    return acted, tuple(terms)


def _term(
    where: str, term: ObservationTerm, group: ObservationGroup, natural: tuple[str, ...], acted: tuple[str, ...]
) -> SeenTerm:
    """One term; the last action has the joints of the action, ``acted``, the others those of the robot, ``natural``."""
    if term.modifiers:
        raise BadInputError(f"{where}.modifiers are not supported; train without them")
    function = _last_word(term.func)
    named = ABSOLUTE if function == _ABSOLUTE else function or where.rpartition(".")[2]
    field = field_of(named, where)
    joints: tuple[str, ...] = acted if field == LAST_ACTION else ()
    if field in JOINT_FIELDS - {LAST_ACTION}:
        joints = _ordered(term.asset or Joints(), natural, where)
    scale = 1.0 if term.scale is None else term.scale
    asked = term if group.history_length is None else group
    ages = range(max(1, asked.history_length or 1))
    if len(ages) > 1 and asked.flatten_history_dim is False:
        raise BadInputError(NOT_FLAT.format(where=f"{where}: flatten_history_dim"))
    return SeenTerm(
        field,
        joint_names=joints,
        is_absolute=named == ABSOLUTE,
        scale=scale if isinstance(scale, tuple) else (scale,),
        clip=term.clip or SeenTerm.clip,
        command=term.command_name if field == COMMAND else None,
        ages=tuple(ages if group.history_newest_first else reversed(ages)),
    )


def _ordered(named: Joints, natural: tuple[str, ...], where: str) -> tuple[str, ...]:
    """The joints that a term or action names, in its order."""
    chosen = [name for expression in named.joint_names for name in natural if expression.fullmatch(name)]
    if not named.preserve_order:
        chosen = [name for name in natural if name in chosen]
    return canonical_joints(chosen, where)


def _last_word(path: str) -> str:
    """The name of a class or function without its module."""
    return path.rpartition(":")[2].rpartition(".")[2]
