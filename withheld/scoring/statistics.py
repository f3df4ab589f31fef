"""Shares with exact bounds, Brier score and reliability, area under a curve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import beta

LEVEL: Final = 0.95


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

    def to_data(self) -> dict[str, float | int | None]:
        """For JSON."""
        return {"hits": self.hits, "trials": self.trials, "value": self.value, "low": self.low, "high": self.high}

    def __str__(self) -> str:
        if not self.trials:
            return "no case"
        of = f"{self.hits}/{self.trials}, {100 * self.low:.0f} to {100 * self.high:.0f}"
        return f"{100 * self.hits / self.trials:.0f} % ({of})"


@dataclass(frozen=True)
class Average:
    """A mean with a bootstrap interval (95 %) over cases."""

    values: tuple[float, ...]

    @property
    def value(self) -> float | None:
        """None without values."""
        return float(np.mean(self.values)) if self.values else None

    def to_data(self) -> dict[str, float | int | None]:
        """For JSON."""
        low, high = self.interval()
        return {"trials": len(self.values), "value": self.value, "low": low, "high": high}

    def interval(self) -> tuple[float | None, float | None]:
        """Bounds."""
        if not self.values:
            return None, None
        rng = np.random.default_rng(0)
        v = np.array(self.values)
        means = v[rng.integers(len(v), size=(1000, len(v)))].mean(axis=1)
        return float(np.quantile(means, 0.025)), float(np.quantile(means, 0.975))

    def __str__(self) -> str:
        low, high = self.interval()
        if self.value is None or low is None or high is None:
            return "no case"
        return f"{self.value:.2f} ({len(self.values)}, {low:.2f} to {high:.2f})"


def brier(probabilities: Sequence[float], truths: Sequence[bool]) -> float | None:
    """Mean squared error of probabilities."""
    if not probabilities:
        return None
    return float(np.mean((np.array(probabilities) - np.array(truths, dtype=np.float64)) ** 2))


@dataclass(frozen=True)
class Bin:
    """One bar of a reliability diagram."""

    said: float
    share: Share


def reliability(probabilities: Sequence[float], truths: Sequence[bool], n_bins: int = 10) -> list[Bin]:
    """Stated probability against how often it was so, in equal steps of probability; empty ones are left out."""
    p, t = np.array(probabilities, dtype=np.float64), np.array(truths, dtype=np.bool_)
    number = np.minimum((p * n_bins).astype(int), n_bins - 1)
    return [
        Bin(float(p[number == b].mean()), Share(int(t[number == b].sum()), int((number == b).sum())))
        for b in range(n_bins)
        if (number == b).any()
    ]
