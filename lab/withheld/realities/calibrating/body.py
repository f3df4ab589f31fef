"""Masses that no model knows: bodies of their own, fixed to the robot; and ground that is slippery or soft."""

from __future__ import annotations

import mujoco
import numpy as np

from spot_model.robot import facts
from spot_model.robot.facts import JOINT_NAMES
from spot_model.robot.mjcf_options import MjcfOptions
from withheld.realities.fault_kind import BODY, LEG_PLACES, Ask, FaultKind, Parameters
from withheld.simulator.parameters import Settings
from withheld.simulator.robot import Robot, leg_mask

PAYLOAD_KG = 12.0
PAYLOAD_HALF_M = (0.14, 0.09, 0.06)
LEG_SHARE = 0.5
GRIP_LOSS = 0.6
SOFTER = 2.2
MORE_DAMPING = 0.3
LINK_OF = {"hx": "hip", "hy": "uleg", "kn": "lleg"}


def payload(robot: Robot, ask: Ask) -> Parameters:
    """A box on the back, as a body of its own with its own inertia."""
    mass = ask.size * PAYLOAD_KG
    low, high = (-0.15, -0.03, 0.09), (0.15, 0.03, 0.18)
    place = ask.rng.uniform(low, high)
    x, y, z = PAYLOAD_HALF_M
    inertia = mass / 3.0 * np.array([y * y + z * z, x * x + z * z, x * x + y * y])

    def edit(spec: mujoco.MjSpec) -> None:
        add_mass(spec, "body", "payload", mass, place, inertia)

    robot.spec_edits.append(edit)
    return {
        "payload_mass.mass_kg": mass,
        **{f"payload_mass.{axis}_m": float(v) for axis, v in zip("xyz", place, strict=True)},
    }


def boots(robot: Robot, ask: Ask) -> Parameters:
    """Weights strapped to leg links a little outside of their centres."""
    share = ask.size * LEG_SHARE
    out = float(ask.rng.uniform(0.9, 1.2))
    links = {"hx": facts.HIP_FL, "hy": facts.UPPER_LEG_FL, "kn": facts.LOWER_LEG_FL}
    chosen = [name for name, acts in zip(JOINT_NAMES, ask.joints, strict=True) if acts]

    def edit(spec: mujoco.MjSpec) -> None:
        for name in chosen:
            leg, kind = name.split("_")
            link = f"{leg}_{LINK_OF[kind]}"
            mass = share * links[kind].mass_kg
            place = out * np.array(spec.body(link).ipos)
            spread = 0.5 * share * np.array(links[kind].inertia_kg_m2[:3])
            add_mass(spec, link, f"{link}_boot", mass, place, spread)

    robot.spec_edits.append(edit)
    return {"leg_mass.scale": 1.0 + share}


def add_mass(
    spec: mujoco.MjSpec, link: str, name: str, mass_kg: float, place_m: np.ndarray, inertia_kg_m2: np.ndarray
) -> mujoco.MjsBody:
    """Fix a body of its own to a link."""
    return spec.body(link).add_body(
        name=name, pos=place_m, ipos=np.zeros(3), mass=mass_kg, inertia=inertia_kg_m2, explicitinertial=True
    )


def slippery(robot: Robot, ask: Ask) -> Parameters:
    """Less friction under some feet, or all."""
    scale = 1.0 - ask.size * GRIP_LOSS

    robot.foot_friction = np.where(leg_mask(ask.joints), robot.foot_friction * scale, robot.foot_friction)
    return {"ground_friction.scale": scale}


def soft(robot: Robot, ask: Ask) -> Parameters:
    """A mat: contacts that give way further, later, and with more loss."""
    softer, damped = 1.0 + ask.size * SOFTER, 1.0 + ask.size * MORE_DAMPING

    legs = leg_mask(ask.joints)
    robot.foot_softness = np.where(legs, robot.foot_softness * softer, robot.foot_softness)
    robot.foot_damping = np.where(legs, robot.foot_damping * damped, robot.foot_damping)

    # MuJoCo's time constant of a contact is 2 over the damping of its direct form.
    usual_s = 2.0 / Settings().contact_damping_per_s
    more = usual_s * softer / damped - MjcfOptions().contact_solref[0]
    return {"ground_compliance.time_constant_s": more} if more > 0.0 else {}


KINDS = (
    FaultKind("box_on_the_back", "body", ("payload_mass",), BODY, payload),
    FaultKind("boots", "body", ("leg_mass",), ("type", "leg", "all"), boots),
    FaultKind("slippery_ground", "ground", ("ground_friction",), LEG_PLACES, slippery),
    FaultKind("soft_ground", "ground", ("ground_compliance",), LEG_PLACES, soft),
)
