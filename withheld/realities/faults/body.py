"""Masses that no model knows: bodies of their own, fixed to the robot; and feet that are worn."""

from __future__ import annotations

import mujoco
import numpy as np

from spot_model.robot import facts
from spot_model.robot.facts import JOINT_NAMES
from withheld.realities.fault_kind import Ask, Built, sign
from withheld.realities.robot import Robot, leg_mask

PAYLOAD_KG = 12.0
PAYLOAD_HALF_M = (0.14, 0.09, 0.06)
COM_M = 0.05
BALLAST_KG = 4.0
INERTIA_SHARE = 0.35
DUMBBELL_KG = 0.8
LEG_SHARE = 0.5
WEAR_M = 0.006
LINK_OF = {"hx": "hip", "hy": "uleg", "kn": "lleg"}


def payload(ask: Ask) -> Built:
    """A box on the back, as a body of its own with its own inertia."""
    mass = ask.size * PAYLOAD_KG
    low, high = (-0.15, -0.03, 0.09), (0.15, 0.03, 0.18)
    place = ask.rng.uniform(low, high)
    x, y, z = PAYLOAD_HALF_M
    inertia = mass / 3.0 * np.array([y * y + z * z, x * x + z * z, x * x + y * y])

    def edit(spec: mujoco.MjSpec) -> None:
        add_mass(spec, "body", "payload", mass, place, inertia)

    return Built(lambda robot: robot.spec_edits.append(edit) if mass > 0.0 else None, {
        "payload_mass.mass_kg": mass,
        **{f"payload_mass.{axis}_m": float(v) for axis, v in zip("xyz", place, strict=True)},
    })  # fmt: skip


def ballast(ask: Ask) -> Built:
    """Part of the body's mass sits elsewhere: batteries and rails that moved."""
    towards = float(ask.rng.uniform(-np.pi, np.pi))
    shift = ask.size * COM_M * np.array([np.cos(towards), 0.5 * np.sin(towards), 0.0])
    place = shift * facts.BODY.mass_kg / BALLAST_KG

    def edit(spec: mujoco.MjSpec) -> None:
        body = spec.body("body")
        body.mass -= BALLAST_KG
        com = np.array(facts.BODY.com_m)
        inertia = BALLAST_KG * np.array([2e-3, 2e-3, 2e-3])
        add_mass(spec, "body", "ballast", BALLAST_KG, com + place, inertia)

    return Built(lambda robot: robot.spec_edits.append(edit) if ask.size > 0.0 else None, {
        "com_offset.x_m": float(shift[0]), "com_offset.y_m": float(shift[1])
    })  # fmt: skip


def dumbbells(ask: Ask) -> Built:
    """Six masses around the body's centre that were in it before: the same weight, more inertia."""
    share = ask.size * INERTIA_SHARE
    ix, iy, iz = facts.BODY.inertia_kg_m2[:3]
    squares = share * np.array([iy + iz - ix, ix + iz - iy, ix + iy - iz]) / 2.0
    arms = np.sqrt(squares / (2.0 * DUMBBELL_KG))

    def edit(spec: mujoco.MjSpec) -> None:
        spec.body("body").mass -= 6.0 * DUMBBELL_KG
        for axis in range(3):
            for side in (-1.0, 1.0):
                place = np.array(facts.BODY.com_m)
                place[axis] += side * arms[axis]
                add_mass(spec, "body", f"dumbbell{axis}{side:+.0f}", DUMBBELL_KG, place, np.full(3, 1e-5))

    return Built(
        lambda robot: robot.spec_edits.append(edit) if share > 0.0 else None, {"body_inertia.scale": 1.0 + share}
    )


def boots(ask: Ask) -> Built:
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

    return Built(lambda robot: robot.spec_edits.append(edit) if share > 0.0 else None, {"leg_mass.scale": 1.0 + share})


def worn_feet(ask: Ask) -> Built:
    """Rubber that is worn off, or a thicker sole."""
    change = ask.size * WEAR_M * (-1.0 if ask.rng.random() < 0.7 else sign(ask.rng))

    def install(robot: Robot) -> None:
        robot.foot_radius_m = robot.foot_radius_m + np.where(leg_mask(ask.joints), change, 0.0)

    return Built(install, {"foot_radius.change_m": change})


def add_mass(
    spec: mujoco.MjSpec, link: str, name: str, mass_kg: float, place_m: np.ndarray, inertia_kg_m2: np.ndarray
) -> mujoco.MjsBody:
    """Fix a body of its own to a link."""
    return spec.body(link).add_body(
        name=name, pos=place_m, ipos=np.zeros(3), mass=mass_kg, inertia=inertia_kg_m2, explicitinertial=True
    )
