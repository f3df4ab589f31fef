"""What a closed loop depends on and no log shows directly: the ground, and the robot's own state estimator."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from spot_model.effects.body.ground_compliance import GroundCompliance
from spot_model.effects.sensing.leg_odometry import LegOdometry
from spot_model.io.model_file import RobotModel
from spot_model.robot.mjcf import MjcfOptions

_OWN: Final = MjcfOptions().contact_solref


@dataclass(frozen=True)
class Surroundings:
    """The ground's contact and the estimator; the simulator's own by default."""

    contact_time_constant_s: float = _OWN[0]
    contact_damping_ratio: float = _OWN[1]
    odometry_time_s: float = 0.0
    """In which standing legs pull the reported velocity; 0 for one that is true. See :class:`LegOdometry`."""

    def around(self, model: RobotModel) -> RobotModel:
        """The model in these surroundings. They come first: what is wrong with an estimate comes on top of it."""
        ground = GroundCompliance(
            time_constant_s=self.contact_time_constant_s - _OWN[0],
            damping_ratio=self.contact_damping_ratio - _OWN[1],
        )
        odometry = LegOdometry(time_s=self.odometry_time_s)
        added = tuple(effect for effect in (ground, odometry) if not effect.is_null)
        return replace(model, effects=(*added, *model.effects))
