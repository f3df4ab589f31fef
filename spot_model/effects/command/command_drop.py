"""Commands that never arrive; the previous one stays in effect."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import CommandEffect, Draws, parameter, per_sim
from spot_model.robot.arrays import namespace_of
from spot_model.robot.rotation import AnyArray


@dataclass(frozen=True, kw_only=True)
class CommandDrop(CommandEffect):
    """Each command is lost with the same probability.

    Source: weak wireless links, 0 to 2 %.
    """

    name: ClassVar[str] = "command_drop"

    probability: Any = parameter(null=0.0, low=0.0, high=0.9, unit="1", source="0 to 0.02")

    def arrival_s(self, issued_s: AnyArray, rng: Draws) -> AnyArray:
        """Issue time, or never."""
        is_lost = rng.random(tuple(issued_s.shape)) < per_sim(self.probability)
        return namespace_of(issued_s).where(is_lost, math.inf, issued_s)
