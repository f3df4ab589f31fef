"""What must be known of another framework's policy, whichever framework it is."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from spot_model.errors import BadInputError
from spot_model.policy.observation import OBSERVATION
from spot_model.robot import facts

BREADTH_FIRST: Final = tuple(f"{leg}_{joint}" for joint in ("hx", "hy", "kn") for leg in facts.LEG_NAMES)
"""Isaac Lab's order of Spot's joints: all hx, all hy, all kn, each fl, fr, hl, hr."""
MAX_HISTORY: Final = 50

_WIDTHS: Final = {field.name: field.width for field in OBSERVATION}


@dataclass(frozen=True)
class Term:
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
    history: int = 1
    """How many ticks it holds, the oldest first."""

    @property
    def width(self) -> int:
        """Numbers a tick."""
        return _WIDTHS[self.field]


@dataclass(frozen=True)
class ForeignPolicy:
    """A foreign network's meaning. Per-joint values stand in the order of ``joint_names``, which the action has."""

    name: str
    terms: tuple[Term, ...]
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
    assumed: tuple[str, ...] = ()
    """What no file said, and what was taken instead."""

    @property
    def width(self) -> int:
        """Numbers that the network sees."""
        return sum(term.width * term.history for term in self.terms)

    @property
    def history(self) -> int:
        """Ticks that the longest term holds."""
        return max(term.history for term in self.terms)


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


def by_joint(value: float | Mapping[str, float], joint_names: Sequence[str], source: str) -> tuple[float, ...]:
    """A value a joint: one for all, or by regular expressions that match whole names.

    Raises:
        BadInputError: A joint is not matched, or a value is not a number.
    """
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return (float(value),) * len(joint_names)
    if not isinstance(value, Mapping):
        raise BadInputError(f"{source} = {value!r:.60}; it must be a number, or numbers by joint")
    found: dict[str, float] = {}
    for expression, number in value.items():
        try:
            pattern = re.compile(str(expression))
        except re.error as error:
            raise BadInputError(f"{source}: {expression!r} is no regular expression: {error}") from error
        found |= {name: float(number) for name in joint_names if pattern.fullmatch(name)}
    missing = [name for name in joint_names if name not in found]
    if missing:
        raise BadInputError(f"{source} says nothing of {', '.join(missing)}")
    return tuple(found[name] for name in joint_names)
