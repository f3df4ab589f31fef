"""What differs from robot to robot: surroundings (ground, estimator, link, battery), and ordinary errors of everything.

A case draws one scale for all ordinary errors. At scale 1 gains differ by 0.8 %, link masses by 1.2 %, encoder zeros by
1 mrad. Each purpose has a generator of its own, so that a fault more or less moves no other draw.
"""

from __future__ import annotations

import zlib
from typing import Final

import mujoco
import numpy as np

from spot_model.robot.facts import JOINT_NAMES, LEG_NAMES, N_JOINTS, N_LEGS, Array
from withheld.simulator.body import LINK_NAMES
from withheld.simulator.parameters import Settings
from withheld.simulator.robot import Robot


def stream(seed: int, *purpose: object) -> np.random.Generator:
    """The generator of a seed and a purpose."""
    words = [zlib.crc32(repr(part).encode()) for part in purpose]
    return np.random.default_rng(np.random.SeedSequence([seed, *words]))


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


LOAD_CELL_LAG_S = (1e-5, 6e-3)
GROUND_FRICTION = (0.6, 1.0)
ODOMETRY_TIME_S = (0.03, 0.09)
TILT_RATE_PER_S = (0.015, 0.06)
ESTIMATE_LAG_S = (0.0, 6e-3)
NOISE_SCALES = (0.5, 2.0)
SLIPPED_SHARES = {"timer": 0.005, "divider": 0.016}


def draw_settings(rng: np.random.Generator) -> Settings:
    """How this robot is integrated, and how its ground answers."""
    return Settings(
        steps_per_state=int(rng.integers(5, 8)),
        integrator=str(rng.choice(("implicit", "implicitfast"))),
        impratio=float(rng.uniform(1.0, 4.0)),
        contact_stiffness_per_s2=5200.0 * float(np.exp(rng.uniform(-0.5, 0.5))),
        contact_damping_per_s=148.0 * float(np.exp(rng.uniform(-0.25, 0.25))),
    )


def add_surroundings(robot: Robot, rng: np.random.Generator) -> None:
    """Draw the robot's ground, estimator, sensors, link, battery and temperatures."""
    robot.foot_friction = np.full_like(robot.foot_friction, rng.uniform(*GROUND_FRICTION))
    s = robot.sensing
    s.load_filter_s = float(rng.uniform(*LOAD_CELL_LAG_S))
    for name in ("position_noise_rad", "velocity_noise_rad_s", "load_noise_nm"):
        setattr(s, name, getattr(s, name) * _log_uniform(rng, *NOISE_SCALES))
    s.contact_on_n = float(rng.uniform(14.0, 32.0))
    s.contact_off_n = 0.65 * s.contact_on_n
    e = robot.estimator
    e.odometry_time_s = _log_uniform(rng, *ODOMETRY_TIME_S)
    e.tilt_rate_per_s = _log_uniform(rng, *TILT_RATE_PER_S)
    e.output_lag_s = float(rng.uniform(*ESTIMATE_LAG_S))
    link = robot.link
    link.schedule = "divider" if rng.random() < 0.4 else "timer"
    link.slipped_share = SLIPPED_SHARES[link.schedule]
    link.up_floor_s *= float(rng.uniform(0.8, 1.2))
    link.down_floor_s *= float(rng.uniform(0.8, 1.2))
    link.down_scale_s *= float(np.exp(rng.normal(0.0, 0.15)))
    robot.supply.charge = float(rng.uniform(0.6, 0.95))
    robot.thermal.start_c = robot.thermal.start_c + rng.uniform(-4.0, 8.0, N_JOINTS)


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
