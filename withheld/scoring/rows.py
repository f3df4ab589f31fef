"""One figure with what is asked of it; *met* is said by the bound of its interval and not by its value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

from withheld.scoring.statistics import Estimate, Share

Met = Literal["met", "not met", "not shown", ""]
"""*met* and *not met*: the whole interval lies on one side of what is asked. *not shown*: it holds both."""


FEWEST: Final = 20
"""Resampling fewer cases tells nothing of how far a mean or a median may be off."""


@dataclass(frozen=True)
class Row:
    """One figure."""

    key: str
    title: str
    value: Share | Estimate
    asked: str = ""
    met: Met = ""

    def to_data(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "key": self.key,
            "title": self.title,
            "asked": self.asked,
            "met": self.met,
            "text": str(self.value),
            **self.value.to_data(),
        }


def share(key: str, title: str, flags: Sequence[bool], at_least: float | None = None) -> Row:
    """A share of cases, and the least that is asked."""
    made = Share.of(flags)
    if at_least is None:
        return Row(key, title, made)
    return Row(key, title, made, f"at least {100 * at_least:.0f} %", _met(made, at_least, float("inf")))


def between(key: str, title: str, flags: Sequence[bool], low: float, high: float) -> Row:
    """A share that is to lie between two bounds."""
    made = Share.of(flags)
    return Row(key, title, made, f"{100 * low:.0f} to {100 * high:.0f} %", _met(made, low, high))


def estimate(
    key: str, title: str, made: Estimate, at_least: float = float("-inf"), at_most: float = float("inf")
) -> Row:
    """A mean or median, and what is asked of it."""
    asked = f"at least {at_least:g}" if at_least > float("-inf") else f"at most {at_most:g}"
    is_asked = (at_least, at_most) != (float("-inf"), float("inf"))
    return Row(key, title, made, asked if is_asked else "", _met(made, at_least, at_most) if is_asked else "")


def _met(value: Share | Estimate, low: float, high: float) -> Met:
    if not value.trials:
        return ""
    if isinstance(value, Estimate) and value.trials < FEWEST:
        return "not shown"
    if low <= value.low and value.high <= high:
        return "met"
    return "not met" if value.high < low or value.low > high else "not shown"
