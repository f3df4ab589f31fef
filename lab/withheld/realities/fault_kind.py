"""What a kind of fault is: where it may act, which answers are right, and how one is drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from spot_model.robot.facts import JOINT_NAMES, JOINT_TYPES, LEG_NAMES, Array
from withheld.plan import Family, Place
from withheld.simulator.robot import Robot

Flags = NDArray[np.bool_]
JOINT_PLACES: Final[tuple[Place, ...]] = ("joint", "type", "leg", "all")
LEG_PLACES: Final[tuple[Place, ...]] = ("leg", "all")
BODY: Final[tuple[Place, ...]] = ("body",)


Parameters = dict[str, float]
"""``effect.parameter`` and the value that a perfect diagnosis would state."""


@dataclass(frozen=True)
class Ask:
    """What was asked for, and the generator that draws the rest."""

    rng: np.random.Generator
    size: float
    """0 is nothing, 1 the end of the realistic range."""
    joints: Flags
    """Where it acts, shape (12,)."""


Install = Callable[[Robot, Ask], Parameters]
"""Draws a fault's numbers, and puts it into a robot that has its small errors already."""


@dataclass(frozen=True)
class FaultKind:
    """One entry of the catalogue."""

    name: str
    family: Family
    names: tuple[str, ...]
    """Library effects that are a right answer; empty: the library has no such effect."""
    places: tuple[Place, ...]
    install: Install
    joints: tuple[str, ...] = JOINT_NAMES
    """Where it can be."""

    def choose_joints(self, place: Place, rng: np.random.Generator) -> tuple[str, ...]:
        """Joints for a kind of place, in canonical order; none for the body.

        Raises:
            ValueError: The fault cannot act there.
        """
        if place not in self.places:
            raise ValueError(f"fault {self.name} cannot act at place {place!r}; allowed: {', '.join(self.places)}")
        if place == "body":
            return ()
        if place == "joint":
            return (str(rng.choice(self.joints)),)
        if place == "type":
            kinds = [t for t in JOINT_TYPES if any(j.endswith(t) for j in self.joints)]
            chosen = str(rng.choice(kinds))
            return tuple(j for j in self.joints if j.endswith(chosen))
        if place == "leg":
            leg = str(rng.choice(LEG_NAMES))
            return tuple(j for j in self.joints if j.startswith(leg))
        return self.joints


def flags_of(joints: tuple[str, ...]) -> Flags:
    """Canonical names as flags, shape (12,)."""
    return np.array([name in joints for name in JOINT_NAMES])


def at(flags: Flags, value: float) -> Array:
    """A value at some joints, 0 at the others; shape (12,)."""
    return np.where(flags, value, 0.0)


def sign(rng: np.random.Generator) -> float:
    """Plus or minus one."""
    return float(rng.choice((-1.0, 1.0)))
