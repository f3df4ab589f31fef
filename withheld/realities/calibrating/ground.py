"""Ground that is slippery or soft."""

from __future__ import annotations

import numpy as np

from spot_model.robot.mjcf_options import MjcfOptions
from withheld.realities.fault_kind import Ask, Built
from withheld.simulator.robot import Robot, leg_mask
from withheld.simulator.settings import Settings

GRIP_LOSS = 0.6
SOFTER = 2.2
MORE_DAMPING = 0.3


def slippery(ask: Ask) -> Built:
    """Less friction under some feet, or all."""
    scale = 1.0 - ask.size * GRIP_LOSS

    def install(robot: Robot) -> None:
        robot.foot_friction = np.where(leg_mask(ask.joints), robot.foot_friction * scale, robot.foot_friction)

    return Built(install, {"ground_friction.scale": scale})


def soft(ask: Ask) -> Built:
    """A mat: contacts that give way further, later, and with more loss."""
    softer, damped = 1.0 + ask.size * SOFTER, 1.0 + ask.size * MORE_DAMPING

    def install(robot: Robot) -> None:
        legs = leg_mask(ask.joints)
        robot.foot_softness = np.where(legs, robot.foot_softness * softer, robot.foot_softness)
        robot.foot_damping = np.where(legs, robot.foot_damping * damped, robot.foot_damping)

    # MuJoCo's time constant of a contact is 2 over the damping of its direct form.
    usual_s = 2.0 / Settings().contact_damping_per_s
    more = usual_s * softer / damped - MjcfOptions().contact_solref[0]
    return Built(install, {"ground_compliance.time_constant_s": more} if more > 0.0 else {})
