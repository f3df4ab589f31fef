"""What every part of a training config shares: frozen, strict, and explained errors."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict


class Config(BaseModel):
    """A frozen part of a config; an unknown key is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def _rises(value: tuple[float, float]) -> tuple[float, float]:
    if value[0] > value[1]:
        raise ValueError(f"low {value[0]} exceeds high {value[1]}; allowed: [low, high] with low <= high")
    return value


Range = Annotated[tuple[float, float], AfterValidator(_rises)]
"""Bounds [low, high] of a uniform draw; equal bounds give a constant."""
