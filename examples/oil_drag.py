"""An effect of one's own: drag of gear oil that grows with the square of the speed.

A diagnosis said *unknown effect*, in set-point to load at the hips, largest in high speed. So:

    PYTHONPATH=examples spot-rl diagnose LOGS --nominal MODEL --out DIR --add-effect oil_drag:OilDrag
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import TorqueEffect, parameter


@dataclass(frozen=True, kw_only=True)
class OilDrag(TorqueEffect):
    """τ −= c·q̇·|q̇|."""

    name: ClassVar[str] = "oil_drag"
    drag: Any = parameter(null=0.0, low=0.0, high=1.0, unit="N·m·s²/rad²", source="my gearbox")

    def torque(self, torque_nm, motion, memory):
        """Torque less the drag."""
        return torque_nm - self.drag * motion.velocity_rad_s * abs(motion.velocity_rad_s), memory
