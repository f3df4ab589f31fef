"""Stated consequences of differences that were named right, against what the faults truly do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from withheld.outcome import Change, Difference, Outcome, QuantityChange
from withheld.scoring.scores import score
from withheld.scoring.sizes import POWER

SPEED_M_S: Final = 0.05
SHARE: Final = 0.3
"""Of the true change of a speed or of the power; and of the runs, for falls."""
SPEEDS: Final = ("top_speed", "mean_speed")


def speeds_right(o: Outcome) -> list[bool]:
    """Whether each stated change of top and mean speed is within 0.05 m/s or 30 % of the true one."""
    return [
        stated is not None and abs(stated - true) <= max(SPEED_M_S, SHARE * abs(true))
        for quantity in SPEEDS
        for true, stated in _changes(o, quantity, _difference)
    ]


def power_right(o: Outcome) -> list[bool]:
    """Whether each change of the power, as a share of it, is within 30 % of the true one; where either is 5 % or more.

    As a share: what a robot draws beside the work of its joints is none of the model's.
    """
    return [
        stated is not None and abs(stated - true) <= SHARE * abs(true)
        for true, stated in _changes(o, "power", _share)
        if max(abs(true), abs(stated or 0.0)) >= POWER
    ]


def falls_right(o: Outcome) -> list[bool]:
    """Whether the stated change of the share of runs that fall is within 0.3 of the true one."""
    return [
        stated is not None and abs(stated - true) <= SHARE for true, stated in _changes(o, "fall_share", _difference)
    ]


Of = Callable[[Change | QuantityChange], float | None]


def _changes(o: Outcome, quantity: str, of: Of) -> list[tuple[float, float | None]]:
    """True and stated change by each fault that is named, where the true one is known."""
    found = []
    for number, difference in score(o).named.items():
        own = o.consequences[number] if number < len(o.consequences) else None
        true = of(getattr(own, quantity)) if own is not None else None
        if true is not None:
            stated = _stated(difference, quantity)
            found.append((true, of(stated) if stated is not None else None))
    return found


def _stated(difference: Difference, quantity: str) -> QuantityChange | None:
    changes = difference.consequences.changes if difference.consequences is not None else ()
    return next((change for change in changes if change.quantity == quantity), None)


def _difference(change: Change | QuantityChange) -> float | None:
    return None if change.before is None or change.after is None else change.after - change.before


def _share(change: Change | QuantityChange) -> float | None:
    """Of what it was before."""
    difference = _difference(change)
    return None if difference is None or not change.before else difference / change.before
