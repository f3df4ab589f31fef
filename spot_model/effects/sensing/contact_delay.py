"""Delayed foot contact flags."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import BodyEstimate, Draws, EstimateEffect, JointReading, Memory, parameter
from spot_model.robot.arrays import namespace_of

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
        return estimate.foot_contact, namespace_of(estimate.foot_contact).zeros_like(estimate.foot_contact)

    def estimate(
        self, estimate: BodyEstimate, joints: JointReading, dt_s: float, memory: Memory, rng: Draws
    ) -> tuple[BodyEstimate, Memory]:
        """Hold the flags back."""
        xp = namespace_of(estimate.foot_contact)
        flags, differs_s = memory
        # A leg's delay is that of its joints, the largest of the three.
        own_s = xp.where(self.mask_like(estimate.foot_contact), self.delay_s, 0.0)
        own_s = xp.max(xp.reshape(own_s, (own_s.shape[0], -1, JOINTS_A_LEG)), axis=-1)
        differs_s = xp.where(estimate.foot_contact != flags, differs_s + dt_s, 0.0)
        # Half a step of slack: times are sums of steps.
        due = differs_s > own_s + 0.5 * dt_s if math.isfinite(dt_s) else differs_s >= 0.0
        flags = xp.where(due | (own_s <= 0.0), estimate.foot_contact, flags)
        return dataclasses.replace(estimate, foot_contact=flags), (flags, differs_s)
