"""Closed-loop runs of a model file: what a delivered model would train and identify in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from spot_model.effects.base import CommandEffect, SoftwareEffect
from spot_model.io.model_file import RobotModel
from spot_model.plant.plant import Plant, PlantOptions, ServoCommand
from spot_model.policy.observation import build_observation
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.mjcf import MjcfOptions, default_height_m
from spot_model.robot.rotation import rotate_wxyz
from withheld.features import Features, features_of_ticks

STEP_S: Final = 1.5e-3
TICK_STEPS: Final = (14, 14, 12)
"""Physics steps between ticks at 50 Hz on a 3 ms stream."""
STAND_S: Final = 1.0
"""From the stand to the policy, as the realities do it."""


@dataclass(frozen=True)
class Script:
    """One run to make."""

    velocity_command: Array
    """One a tick, shape (n_ticks, 3); all scripts of a batch have one length."""


def simulate(model: RobotModel, policy: Policy, scripts: Sequence[Script], rng: np.random.Generator) -> list[Features]:
    """Run all scripts in one batch from a stand.

    Args:
        model: Its effects act in the plant, in the program and on the command's way.
        policy: In the loop.
        scripts: At least one.
        rng: Draws sensors and delays.

    Raises:
        BadInputError: The model cannot be simulated.
    """
    return _Loop(model, policy, len(scripts), rng).run(np.stack([s.velocity_command for s in scripts]))


class _Loop:
    def __init__(self, model: RobotModel, policy: Policy, n: int, rng: np.random.Generator) -> None:
        self.policy, self.n, self.rng = policy, n, rng
        self.link = [e for e in model.effects if isinstance(e, CommandEffect)]
        self.program = [e for e in model.effects if isinstance(e, SoftwareEffect)]
        own = [e for e in model.effects if not isinstance(e, (CommandEffect, SoftwareEffect))]
        mjcf = MjcfOptions(timestep_s=STEP_S, cone="elliptic", collision="all", visuals=False)
        self.plant = Plant(own, n, PlantOptions(mjcf=mjcf, n_threads=1, on_divergence="flag"))
        self.held = np.tile(facts.DEFAULT_POSITION_RAD, (n, 1))
        pose = self.held + rng.normal(0.0, 0.015, (n, facts.N_JOINTS))
        upright = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
        place = np.tile([0.0, 0.0, default_height_m()], (n, 1))
        zero, still = np.zeros((n, 3)), np.zeros((n, facts.N_JOINTS))
        self.plant.reset(
            position_of_body_in_world_m=place,
            world_from_body_wxyz=upright,
            joint_position_rad=pose,
            linear_vel_of_body_in_world_m_s=zero,
            angular_vel_of_body_in_body_rad_s=zero,
            joint_velocity_rad_s=still,
        )
        self.setpoint = self.held
        self.waiting: list[tuple[Array, Array]] = []
        self.latest_s = np.full(n, -np.inf)
        self.now_s = 0.0
        self.action = np.zeros((n, facts.N_JOINTS), dtype=np.float32)

    def run(self, command: Array) -> list[Features]:
        """Stand, blend in the policy, then follow the commands, shape (n, n_ticks, 3)."""
        n_stand = round(STAND_S * facts.POLICY_RATE_HZ)
        zero = np.zeros((self.n, 3))
        observed, acted = [], []
        for tick in range(2 * n_stand + command.shape[1]):
            share = min(1.0, max(0.0, tick / n_stand - 1.0))
            observation = self._tick(zero if tick < 2 * n_stand else command[:, tick - 2 * n_stand], share)
            if tick >= 2 * n_stand:
                observed.append(observation)
                acted.append(self.action)
            self._advance(TICK_STEPS[tick % 3])
        o, a = np.stack(observed, axis=1), np.stack(acted, axis=1)
        is_active = np.ones(o.shape[1], dtype=np.bool_)
        return [features_of_ticks(o[i], a[i], is_active, self.policy) for i in range(self.n)]

    def _tick(self, command: Array, share: float) -> NDArray[np.float32]:
        reading, estimate, order = self.plant.reading, self.plant.estimate, self.policy.policy_from_canonical
        attitude = estimate.world_from_body_wxyz
        observation: NDArray[np.float32] = np.nan_to_num(
            build_observation(
                world_from_body_wxyz=attitude,
                linear_vel_of_body_in_world_m_s=rotate_wxyz(attitude, estimate.linear_vel_of_body_in_body_m_s),
                angular_vel_of_body_in_world_rad_s=rotate_wxyz(attitude, estimate.angular_vel_of_body_in_body_rad_s),
                velocity_command=command,
                position_rad=reading.position_rad[:, order],
                velocity_rad_s=reading.velocity_rad_s[:, order],
                last_action=self.action,
                default_position_rad=self.policy.default_position_rad,
            )
        ).astype(np.float32)
        self.action = np.concatenate([self.policy.act(row[None]) for row in observation])
        sent = np.asarray(self.policy.setpoint_rad(self.action))
        for change in self.program:
            sent = change.setpoint_rad(sent)
        blend = share * share * (3.0 - 2.0 * share)
        sent = np.clip(self.held + blend * (sent - self.held), facts.POSITION_LOW_RAD, facts.POSITION_HIGH_RAD)
        arrival = np.full(self.n, self.now_s)
        for way in self.link:
            arrival = np.broadcast_to(way.arrival_s(arrival, self.rng), (self.n,))
        arrival = np.maximum(arrival, self.latest_s)
        self.latest_s = np.where(np.isfinite(arrival), arrival, self.latest_s)
        self.waiting.append((arrival, sent))
        return observation

    def _advance(self, n_steps: int) -> None:
        gains = self.policy.gains()
        for _ in range(n_steps):
            self.now_s += STEP_S
            mean, kept = self.setpoint, []
            for arrival, sent in self.waiting:
                # A set-point that arrives within a step counts for the rest of that step.
                share = np.clip((self.now_s - arrival) / STEP_S, 0.0, 1.0)[:, None]
                mean = mean + share * (sent - mean)
                self.setpoint = np.where(share > 0.0, sent, self.setpoint)
                if np.any(np.isfinite(arrival) & (arrival > self.now_s - STEP_S)):
                    kept.append((arrival, sent))
            self.waiting = kept
            self.plant.command(ServoCommand(mean, gains.kp_nm_per_rad, gains.kd_nm_s_per_rad))
            self.plant.advance()
