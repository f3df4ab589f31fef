"""A random delay of commands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import CommandEffect, Draws, parameter, per_sim
from spot_model.robot.rotation import AnyArray


@dataclass(frozen=True, kw_only=True)
class CommandJitter(CommandEffect):
    """An added delay, exponentially distributed.

    Source: send intervals of a published recording vary by 0.5 ms (median) to 3 ms.
    """

    name: ClassVar[str] = "command_jitter"

    mean_s: Any = parameter(null=0.0, low=0.0, high=0.05, unit="s", source="recorded intervals, 0.0005 to 0.003 s")

    def arrival_s(self, issued_s: AnyArray, rng: Draws) -> AnyArray:
        """Issue time plus a drawn delay."""
        return issued_s + per_sim(self.mean_s) * rng.standard_exponential(tuple(issued_s.shape))
