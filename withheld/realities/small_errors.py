"""What no model has right: every robot is off by a few per cent everywhere, whatever else is wrong with it."""

from __future__ import annotations

import mujoco
import numpy as np

from spot_model.robot.facts import JOINT_NAMES, LEG_NAMES, N_JOINTS, N_LEGS, Array
from withheld.realities.robot import Robot

LINKS = ("hip", "uleg", "lleg")


def add_small_errors(robot: Robot, rng: np.random.Generator) -> None:
    """Draw them all; the same generator gives the same robot."""
    _body(robot, rng)
    d = robot.drive
    for name, share in (
        ("kp_scale", 0.008), ("kd_scale", 0.01), ("rotor_inertia_kg_m2", 0.03), ("gear_stiffness_nm_per_rad", 0.04),
        ("gear_damping_nm_s_per_rad", 0.05), ("torque_constant", 0.008), ("coulomb_nm", 0.05),
        ("current_high_nm", 0.02), ("current_low_nm", 0.02), ("no_load_high_rad_s", 0.015),
        ("no_load_low_rad_s", 0.015), ("copper_w_per_nm2", 0.05),
    ):  # fmt: skip
        setattr(d, name, getattr(d, name) * _about_one(rng, share, N_JOINTS))
    d.coulomb_nm = d.coulomb_nm + rng.uniform(0.0, 0.02, N_JOINTS)
    d.viscous_nm_s_per_rad = rng.uniform(0.0, 0.003, N_JOINTS)
    s = robot.sensing
    s.offset_rad = rng.normal(0.0, 1e-3, N_JOINTS)
    s.eccentricity_rad = rng.uniform(0.0, 4e-4, N_JOINTS)
    s.eccentricity_phase_rad = rng.uniform(-np.pi, np.pi, N_JOINTS)
    s.load_gain = _about_one(rng, 0.005, N_JOINTS)
    s.load_bias_nm = rng.normal(0.0, 0.06, N_JOINTS)
    s.gyro_bias_rad_s = rng.normal(0.0, 1e-4, 3)
    s.acceleration_bias_m_s2 = rng.normal(0.0, 0.015, 3)
    s.imu_tilt_rpy_rad = rng.normal(0.0, 1.5e-3, 3)
    e = robot.estimator
    e.odometry_scale = float(1.0 + np.clip(rng.normal(0.0, 0.006), -0.012, 0.012))
    e.odometry_bias_m_s = rng.normal(0.0, 0.003, 2)
    robot.foot_radius_m = robot.foot_radius_m + rng.normal(0.0, 3e-4, N_LEGS)
    robot.foot_friction = robot.foot_friction * _about_one(rng, 0.03, N_LEGS)
    robot.foot_softness = robot.foot_softness * _about_one(rng, 0.03, N_LEGS)
    supply = robot.supply
    supply.charge = float(rng.uniform(0.6, 0.95))
    supply.resistance_ohm *= float(_about_one(rng, 0.1, 1)[0])
    supply.idle_w *= float(_about_one(rng, 0.05, 1)[0])
    robot.thermal.start_c = robot.thermal.start_c + rng.uniform(-4.0, 8.0, N_JOINTS)


def _body(robot: Robot, rng: np.random.Generator) -> None:
    """Masses and inertias by one or two per cent, frames by half a millimetre, axes by a milliradian."""
    links = [f"{leg}_{link}" for leg in LEG_NAMES for link in LINKS]
    scale = _about_one(rng, 0.012, len(links) + 1)
    shape = _about_one(rng, 0.015, 3 * (len(links) + 1)).reshape(-1, 3)
    com = rng.normal(0.0, 4e-4, (len(links) + 1, 3))
    frame = rng.normal(0.0, 4e-4, (len(links), 3))
    axis = rng.normal(0.0, 1.2e-3, (N_JOINTS, 3))
    # The body's weight is known best.
    scale[0] = 1.0 + 0.5 * (scale[0] - 1.0)

    def edit(model: mujoco.MjModel) -> None:
        for i, name in enumerate(["body", *links]):
            body = model.body(name).id
            model.body_mass[body] *= scale[i]
            model.body_inertia[body] *= scale[i] * shape[i]
            model.body_ipos[body] += com[i]
            if i:
                model.body_pos[body] += frame[i - 1]
        for i, name in enumerate(JOINT_NAMES):
            joint = model.joint(name).id
            turned = model.jnt_axis[joint] + axis[i]
            model.jnt_axis[joint] = turned / np.linalg.norm(turned)

    robot.model_edits.insert(0, edit)


def _about_one(rng: np.random.Generator, share: float, n: int) -> Array:
    """Factors around 1, never further off than two and a half standard deviations."""
    return np.asarray(1.0 + share * np.clip(rng.standard_normal(n), -2.5, 2.5))
