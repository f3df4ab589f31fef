"""How every reality computes: step, integrator, contact. All three differ from the plant's and the fake robot's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from spot_model.robot.facts import STATE_PERIOD_NS

GRAVITY_M_S2: Final = 9.81


@dataclass(frozen=True)
class Settings:
    """Numbers of the simulation that are no property of the robot.

    The nominal plant steps 5 ms (in the diagnosis 1.5 ms) by Euler's method, the fake robot 1.5 ms by ``implicitfast``,
    both with spherical feet and contacts given by a time constant.
    """

    steps_per_state: int = 6
    """Physics steps in the 3 ms between two states."""
    integrator: str = "implicit"
    impratio: float = 2.0
    """Stiffness of friction over that of the normal force."""
    contact_stiffness_per_s2: float = 5200.0
    contact_damping_per_s: float = 148.0
    """MuJoCo's direct form of a contact: acceleration by depth and by speed."""
    settle_s: float = 0.9
    """Standing before the log begins."""
    ramp_s: float = 1.0
    """From the stand to the policy, in the log."""
    tail_s: float = 0.1

    @property
    def step_s(self) -> float:
        """Length of a physics step."""
        return STATE_PERIOD_NS * 1e-9 / self.steps_per_state
