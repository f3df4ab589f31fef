"""What must be known of another framework's policy, whichever framework it is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from pydantic import ValidationError

from spot_model.errors import BadInputError
from spot_model.io.settings import explain
from spot_model.policy.contract import PolicyContract, StoredPair, TrainingRecord
from spot_model.policy.joint_script import carried_nm
from spot_model.policy.observation import N_OBSERVATION, OBSERVATION
from spot_model.robot import facts

# In the order of our observation: a field more or less fails here.
_LINEAR, _ANGULAR, _GRAVITY, COMMAND, _POSITION, _VELOCITY, LAST_ACTION = (f.name for f in OBSERVATION)
ABSOLUTE: Final = "joint_pos_abs"
"""Joint positions themselves; under every other name the default pose is taken off."""
THEIR_NAMES: Final = {
    _LINEAR: ("base_lin_vel", "base_linear_velocity", "imu_lin_vel"),
    _ANGULAR: ("base_ang_vel", "base_angular_velocity", "imu_ang_vel"),
    _GRAVITY: ("projected_gravity",),
    COMMAND: ("command", "velocity_commands", "velocity_command", "generated_commands", "commands", "twist"),
    _POSITION: ("joint_pos", "joint_pos_rel", ABSOLUTE),
    _VELOCITY: ("joint_vel", "joint_vel_rel"),
    LAST_ACTION: ("actions", "last_action", "action"),
}
"""What other frameworks call each of our fields, by the name of the term or of the function; mjlab's name first."""
_FIELDS: Final = {name: field for field, names in THEIR_NAMES.items() for name in names}
JOINT_FIELDS: Final = frozenset(f.name for f in OBSERVATION if f.is_of_joints)


def field_of(name: str, source: str) -> str:
    """Our field that a term means.

    Raises:
        BadInputError: It is nothing that the robot reports here, such as a height scan or a gait phase.
    """
    if name not in _FIELDS:
        raise BadInputError(
            f"{source}: observation term {name!r} is nothing that this runtime observes; it knows "
            f"{', '.join(_FIELDS)}. Train without it"
        )
    return _FIELDS[name]


MAX_HISTORY: Final = 50
DEFAULT_COMMANDS: Final = ((-1.0, -0.5, -1.0), (1.0, 0.5, 1.0))
"""Range of velocity commands where no file names one: V_x, V_y (m/s), ω_z (rad/s)."""

_WIDTHS: Final = {block.name: block.width for block in OBSERVATION}


@dataclass(frozen=True)
class SeenTerm:
    """One block of a foreign observation, as a quantity that our observation has."""

    field: str
    """Name of the quantity in our observation."""
    joint_names: tuple[str, ...] = ()
    """Order of the joints, for a quantity of the joints."""
    is_absolute: bool = False
    """Joint positions themselves, where ours are offsets from the default pose."""
    scale: tuple[float, ...] = (1.0,)
    """One factor, or one a number."""
    clip: tuple[float, float] = (-math.inf, math.inf)
    """Applied before the scale."""
    command: str | None = None
    """Name of the velocity command that it shows, where the file tells it."""
    ages: tuple[int, ...] = (0,)
    """The ticks that it holds, in their order: 0 is the newest."""

    @property
    def width(self) -> int:
        """Numbers a tick."""
        return _WIDTHS[self.field]

    @property
    def history(self) -> int:
        """Ticks back to the oldest that it holds."""
        return 1 + max(self.ages)


@dataclass(frozen=True)
class ForeignPolicy:
    """A foreign network's meaning. Per-joint values stand in the order of ``joint_names``, which the action has."""

    name: str
    terms: tuple[SeenTerm, ...]
    joint_names: tuple[str, ...]
    default_position_rad: tuple[float, ...]
    action_scale_rad: tuple[float, ...]
    kp_nm_per_rad: tuple[float, ...]
    kd_nm_s_per_rad: tuple[float, ...]
    rate_hz: float
    command_low: tuple[float, float, float]
    command_high: tuple[float, float, float]
    action_clip: float = math.inf
    """The training's wrapper kept actions within plus and minus this; so did the last action that it observed."""
    normaliser: str = ""
    """Where the learner's file says that it normalised the observation; empty where it does not."""
    assumed: tuple[str, ...] = ()
    """What no file said, and what was taken instead."""

    @property
    def width(self) -> int:
        """Numbers that the network sees."""
        return sum(term.width * len(term.ages) for term in self.terms)

    @property
    def history(self) -> int:
        """Ticks that the longest term holds."""
        return max(term.history for term in self.terms)


def checked(policy: ForeignPolicy) -> ForeignPolicy:
    """The policy, if it can be one of ours. Raises BadInputError: a value is out of its range; the message names it."""
    for term in policy.terms:
        if len(term.scale) not in (1, term.width) or not all(math.isfinite(v) and v != 0.0 for v in term.scale):
            raise BadInputError(
                f"observation term {term.field}: scale {', '.join(f'{v:g}' for v in term.scale)}; allowed: one number, "
                f"or {term.width}, none of them 0"
            )
        if not term.clip[0] < term.clip[1]:
            raise BadInputError(
                f"observation term {term.field}: clip {term.clip[0]:g} to {term.clip[1]:g}; allowed: low below high"
            )
    for joint, scale in zip(policy.joint_names, policy.action_scale_rad, strict=True):
        if not (math.isfinite(scale) and scale != 0.0):
            raise BadInputError(
                f"action scale of {joint} is {scale:g}; allowed: any number but 0, in rad for an action of 1"
            )
    pair = StoredPair(observation=(0.0,) * policy.history * N_OBSERVATION, action=(0.0,) * facts.N_JOINTS)
    _check_stiffness(foreign_contract(policy, pair))
    return policy


def foreign_contract(policy: ForeignPolicy, pair: StoredPair, revision: str = "") -> PolicyContract:
    """Our contract of a foreign policy.

    Raises:
        BadInputError: A value is out of the contract's range; the message names it.
    """
    try:
        return PolicyContract(
            name=policy.name,
            joint_names=policy.joint_names,
            default_position_rad=policy.default_position_rad,
            action_scale_rad=common_scale(policy),
            kp_nm_per_rad=policy.kp_nm_per_rad,
            kd_nm_s_per_rad=policy.kd_nm_s_per_rad,
            rate_hz=policy.rate_hz,
            observation_history=policy.history,
            velocity_command_low=policy.command_low,
            velocity_command_high=policy.command_high,
            training=TrainingRecord(run=revision, command="spot-rl policy import"),
            stored_pair=pair,
        )
    except ValidationError as error:
        raise BadInputError(
            f"policy {policy.name} cannot be one of ours:\n{explain(error)}\n"
            "correct the file that says so, or name the training run's with --env"
        ) from error


def common_scale(policy: ForeignPolicy) -> float:
    """The one action scale of our contract; a joint's own share of it goes into the network."""
    return max(abs(scale) for scale in policy.action_scale_rad)


def _check_stiffness(contract: PolicyContract) -> None:
    """Refuse a servo that, with its set-point at the joint's stop, carries less than the robot weighs as it stands."""
    order = [contract.joint_names.index(name) for name in facts.JOINT_NAMES]
    pose, kp = np.array(contract.default_position_rad)[order], np.array(contract.kp_nm_per_rad)[order]
    torque_nm = carried_nm(pose[None], np.zeros((1, facts.N_LEGS)))[0]
    room_rad = np.where(torque_nm > 0.0, facts.POSITION_HIGH_RAD - pose, pose - facts.POSITION_LOW_RAD)
    for joint, own, needed in zip(facts.JOINT_NAMES, kp, np.abs(torque_nm) / np.maximum(room_rad, 1e-6), strict=True):
        if own < needed:
            raise BadInputError(
                f"policy {contract.name}: the stiffness of {joint} is {own:g} N·m/rad; allowed: at least {needed:.3g}, "
                "or the joint cannot carry its share of the robot in the default pose, wherever its set-point is"
            )


def canonical_joints(names: Sequence[str], source: str) -> tuple[str, ...]:
    """Joint names as ours (``fl.hx`` is ``fl_hx``), each of the twelve once.

    Raises:
        BadInputError: A joint is missing, twice there, or none of Spot's legs.
    """
    cleaned = tuple(name.strip().replace(".", "_").lower() for name in names)
    if sorted(cleaned) != sorted(facts.JOINT_NAMES):
        raise BadInputError(
            f"{source}: joints {', '.join(cleaned) or 'none'}; a policy here sees and moves "
            f"{', '.join(facts.JOINT_NAMES)}, each once, and nothing else"
        )
    return cleaned
