"""A constant delay of commands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import CommandEffect, Draws, parameter, per_sim
from spot_model.robot.rotation import AnyArray


@dataclass(frozen=True, kw_only=True)
class CommandDelay(CommandEffect):
    """A constant delay from policy to servo.

    Source: the paper models the whole path as 5 ms.
    """

    name: ClassVar[str] = "command_delay"

    delay_s: Any = parameter(null=0.0, low=0.0, high=0.2, unit="s", source="the paper: 5 ms")

    def arrival_s(self, issued_s: AnyArray, rng: Draws) -> AnyArray:
        """Issue time plus delay."""
        return issued_s + per_sim(self.delay_s)
