"""An effect of one's own: drag of gear oil that grows with the square of the speed.

A diagnosis said *unknown effect*, at the hips, depending on velocity, and its curve was a parabola. So:

    PYTHONPATH=examples spot-rl diagnose LOGS --nominal MODEL --out DIR --add-effect oil_drag:OilDragEntry
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from diagnosis.channels.channel import Channel
from diagnosis.library.base import Coefficient, LibraryEffect, on_joints
from diagnosis.library.experiments import SPRINT
from spot_model.effects.base import TorqueEffect, parameter


@dataclass(frozen=True, kw_only=True)
class OilDrag(TorqueEffect):
    """How it acts in the simulator: τ −= c·q̇·|q̇|."""

    name: ClassVar[str] = "oil_drag"
    drag: Any = parameter(null=0.0, low=0.0, high=1.0, unit="N·m·s²/rad²", source="my gearbox")

    def torque(self, torque_nm, motion, memory):
        """Torque less the drag."""
        return torque_nm - self.drag * motion.velocity_rad_s * abs(motion.velocity_rad_s), memory


class OilDragEntry(LibraryEffect):
    """What it looks like in logs: in channel *set-point to load* a column −q̇·|q̇|, times the drag."""

    name, title, effect, channels = "oil_drag", "drag of gear oil", OilDrag, (Channel.SET_POINT_TO_LOAD,)
    coefficients = (Coefficient("drag", "N·m·s²/rad²", 0.0, 1.0),)
    confused_with, split_by = ("viscous_friction",), SPRINT

    def columns(self, view, shape, joints):
        """The drag of one unit, smoothed and thinned as the channel is."""
        velocity = view.signals.velocity_rad_s
        return on_joints(view.signals.finish(-velocity * abs(velocity)), joints)

    def values(self, coefficients, shape):
        """The effect's parameters from the fitted coefficients."""
        return {"drag": float(coefficients[0])}
