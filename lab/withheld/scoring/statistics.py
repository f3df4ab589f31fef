"""Figures with their intervals, and whether what is asked of them is met: by the bounds, never by the value."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta

LEVEL: Final = 0.95
N_RESAMPLES: Final = 1000
N_BINS: Final = 10

Statistic = Callable[[NDArray[np.float64]], float]


@dataclass(frozen=True)
class Share:
    """Hits of trials, with the Clopper-Pearson interval (95 %, two-sided)."""

    hits: int
    trials: int

    @staticmethod
    def of(flags: Sequence[bool]) -> Share:
        """Count."""
        return Share(sum(bool(f) for f in flags), len(flags))

    @property
    def value(self) -> float | None:
        """None without trials."""
        return self.hits / self.trials if self.trials else None

    @property
    def low(self) -> float:
        """Lower bound."""
        return float(beta.ppf((1 - LEVEL) / 2, self.hits, self.trials - self.hits + 1)) if self.hits else 0.0

    @property
    def high(self) -> float:
        """Upper bound."""
        if self.hits == self.trials:
            return 1.0
        return float(beta.ppf((1 + LEVEL) / 2, self.hits + 1, self.trials - self.hits))

    def to_data(self) -> dict[str, Any]:
        """For JSON."""
        return {"hits": self.hits, "trials": self.trials, "value": self.value, "low": self.low, "high": self.high}

    def __str__(self) -> str:
        if not self.trials:
            return "no case"
        return f"{100 * self.hits / self.trials:.0f} % ({self.hits}/{self.trials}; {_bounds(self.low, self.high, 100)})"


@dataclass(frozen=True)
class Estimate:
    """A statistic of cases with its bootstrap interval (95 %)."""

    value: float | None
    low: float
    high: float
    trials: int

    @staticmethod
    def of(values: Sequence[Any], statistic: Statistic) -> Estimate:
        """Resample whole rows of ``values``; a row is a case."""
        if not len(values):
            return Estimate(None, float("-inf"), float("inf"), 0)
        v, rng = np.asarray(values, dtype=np.float64), np.random.default_rng(0)
        made = [statistic(v[rng.integers(len(v), size=len(v))]) for _ in range(N_RESAMPLES)]
        low, high = np.quantile(made, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
        return Estimate(statistic(v), float(low), float(high), len(v))

    def to_data(self) -> dict[str, Any]:
        """For JSON."""
        bounds = {"low": self.low, "high": self.high} if self.trials else {"low": None, "high": None}
        return {"trials": self.trials, "value": self.value, **bounds}

    def __str__(self) -> str:
        if self.value is None:
            return "no case"
        return f"{self.value:.2f} ({self.trials}; {_bounds(self.low, self.high, 1)})"


def mean(values: NDArray[np.float64]) -> float:
    """Mean of a column."""
    return float(np.mean(values))


def median(values: NDArray[np.float64]) -> float:
    """Median of a column."""
    return float(np.median(values))


def calibration_error(claims: NDArray[np.float64]) -> float:
    """Expected calibration error of rows (stated probability, 0 or 1), in bins of a tenth.

    Source: Naeini, Cooper, Hauskrecht 2015.
    """
    said, was = claims[:, 0], claims[:, 1]
    number = np.minimum((said * N_BINS).astype(int), N_BINS - 1)
    off = [abs(float(np.sum(said[number == b] - was[number == b]))) for b in range(N_BINS)]
    return sum(off) / len(claims)


def _bounds(low: float, high: float, factor: float) -> str:
    return f"{factor * low:.0f} to {factor * high:.0f}" if factor > 1 else f"{low:.2f} to {high:.2f}"


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
