"""What files of settings are read into: unknown keys are refused, nothing changes later, and NaN is no number."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field


class Settings(BaseModel):
    """A part of such a file."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True, allow_inf_nan=False)


def positive(default: float, most: float, description: str | None = None) -> Any:
    """A number above 0 and at most ``most``, with its default and what it means."""
    return Field(default=default, gt=0.0, le=most, description=description)


def between(default: float, least: float, most: float, description: str | None = None) -> Any:
    """A number from ``least`` to ``most``, with its default and what it means."""
    return Field(default=default, ge=least, le=most, description=description)
