"""Closed-loop runs of a model file: what a delivered model would train and identify in."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from spot_model.io.model_file import RobotModel
from spot_model.plant.closed_loop import ClosedLoop
from spot_model.plant.plant import Plant, PlantOptions, ServoCommand
from spot_model.policy.observation import Sensed
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.mjcf import MjcfOptions
from spot_model.robot.rotation import rotate_wxyz
from spot_model.robot.state import Gains
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
    told = np.concatenate([np.zeros((2 * STAND_TICKS, 3)), command])
    loop = ClosedLoop(
        plant,
        policy,
        path=_FromStand(plant, policy.gains(), held),
        sense=lambda _: _reported(plant),
        act=lambda seen: _act(policy, seen),
    )
    ticks = list(loop.run(lambda tick: told[tick], [(tick_steps,)] * len(told)))[2 * STAND_TICKS :]
    observed, acted = (np.stack([getattr(t, name) for t in ticks], axis=1) for name in ("observation", "action"))
    is_active = np.ones(len(command), dtype=np.bool_)
    return [features_of_ticks(o.astype(np.float32), a, is_active, policy) for o, a in zip(observed, acted, strict=True)]


class _FromStand:
    """The plant's own channel, behind a stand as the realities have it: stiff first, then a blend to the policy's.

    A stand at the policy's gains alone gives way, and the policy starts by marching where the robot stood still.
    """

    def __init__(self, plant: Plant, gains: Gains, held_rad: Array) -> None:
        self._plant, self._gains, self._held = plant, gains, held_rad

    def send(self, number: int, setpoint_rad: Array) -> None:
        """Blend by the number of the command, which counts from 1."""
        softened = min(1.0, 1.5 * (number - 1) / STAND_TICKS)
        kp = (1.0 - softened) * 0.5 * facts.STAND_KP_NM_PER_RAD + softened * self._gains.kp_nm_per_rad
        kd = (1.0 - softened) * facts.STAND_KD_NM_S_PER_RAD + softened * self._gains.kd_nm_s_per_rad
        share = float(np.clip((number - 1) / STAND_TICKS - 1.0, 0.0, 1.0))
        blend = share * share * (3.0 - 2.0 * share)
        position = self._held + blend * (setpoint_rad - self._held)
        self._plant.command(ServoCommand(position_rad=position, kp_nm_per_rad=kp, kd_nm_s_per_rad=kd))

    def step(self) -> None:
        """One physics step."""
        self._plant.advance()


def _reported(plant: Plant) -> Sensed:
    """What the model's sensors and estimator report, numbers alone."""
    reading, estimate = plant.reading, plant.estimate
    attitude = estimate.world_from_body_wxyz
    return Sensed(
        *(
            np.nan_to_num(np.asarray(value))
            for value in (
                reading.position_rad,
                reading.velocity_rad_s,
                attitude,
                rotate_wxyz(attitude, estimate.linear_vel_of_body_in_body_m_s),
                rotate_wxyz(attitude, estimate.angular_vel_of_body_in_body_rad_s),
            )
        )
    )


def _act(policy: Policy, observation: NDArray[np.float32]) -> NDArray[np.float32]:
    """Row by row: a policy file may take one at a time."""
    return np.concatenate([policy.act(row[None].astype(np.float32)) for row in observation])
