"""Distributions of message delays, as data."""

from __future__ import annotations

import csv
import io
import math
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal, Union

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from spot_model.errors import BadInputError
from spot_model.io.settings import Settings
from spot_model.io.yaml_text import read_at_most

MAX_CSV_BYTES = 1024 * 1024


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


def read_delay_csv(path: Path) -> EmpiricalDelay:
    """Read a histogram from CSV with the header ``low_s,high_s,count`` and touching bins, lowest first.

    Raises:
        BadInputError: The file cannot be read, or is not such a histogram; the message names the row.
    """
    try:
        text = read_at_most(path, MAX_CSV_BYTES).decode("utf-8-sig")
        rows = list(csv.DictReader(io.StringIO(text, newline="")))
    except (OSError, ValueError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise BadInputError(f"delay histogram {path}: {reason}; give a readable CSV file") from error
    edges: list[float] = []
    counts: list[float] = []
    for number, row in enumerate(rows, start=2):
        try:
            low, high, count = (float(row[key]) for key in ("low_s", "high_s", "count"))
        except (KeyError, TypeError, ValueError) as error:
            raise BadInputError(
                f"delay histogram {path}, line {number}: {row}; allowed: numbers under low_s,high_s,count"
            ) from error
        if edges and not math.isclose(low, edges[-1], abs_tol=1e-9):
            raise BadInputError(f"delay histogram {path}, line {number}: low_s = {low}; bins must touch at {edges[-1]}")
        edges = edges or [low]
        edges.append(high)
        counts.append(count)
    try:
        return EmpiricalDelay(edges_s=tuple(edges), counts=tuple(counts))
    except ValueError as error:
        raise BadInputError(f"delay histogram {path}: {error}") from error
