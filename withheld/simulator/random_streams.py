"""One generator for each purpose, so that a fault more or less moves no other draw."""

from __future__ import annotations

import zlib

import numpy as np


def stream(seed: int, *purpose: object) -> np.random.Generator:
    """The generator of a seed and a purpose."""
    words = [zlib.crc32(repr(part).encode()) for part in purpose]
    return np.random.default_rng(np.random.SeedSequence([seed, *words]))
