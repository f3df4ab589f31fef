"""The compiled MuJoCo model of one robot: its body, feet and contacts, then its faults and ordinary errors."""

from __future__ import annotations

import mujoco
import numpy as np

from spot_model.robot.facts import FOOT_RADIUS_M, LEG_NAMES, N_JOINTS
from spot_model.robot.mjcf import default_height_m
from withheld.simulator.mechanics.mjcf import robot_mjcf
from withheld.simulator.robot import Robot
from withheld.simulator.settings import Settings

FOOT_WIDTH = 1.12
"""Half of a foot's width over the nominal radius: a little wider than long, and wear takes none of it."""
_INTEGRATORS = {
    "implicit": mujoco.mjtIntegrator.mjINT_IMPLICIT,
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
}


def build_model(robot: Robot, settings: Settings) -> mujoco.MjModel:
    """The compiled body. Its twelve joints follow the free joint, whatever a fault adds comes after them."""
    spec = mujoco.MjSpec.from_string(robot_mjcf(default_height_m()))
    spec.option.timestep = settings.step_s
    spec.option.integrator = _INTEGRATORS[settings.integrator]
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = settings.impratio
    for i, leg in enumerate(LEG_NAMES):
        foot = spec.geom(f"{leg}_foot")
        radius = robot.foot_radius_m[i]
        foot.size = [radius, FOOT_WIDTH * FOOT_RADIUS_M, radius]
        foot.friction[0] = robot.foot_friction[i]
        scale, damping = robot.foot_softness[i], robot.foot_damping[i]
        foot.solref = [
            -settings.contact_stiffness_per_s2 / scale**2,
            -settings.contact_damping_per_s * damping / scale,
        ]
    for edit_spec in robot.spec_edits:
        edit_spec(spec)
    model = spec.compile()
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    for edit_model in robot.model_edits:
        edit_model(model)
    # The rotor of a rigid gear is part of its joint; that of an elastic one is simulated by the drive.
    model.dof_armature[6 : 6 + N_JOINTS] = np.where(robot.drive.is_elastic, 0.0, robot.drive.rotor_inertia_kg_m2)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model
