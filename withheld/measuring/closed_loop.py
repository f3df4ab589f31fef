"""Closed-loop runs of a model file: what a delivered model would train and identify in."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from spot_model.io.model_file import RobotModel
from spot_model.plant.plant import Plant, PlantOptions, ServoCommand
from spot_model.policy.observation import build_observation
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.mjcf import MjcfOptions
from spot_model.robot.rotation import rotate_wxyz
from withheld.features import Features, features_of_ticks

STEP_S: Final = 1e-3
STAND_TICKS: Final = 50
"""About a second of standing, and as many again in which the policy takes over, as in the realities."""
POSE_SPREAD_RAD: Final = 0.015


def simulate(
    model: RobotModel, policy: Policy, command: Array, tick_steps: int, n_runs: int, rng: np.random.Generator
) -> list[Features]:
    """Run one command several times from slightly different stands.

    Args:
        model: All of its effects act.
        policy: In the loop.
        command: Velocity command of each tick, shape (n_ticks, 3).
        tick_steps: Milliseconds between two ticks.
        n_runs: How often.
        rng: Draws the stands.

    Raises:
        BadInputError: The model cannot be simulated.
    """
    mjcf = MjcfOptions(timestep_s=STEP_S, cone="elliptic", collision="all", visuals=False)
    plant = Plant(list(model.effects), n_runs, PlantOptions(mjcf=mjcf, n_threads=1, on_divergence="flag"))
    held = np.tile(facts.DEFAULT_POSITION_RAD, (n_runs, 1))
    plant.reset(joint_position_rad=held + rng.normal(0.0, POSE_SPREAD_RAD, held.shape))
    gains, action = policy.gains(), np.zeros(held.shape, dtype=np.float32)
    observed, acted = [], []
    for tick in range(-2 * STAND_TICKS, len(command)):
        observation = _observe(plant, policy, command[tick] if tick >= 0 else np.zeros(3), action)
        action = np.concatenate([policy.act(row[None]) for row in observation])
        share = float(np.clip(1.0 + tick / STAND_TICKS, 0.0, 1.0))
        blend = share * share * (3.0 - 2.0 * share)
        plant.command(
            ServoCommand(
                position_rad=held + blend * (policy.setpoint_rad(action) - held),
                kp_nm_per_rad=gains.kp_nm_per_rad,
                kd_nm_s_per_rad=gains.kd_nm_s_per_rad,
            )
        )
        plant.advance(tick_steps)
        if tick >= 0:
            observed.append(observation)
            acted.append(action)
    o, a = np.stack(observed, axis=1), np.stack(acted, axis=1)
    return [features_of_ticks(o[i], a[i], np.ones(len(command), dtype=np.bool_), policy) for i in range(n_runs)]


def _observe(plant: Plant, policy: Policy, command: Array, last_action: NDArray[np.float32]) -> NDArray[np.float32]:
    reading, estimate, order = plant.reading, plant.estimate, policy.policy_from_canonical
    attitude = estimate.world_from_body_wxyz
    seen: NDArray[np.float32] = np.nan_to_num(
        build_observation(
            world_from_body_wxyz=attitude,
            linear_vel_of_body_in_world_m_s=rotate_wxyz(attitude, estimate.linear_vel_of_body_in_body_m_s),
            angular_vel_of_body_in_world_rad_s=rotate_wxyz(attitude, estimate.angular_vel_of_body_in_body_rad_s),
            velocity_command=np.tile(command, (len(last_action), 1)),
            position_rad=reading.position_rad[:, order],
            velocity_rad_s=reading.velocity_rad_s[:, order],
            last_action=last_action,
            default_position_rad=policy.default_position_rad,
        )
    ).astype(np.float32)
    return seen
