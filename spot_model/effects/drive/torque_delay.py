"""The motor gives a torque a constant time after it was asked for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Final

from spot_model.effects.base import Memory, Motion, TorqueEffect, parameter
from spot_model.robot.arrays import namespace_of
from spot_model.robot.rotation import AnyArray

N_STEPS: Final = 64
"""Physics steps that are remembered; a longer delay counts as this one."""


@dataclass(frozen=True, kw_only=True)
class TorqueDelay(TorqueEffect):
    """τ(t) = τ_asked(t − d), between two physics steps by the straight line.

    The servo's own answer to the joint's motion is late, too; a delay of commands leaves that as it is, and shows in
    the robot's receipts of commands, where this does not.

    Source: dead time of field buses and sampled current loops, 1 to 10 ms.
    """

    name: ClassVar[str] = "torque_delay"

    delay_s: Any = parameter(null=0.0, low=0.0, high=0.03, unit="s", source="field buses and current loops, 1 to 10 ms")

    def start(self, torque_nm: AnyArray) -> Memory:
        """No torque before the first step. Shape (n, 12, :data:`N_STEPS`), newest first."""
        xp = namespace_of(torque_nm)
        return xp.zeros_like(xp.stack([torque_nm] * N_STEPS, axis=-1))

    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """The torque that was asked for a delay ago."""
        xp = namespace_of(torque_nm)
        asked = xp.concat([torque_nm[..., None], memory[..., :-1]], axis=-1)
        steps = xp.minimum(self.delay_s / motion.dt_s, xp.ones_like(self.delay_s) * (N_STEPS - 1))
        ages = xp.cumulative_sum(xp.ones_like(asked[:1, :1]), axis=-1) - 1.0
        weight = xp.maximum(1.0 - xp.abs(ages - steps[..., None]), xp.zeros_like(ages))
        late = xp.sum(weight * asked, axis=-1)
        return xp.where(self.delay_s > 0.0, late, torque_nm), asked
