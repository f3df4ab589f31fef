"""Friction that grows with the torque the gear carries."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import Memory, Motion, TorqueEffect, parameter
from spot_model.effects.friction import smooth_sign
from spot_model.robot.arrays import namespace_of
from spot_model.robot.rotation import AnyArray


@dataclass(frozen=True, kw_only=True)
class LoadFriction(TorqueEffect):
    """Loss of k times the torque that the gear passes on, against the motion: a gear's efficiency.

    Of a motor's torque τ it passes on g = τ − k·|g|·sign(q̇), so g = τ/(1 + k·sign(τ·q̇)): less than τ where the motor
    drives, more where the load drives it back.

    Source: load-dependent friction models of geared actuators (BAM, arXiv 2410.08650); 2 to 10 %, and 10 to 25 %
    in lead screws.
    """

    name: ClassVar[str] = "load_friction"

    share: Any = parameter(null=0.0, low=0.0, high=0.9, unit="1", source="gears 0.02 to 0.10, lead screws 0.10 to 0.25")

    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """What is passed on."""
        xp = namespace_of(torque_nm)
        return torque_nm / (1.0 + self.share * xp.sign(torque_nm) * smooth_sign(motion.velocity_rad_s)), memory
