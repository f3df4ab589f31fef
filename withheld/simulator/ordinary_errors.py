"""What no model has right: every robot is off by some per cent everywhere, whatever else is wrong with it.

A case draws one scale for all of them. At scale 1 gains differ by 0.8 %, link masses by 1.2 %, encoder zeros by 1 mrad.
"""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np

from spot_model.robot.facts import JOINT_NAMES, LEG_NAMES, N_JOINTS, N_LEGS, Array
from withheld.simulator.mechanics.mjcf import LINK_NAMES
from withheld.simulator.robot import Robot

SCALES: Final = (0.5, 5.0)
"""Bounds of a case's scale."""
DRIVE_SHARES: Final = {
    "kp_scale": 0.008,
    "kd_scale": 0.01,
    "rotor_inertia_kg_m2": 0.03,
    "gear_stiffness_nm_per_rad": 0.04,
    "gear_damping_nm_s_per_rad": 0.05,
    "torque_constant": 0.008,
    "coulomb_nm": 0.05,
    "current_high_nm": 0.02,
    "current_low_nm": 0.02,
    "no_load_high_rad_s": 0.015,
    "no_load_low_rad_s": 0.015,
    "copper_w_per_nm2": 0.05,
}
"""Relative standard deviation of each joint's parameters at scale 1."""


def draw_scale(rng: np.random.Generator) -> float:
    """A case's scale, log-uniform within :data:`SCALES`."""
    return float(np.exp(rng.uniform(*np.log(SCALES))))


def add_ordinary_errors(robot: Robot, rng: np.random.Generator, scale: float) -> None:
    """Draw all of them; the same generator and scale give the same robot."""
    _body(robot, rng, scale)
    d = robot.drive
    for name, share in DRIVE_SHARES.items():
        setattr(d, name, getattr(d, name) * _factors(rng, scale * share, N_JOINTS))
    d.coulomb_nm = d.coulomb_nm + rng.uniform(0.0, 0.02 * scale, N_JOINTS)
    d.viscous_nm_s_per_rad = rng.uniform(0.0, 0.003 * scale, N_JOINTS)
    s = robot.sensing
    s.offset_rad = scale * rng.normal(0.0, 1e-3, N_JOINTS)
    s.eccentricity_rad = scale * rng.uniform(0.0, 4e-4, N_JOINTS)
    s.eccentricity_phase_rad = rng.uniform(-np.pi, np.pi, N_JOINTS)
    s.load_gain = _factors(rng, 0.005 * scale, N_JOINTS)
    s.load_bias_nm = scale * rng.normal(0.0, 0.06, N_JOINTS)
    s.gyro_bias_rad_s = scale * rng.normal(0.0, 1e-4, 3)
    s.acceleration_bias_m_s2 = scale * rng.normal(0.0, 0.015, 3)
    s.imu_tilt_rpy_rad = scale * rng.normal(0.0, 1.5e-3, 3)
    robot.estimator.odometry_scale = float(_factors(rng, 0.006 * scale, 1)[0])
    robot.estimator.odometry_bias_m_s = scale * rng.normal(0.0, 0.003, 2)
    robot.foot_radius_m = robot.foot_radius_m + scale * rng.normal(0.0, 3e-4, N_LEGS)
    robot.foot_friction = robot.foot_friction * _factors(rng, 0.03 * scale, N_LEGS)
    robot.foot_softness = robot.foot_softness * _factors(rng, 0.03 * scale, N_LEGS)
    robot.supply.resistance_ohm *= float(_factors(rng, 0.1 * scale, 1)[0])
    robot.supply.idle_w *= float(_factors(rng, 0.05 * scale, 1)[0])


def _body(robot: Robot, rng: np.random.Generator, scale: float) -> None:
    """Masses by 1.2 %, inertias by 1.5 %, centres and frames by 0.4 mm, axes by 1.2 mrad, all times the scale."""
    links = [f"{leg}_{link}" for leg in LEG_NAMES for link in LINK_NAMES]
    mass = _factors(rng, 0.012 * scale, len(links) + 1)
    shape = _factors(rng, 0.015 * scale, 3 * (len(links) + 1)).reshape(-1, 3)
    com = scale * rng.normal(0.0, 4e-4, (len(links) + 1, 3))
    frame = scale * rng.normal(0.0, 4e-4, (len(links), 3))
    axis = scale * rng.normal(0.0, 1.2e-3, (N_JOINTS, 3))
    # The body's weight is known best.
    mass[0] = np.sqrt(mass[0])

    def edit(model: mujoco.MjModel) -> None:
        for i, name in enumerate(["body", *links]):
            body = model.body(name).id
            model.body_mass[body] *= mass[i]
            model.body_inertia[body] *= mass[i] * shape[i]
            model.body_ipos[body] += com[i]
            if i:
                model.body_pos[body] += frame[i - 1]
        for i, name in enumerate(JOINT_NAMES):
            joint = model.joint(name).id
            turned = model.jnt_axis[joint] + axis[i]
            model.jnt_axis[joint] = turned / np.linalg.norm(turned)

    robot.model_edits.insert(0, edit)


def _factors(rng: np.random.Generator, share: float, n: int) -> Array:
    """Log-normal factors around 1, no further off than two and a half standard deviations."""
    return np.asarray(np.exp(share * np.clip(rng.standard_normal(n), -2.5, 2.5)))
