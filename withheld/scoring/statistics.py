"""Shares with exact bounds, means and medians with bootstrap bounds, calibration of stated probabilities."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

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
    """Of a column."""
    return float(np.mean(values))


def median(values: NDArray[np.float64]) -> float:
    """Of a column."""
    return float(np.median(values))


def calibration_error(claims: NDArray[np.float64]) -> float:
    """Expected calibration error of rows (stated probability, 0 or 1), in bins of a tenth.

    Source: Naeini, Cooper, Hauskrecht 2015.
    """
    said, was = claims[:, 0], claims[:, 1]
    number = np.minimum((said * N_BINS).astype(int), N_BINS - 1)
    off = [abs(float(np.sum(said[number == b] - was[number == b]))) for b in range(N_BINS)]
    return sum(off) / len(claims)


def reliability(claims: Sequence[tuple[float, bool]]) -> list[tuple[float, Share]]:
    """Stated probability and how often it was so, in bins of a tenth; empty bins are left out."""
    made = []
    for b in range(N_BINS):
        inside = [(p, was) for p, was in claims if min(int(p * N_BINS), N_BINS - 1) == b]
        if inside:
            made.append((float(np.mean([p for p, _ in inside])), Share.of([was for _, was in inside])))
    return made


def _bounds(low: float, high: float, factor: float) -> str:
    return f"{factor * low:.0f} to {factor * high:.0f}" if factor > 1 else f"{low:.2f} to {high:.2f}"
