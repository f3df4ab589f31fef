"""Masses that no model knows: bodies of their own, fixed to the robot."""

from __future__ import annotations

import mujoco
import numpy as np

from withheld.realities.fault_kind import Ask, Built
from withheld.realities.robot import Robot

PAYLOAD_KG = 12.0
PAYLOAD_HALF_M = (0.14, 0.09, 0.06)


def payload(ask: Ask) -> Built:
    """A box on the back, as a body of its own with its own inertia."""
    mass = ask.size * PAYLOAD_KG
    place = (
        float(ask.rng.uniform(-0.15, 0.15)),
        float(ask.rng.uniform(-0.03, 0.03)),
        float(ask.rng.uniform(0.09, 0.18)),
    )

    def edit(spec: mujoco.MjSpec) -> None:
        x, y, z = PAYLOAD_HALF_M
        squares = np.array([y * y + z * z, x * x + z * z, x * x + y * y])
        spec.body("body").add_body(
            name="payload", pos=place, mass=mass, inertia=mass / 3.0 * squares, explicitinertial=True
        )

    def install(robot: Robot) -> None:
        if mass > 0.0:
            robot.spec_edits.append(edit)

    return Built(install, {
        "payload_mass.mass_kg": mass, "payload_mass.x_m": place[0], "payload_mass.y_m": place[1],
        "payload_mass.z_m": place[2],
    })  # fmt: skip
