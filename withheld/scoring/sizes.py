"""Whether a fault matters: by how much it moves the gap, in the simulated truth."""

from __future__ import annotations

from enum import Enum
from typing import Final

from withheld.outcome import Outcome
from withheld.plan import Fault

LARGE: Final = 2.0
"""A fault matters if it moves the headline gap by at least this many times its floor."""
SMALL: Final = 0.5
"""A fault that moves it by less does not matter to the gap."""


class Size(Enum):
    """By how much a fault moves the gap."""

    LARGE = "by twice its floor or more"
    BETWEEN = "by half its floor to twice its floor"
    SMALL = "by less than half its floor"
    UNMEASURED = "cannot be measured, the robot falls"


def size_of(moved: float | None) -> Size:
    """The class of a distance, from :func:`withheld.measuring.distances.moved`."""
    if moved is None:
        return Size.UNMEASURED
    return Size.LARGE if moved >= LARGE else Size.SMALL if moved < SMALL else Size.BETWEEN


def sizes(o: Outcome) -> tuple[Size, ...]:
    """Of each fault of a case."""
    moved = (*o.moved, *([None] * len(o.truth.faults)))
    return tuple(size_of(m) for m, _ in zip(moved, o.truth.faults, strict=False))


def is_named_by_library(fault: Fault, o: Outcome) -> bool:
    """Whether the case's library holds an effect that is a right answer."""
    return bool(set(fault.names) - set(o.case.without))


def is_outside(o: Outcome) -> bool:
    """Whether the case has a fault, and none that its library could name."""
    return bool(o.truth.faults) and not any(is_named_by_library(f, o) for f in o.truth.faults)
