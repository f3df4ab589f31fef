"""What a closed loop depends on and no log shows directly: the ground, and the robot's own state estimator."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from spot_model.effects.body.ground_compliance import GroundCompliance
from spot_model.effects.sensing.leg_odometry import LegOdometry
from spot_model.io.model_file import RobotModel
from spot_model.robot.mjcf import MjcfOptions

_OWN: Final = MjcfOptions().contact_solref
HARDEST_S: Final = 2.0 * MjcfOptions().timestep_s
"""No contact has a shorter time constant: a model is trained in physics steps of this length's half, and MuJoCo lets no
contact act faster than in two."""
LEAST_DAMPING: Final = _OWN[1] + next(p.low for p in GroundCompliance.parameters() if p.name == "damping_ratio")
"""No contact has a smaller damping ratio: feet would bounce."""


@dataclass(frozen=True)
class Surroundings:
    """The ground's contact and the estimator; the simulator's own by default."""

    contact_time_constant_s: float = _OWN[0]
    contact_damping_ratio: float = _OWN[1]
    odometry_time_s: float = 0.0
    """In which standing legs pull the reported velocity; 0 for one that is true. See :class:`LegOdometry`."""

    def around(self, model: RobotModel) -> RobotModel:
        """The model in these surroundings. They come first: what is wrong with an estimate comes on top of it.

        A ground that the model has itself adds to this one; together they stay within :data:`HARDEST_S` and
        :data:`LEAST_DAMPING`.
        """
        own_s, own_ratio = _own_ground(model)
        ground = GroundCompliance(
            time_constant_s=max(self.contact_time_constant_s, HARDEST_S - own_s) - _OWN[0],
            damping_ratio=max(self.contact_damping_ratio, LEAST_DAMPING - own_ratio) - _OWN[1],
        )
        odometry = LegOdometry(time_s=self.odometry_time_s)
        added = tuple(effect for effect in (ground, odometry) if not effect.is_null)
        return replace(model, effects=(*added, *model.effects))


def _own_ground(model: RobotModel) -> tuple[float, float]:
    """What the model's own effects add to time constant and damping ratio, at the leg with the least of each."""
    found = [e for e in model.effects if isinstance(e, GroundCompliance)]
    sums = [
        sum((np.where(e.mask, getattr(e, name), 0.0) for e in found), start=np.zeros(1))
        for name in ("time_constant_s", "damping_ratio")
    ]
    return float(np.min(sums[0])), float(np.min(sums[1]))
