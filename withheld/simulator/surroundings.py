"""What differs between robots and places without being an error: ground, estimator, load cells, link, battery."""

from __future__ import annotations

import numpy as np

from spot_model.robot.facts import N_JOINTS
from withheld.simulator.robot import Robot
from withheld.simulator.settings import Settings

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
