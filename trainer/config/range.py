"""Bounds of what is drawn."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator


def _rises(value: tuple[float, float]) -> tuple[float, float]:
    if value[0] > value[1]:
        raise ValueError(f"low {value[0]} exceeds high {value[1]}; allowed: [low, high] with low <= high")
    return value


Range = Annotated[tuple[float, float], AfterValidator(_rises)]
"""Bounds [low, high] of a uniform draw; equal bounds give a constant."""
