"""Delayed foot contact flags."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from spot_model.effects.base import BodyEstimate, EstimateEffect, JointReading, Memory, parameter

JOINTS_A_LEG = 3


@dataclass(frozen=True, kw_only=True)
class ContactDelay(EstimateEffect):
    """A contact flag of the joints' legs changes only once the contact has differed from it for a while.

    Source: contact detectors on joint torques, 10 to 40 ms.
    """

    name: ClassVar[str] = "contact_delay"

    delay_s: Any = parameter(null=0.0, low=0.0, high=0.3, unit="s", source="0.01 to 0.04 s")

    def start(self, estimate: BodyEstimate) -> Memory:
        """The flags as they are, and for how long the contact has differed from them."""
        return estimate.foot_contact, np.zeros_like(estimate.foot_contact)

    def estimate(
        self, estimate: BodyEstimate, joints: JointReading, dt_s: float, memory: Memory, rng: np.random.Generator
    ) -> tuple[BodyEstimate, Memory]:
        """Hold the flags back."""
        flags, differs_s = memory
        own_s = np.where(self.mask.reshape(-1, JOINTS_A_LEG).any(axis=1), self.delay_s, 0.0)
        differs_s = np.where(estimate.foot_contact != flags, differs_s + dt_s, 0.0)
        # Half a step of slack: times are sums of steps.
        due = differs_s > own_s + 0.5 * dt_s if math.isfinite(dt_s) else differs_s >= 0.0
        flags = np.where(due | (own_s <= 0.0), estimate.foot_contact, flags)
        return dataclasses.replace(estimate, foot_contact=flags), (flags, differs_s)
