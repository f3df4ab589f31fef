"""Distributions of message delays, as data."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Literal, Union

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from spot_model.io.settings import Settings


class ConstantDelay(Settings):
    """Always the same."""

    kind: Literal["constant"] = "constant"
    delay_s: float = Field(ge=0.0, le=10.0)
    """The delay."""

    def sample(self, rng: np.random.Generator, n: int) -> NDArray[np.float64]:
        """Draw ``n`` delays, s, shape (n,)."""
        return np.full(n, self.delay_s)


class LogNormalDelay(Settings):
    """A floor plus a log-normal part, by its median and the standard deviation of its logarithm."""

    kind: Literal["log_normal"] = "log_normal"
    floor_s: float = Field(default=0.0, ge=0.0, le=10.0)
    """Smallest delay."""
    median_s: float = Field(gt=0.0, le=10.0, description="Median of the part above the floor.")
    sigma: float = Field(ge=0.0, le=3.0, description="Standard deviation of the logarithm.")

    def sample(self, rng: np.random.Generator, n: int) -> NDArray[np.float64]:
        """Draw ``n`` delays, s, shape (n,)."""
        return self.floor_s + rng.lognormal(math.log(self.median_s), self.sigma, n)


class GammaDelay(Settings):
    """A floor plus a gamma-distributed part."""

    kind: Literal["gamma"] = "gamma"
    floor_s: float = Field(default=0.0, ge=0.0, le=10.0)
    """Smallest delay."""
    shape: float = Field(gt=0.0, le=1000.0)
    """Shape parameter of the part above it."""
    scale_s: float = Field(gt=0.0, le=10.0)
    """Scale parameter of that part; its mean is shape × scale."""

    def sample(self, rng: np.random.Generator, n: int) -> NDArray[np.float64]:
        """Draw ``n`` delays, s, shape (n,)."""
        return self.floor_s + rng.gamma(self.shape, self.scale_s, n)


class EmpiricalDelay(Settings):
    """A measured histogram: bins between edges, drawn by their counts, evenly within a bin."""

    kind: Literal["empirical"] = "empirical"
    edges_s: tuple[float, ...] = Field(min_length=2)
    """Edges of the bins, rising."""
    counts: tuple[float, ...] = Field(min_length=1)
    """Count of each bin; one fewer than edges."""

    def model_post_init(self, _context: object) -> None:
        """Check that edges rise and counts fit them."""
        if len(self.counts) != len(self.edges_s) - 1:
            raise ValueError(f"counts has {len(self.counts)} values for {len(self.edges_s)} edges; one fewer is needed")
        if self.edges_s[0] < 0.0 or any(b <= a for a, b in pairwise(self.edges_s)):
            raise ValueError("edges_s must rise from 0 or above")
        if min(self.counts) < 0.0 or sum(self.counts) <= 0.0:
            raise ValueError("counts must be at least 0, and one above 0")

    def sample(self, rng: np.random.Generator, n: int) -> NDArray[np.float64]:
        """Draw ``n`` delays, s, shape (n,)."""
        counts, edges = np.asarray(self.counts), np.asarray(self.edges_s)
        bins = rng.choice(len(counts), size=n, p=counts / counts.sum())
        return np.asarray(edges[bins] + rng.random(n) * (edges[bins + 1] - edges[bins]))


Delay = Annotated[
    Union[ConstantDelay, LogNormalDelay, GammaDelay, EmpiricalDelay],  # noqa: UP007 - pydantic on Python 3.10
    Field(discriminator="kind"),
]
