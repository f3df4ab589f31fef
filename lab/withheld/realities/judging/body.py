"""Masses, feet and ground."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np

from spot_model.robot.facts import JOINT_NAMES
from spot_model.robot.mjcf_options import MjcfOptions
from withheld.realities.fault_kind import BODY, LEG_PLACES, Ask, FaultKind, Parameters, sign
from withheld.simulator.parameters import Settings
from withheld.simulator.robot import Robot, leg_mask

SADDLE_KG: Final = 12.0
SHIFT_M: Final = 0.05
INERTIA_SHARE: Final = 0.35
LINK_SHARE: Final = 0.5
SOLE_M: Final = 0.006
GRIP_LOSS: Final = 0.6
SOFTER: Final = 2.2
LINK_OF: Final = {"hx": "hip", "hy": "uleg", "kn": "lleg"}


def saddlebags(robot: Robot, ask: Ask) -> Parameters:
    """Two bags, one on each side of the back."""
    mass = ask.size * SADDLE_KG
    x, z = float(ask.rng.uniform(-0.15, 0.15)), float(ask.rng.uniform(0.06, 0.14))

    def edit(spec: mujoco.MjSpec) -> None:
        for side in (-1.0, 1.0):
            spec.body("body").add_body(
                name=f"bag{side:+.0f}",
                pos=[x, 0.1 * side, z],
                mass=0.5 * mass,
                ipos=[0.0, 0.0, 0.0],
                inertia=np.full(3, 0.5 * mass * 4e-3),
                explicitinertial=True,
            )

    robot.spec_edits.append(edit)
    return {"payload_mass.mass_kg": mass, "payload_mass.x_m": x, "payload_mass.y_m": 0.0, "payload_mass.z_m": z}


def shifted(robot: Robot, ask: Ask) -> Parameters:
    """The body's centre of mass sits elsewhere."""
    towards = float(ask.rng.uniform(-np.pi, np.pi))
    shift = ask.size * SHIFT_M * np.array([np.cos(towards), 0.5 * np.sin(towards), 0.0])

    def edit(model: mujoco.MjModel) -> None:
        model.body_ipos[model.body("body").id] += shift

    robot.model_edits.append(edit)
    return {"com_offset.x_m": float(shift[0]), "com_offset.y_m": float(shift[1])}


def spread(robot: Robot, ask: Ask) -> Parameters:
    """The body's mass lies further out."""
    scale = 1.0 + ask.size * INERTIA_SHARE

    def edit(model: mujoco.MjModel) -> None:
        model.body_inertia[model.body("body").id] *= scale

    robot.model_edits.append(edit)
    return {"body_inertia.scale": scale}


def heavy_links(robot: Robot, ask: Ask) -> Parameters:
    """Links of other castings: heavier throughout."""
    scale = 1.0 + ask.size * LINK_SHARE
    chosen = [name.split("_") for name, acts in zip(JOINT_NAMES, ask.joints, strict=True) if acts]

    def edit(model: mujoco.MjModel) -> None:
        for leg, kind in chosen:
            link = model.body(f"{leg}_{LINK_OF[kind]}").id
            model.body_mass[link] *= scale
            model.body_inertia[link] *= scale

    robot.model_edits.append(edit)
    return {"leg_mass.scale": scale}


def soles(robot: Robot, ask: Ask) -> Parameters:
    """Soles that are worn, or thicker."""
    change = ask.size * SOLE_M * (-1.0 if ask.rng.random() < 0.7 else sign(ask.rng))

    robot.foot_radius_m = robot.foot_radius_m + np.where(leg_mask(ask.joints), change, 0.0)
    return {"foot_radius.change_m": change}


def ice(robot: Robot, ask: Ask) -> Parameters:
    """Less grip; relative to the nominal model's 0.8."""
    scale = 1.0 - ask.size * GRIP_LOSS

    robot.foot_friction = np.where(leg_mask(ask.joints), 0.8 * scale, robot.foot_friction)
    return {"ground_friction.scale": scale}


def lawn(robot: Robot, ask: Ask) -> Parameters:
    """Ground that gives way."""
    softer = 1.0 + ask.size * SOFTER

    robot.foot_softness = np.where(leg_mask(ask.joints), robot.foot_softness * softer, robot.foot_softness)

    # MuJoCo's time constant of a contact is 2 over the damping of its direct form.
    more = 2.0 / Settings().contact_damping_per_s * softer - MjcfOptions().contact_solref[0]
    return {"ground_compliance.time_constant_s": more} if more > 0.0 else {}


KINDS: Final = (
    FaultKind("saddlebags", "body", ("payload_mass",), BODY, saddlebags),
    FaultKind("shifted_battery", "body", ("com_offset",), BODY, shifted),
    FaultKind("spread_body", "body", ("body_inertia",), BODY, spread),
    FaultKind("heavy_links", "body", ("leg_mass",), ("type", "leg", "all"), heavy_links),
    FaultKind("other_soles", "body", ("foot_radius",), LEG_PLACES, soles),
    FaultKind("ice", "ground", ("ground_friction",), LEG_PLACES, ice),
    FaultKind("lawn", "ground", ("ground_compliance",), LEG_PLACES, lawn),
)
