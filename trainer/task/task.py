"""The walking task, written once over any back end: observe, reward, end, start again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch

from spot_model.policy.observation import N_OBSERVATION, OBSERVATION_LAYOUT, build_observation
from spot_model.robot import facts
from trainer.backends.backend import Backend, PlantState
from trainer.backends.random_draws import Draws
from trainer.config.task_config import TaskConfig
from trainer.task.episode_stats import EpisodeStats
from trainer.task.feet import FootTimers
from trainer.task.ground import Ground
from trainer.task.initial_state import draw_initial_state
from trainer.task.kinematics import FootMotion, foot_motion
from trainer.task.observation_noise import noise_sigmas
from trainer.task.reward_terms import reward_term
from trainer.task.rewards import Moment
from trainer.task.velocity_commands import VelocityCommands

Tensor = torch.Tensor

PERIOD_S = 1.0 / facts.POLICY_RATE_HZ


@dataclass(frozen=True)
class StepResult:
    """What one policy period gave."""

    observation: Tensor
    """With noise, shape (n, 48)."""
    clean_observation: Tensor
    """Without noise, shape (n, 48)."""
    reward: Tensor
    """Shape (n,)."""
    done: Tensor
    """Bool, shape (n,)."""
    timed_out: Tensor
    """Bool, shape (n,): ended without having failed."""


class Task:
    """n walking robots. All tensors stay on the back end's device, and no step waits for the device."""

    def __init__(self, config: TaskConfig, backend: Backend, generator: torch.Generator) -> None:
        self.config = config
        self.backend = backend
        n, device = backend.n_envs, backend.device
        self.n_envs, self.device = n, device
        self.generator = generator
        self._draws = Draws(generator)
        self.commands = VelocityCommands(config.commands, n, self._draws)
        first = {**dict.fromkeys(config.late_rewards.weights, 0.0), **config.rewards.by_name()}
        self._terms = [reward_term(name) for name in first]
        self.stats = EpisodeStats(first, n, device)
        self.feet = FootTimers(n, device, config.reward_shape.duty_window_s)
        self._ground = Ground(config.terrain, device)
        self._default = torch.tensor(facts.DEFAULT_POSITION_RAD, device=device, dtype=torch.float32)
        self._sigmas = torch.from_numpy(noise_sigmas(config.noise)).to(device)
        self._first_weights, self._late_weights = (
            PERIOD_S * torch.tensor([weights[name] for name in self.stats.terms], device=device)
            for weights in (first, {**first, **config.late_rewards.weights})
        )
        self._weights = self._first_weights.clone()
        self.max_steps = round(config.episode_s / PERIOD_S)
        # Which robots have what friction and mass is drawn, so the first ones are as good as any.
        self._last_step = torch.full((n,), self.max_steps, device=device)
        self._last_step[: round(config.short_episode_share * n)] = round(config.short_episode_s / PERIOD_S)
        self.episode_steps = torch.zeros(n, dtype=torch.long, device=device)
        self._action = torch.zeros(n, facts.N_JOINTS, device=device)
        self._joint_velocity = torch.zeros(n, facts.N_JOINTS, device=device)
        self._foot_descent_m_s = torch.zeros(n, 4, device=device)
        self._push_in_s = self._draws.uniform(config.randomisation.push_interval_s, n)

    def advance_schedule(self, iteration: int) -> None:
        """Set the command ranges and the reward weights that this iteration uses."""
        self.commands.advance_curriculum(iteration)
        share = self.config.late_rewards.share(iteration)
        torch.lerp(self._first_weights, self._late_weights, share, out=self._weights)

    def start(self) -> StepResult:
        """Reset every robot and observe."""
        everyone = torch.ones(self.n_envs, dtype=torch.bool, device=self.device)
        self._reset(everyone)
        self.commands.update(everyone, 0.0)
        return self._observed(self.backend.read(), torch.zeros(self.n_envs, device=self.device), ~everyone, ~everyone)

    def step(self, action: Tensor) -> StepResult:
        """Hold the action's set-points for one period, reward it, and restart the robots that ended.

        Args:
            action: The network's output, shape (n, 12).
        """
        self.backend.step(self._default + facts.ACTION_SCALE_RAD * action)
        state = self.backend.read()
        self.episode_steps += 1
        feet = foot_motion(state)
        touched_down = self.feet.update(state.foot_contact, PERIOD_S, state.foot_duty)
        moment = self._moment(state, feet, touched_down, action)
        by_term = self._weighted_rewards(moment)
        fell = state.body_contact
        timed_out = ((self.episode_steps >= self._last_step) | self._ground.is_outside(state.body_position_m)) & ~fell
        done = fell | timed_out
        reward = by_term.sum(dim=-1)
        self.stats.add(by_term, done, fell)
        self._action.copy_(action)
        self._joint_velocity.copy_(state.velocity_rad_s)
        self._foot_descent_m_s.copy_(-feet.velocity_in_world_m_s[..., 2])
        self._reset(done)
        self.commands.update(done, PERIOD_S)
        self._push()
        return self._observed(self.backend.read(), reward, done, timed_out)

    def _moment(self, state: PlantState, feet: FootMotion, touched_down: Tensor, action: Tensor) -> Moment:
        seen, shape = self._observe(state), self.config.reward_shape
        command = seen["velocity_command"]
        linear_vel = seen["linear_vel_of_body_in_body_m_s"]
        commanded = command.norm(dim=-1) > shape.standing_command_below
        foot_xy = feet.position_in_world_m[..., :2]
        return Moment(
            command=command,
            linear_vel_m_s=linear_vel,
            angular_vel_rad_s=seen["angular_vel_of_body_in_body_rad_s"],
            gravity=seen["projected_gravity_in_body"],
            position_offset_rad=seen["joint_position_offset_rad"],
            velocity_rad_s=state.velocity_rad_s,
            acceleration_rad_s2=(state.velocity_rad_s - self._joint_velocity) / PERIOD_S,
            torque_nm=state.torque_nm,
            action=action,
            last_action=self._action,
            foot_height_m=feet.position_in_world_m[..., 2] - self._ground.height_m(foot_xy),
            foot_velocity_m_s=feet.velocity_in_world_m_s,
            foot_xy_m=foot_xy,
            contact=state.foot_contact,
            support=self.feet.support,
            air_time_s=self.feet.air_time_s,
            contact_time_s=self.feet.contact_time_s,
            last_air_time_s=self.feet.last_air_time_s,
            last_contact_time_s=self.feet.last_contact_time_s,
            touched_down=touched_down,
            touchdown_speed_m_s=self._foot_descent_m_s.clamp(min=0.0) * touched_down,
            duty=self.feet.duty,
            fell=state.body_contact,
            is_moving=commanded | (linear_vel[:, :2].norm(dim=-1) > shape.moving_above_m_s),
        )

    def _weighted_rewards(self, moment: Moment) -> Tensor:
        """Each term times its weight and the period, shape (n, terms), in the order of the config's fields."""
        shape = self.config.reward_shape
        values = torch.stack([term(moment, shape) for term in self._terms], dim=-1)
        return values * self._weights

    def _reset(self, mask: Tensor) -> None:
        config = self.config
        initial = draw_initial_state(config.randomisation, config.terrain, self.n_envs, self._draws)
        self.backend.reset(mask, initial)
        self.feet.reset(mask)
        self.episode_steps.masked_fill_(mask, 0)
        self._action.masked_fill_(mask[:, None], 0.0)
        self._foot_descent_m_s.masked_fill_(mask[:, None], 0.0)
        self._joint_velocity.copy_(torch.where(mask[:, None], initial.velocity_rad_s, self._joint_velocity))

    def _push(self) -> None:
        c, n = self.config.randomisation, self.n_envs
        self._push_in_s -= PERIOD_S
        due = self._push_in_s <= 0.0
        delta = torch.zeros(n, 3, device=self.device)
        delta[:, :2] = self._draws.uniform(c.push_m_s, n, 2) * due[:, None]
        self.backend.add_velocity(delta)
        self._push_in_s.copy_(torch.where(due, self._draws.uniform(c.push_interval_s, n), self._push_in_s))

    def _observation(self, state: PlantState) -> Tensor:
        observation: Tensor = build_observation(
            world_from_body_wxyz=state.world_from_body_wxyz,
            linear_vel_of_body_in_world_m_s=state.linear_vel_of_body_in_world_m_s,
            angular_vel_of_body_in_world_rad_s=state.angular_vel_of_body_in_world_rad_s,
            velocity_command=self.commands.command,
            position_rad=state.position_rad,
            velocity_rad_s=state.velocity_rad_s,
            last_action=self._action,
            default_position_rad=self._default,
        )
        return observation

    def _observe(self, state: PlantState) -> dict[str, Tensor]:
        """The blocks of the observation by name."""
        blocks = torch.split(self._observation(state), [size for _, size in OBSERVATION_LAYOUT], dim=-1)
        return {name: block for (name, _), block in zip(OBSERVATION_LAYOUT, blocks, strict=True)}

    def _observed(self, state: PlantState, reward: Tensor, done: Tensor, timed_out: Tensor) -> StepResult:
        clean = self._observation(state)
        reported = self.backend.read_reported(state)
        noisy = (clean if reported is state else self._observation(reported)) + self._sigmas * self._draws.normal(
            self.n_envs, N_OBSERVATION
        )
        return StepResult(noisy, clean, reward, done, timed_out)

    def snapshot(self) -> dict[str, Any]:
        """All that :meth:`restore` needs to continue exactly, apart from the observation last returned."""
        return {
            "backend": self.backend.snapshot(),
            "commands": self.commands.snapshot(),
            "feet": {name: getattr(self.feet, name).clone() for name in FootTimers.NAMES},
            "buffers": {name: buffer.clone() for name, buffer in self._buffers().items()},
            "generator": self.generator.get_state(),
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from a snapshot of a task of the same config and size."""
        self.backend.restore(snapshot["backend"])
        self.commands.restore(snapshot["commands"])
        for name in FootTimers.NAMES:
            getattr(self.feet, name).copy_(snapshot["feet"][name])
        for name, buffer in self._buffers().items():
            buffer.copy_(snapshot["buffers"][name])
        self.generator.set_state(snapshot["generator"].cpu())

    def _buffers(self) -> dict[str, Tensor]:
        return {
            "episode_steps": self.episode_steps,
            "action": self._action,
            "joint_velocity": self._joint_velocity,
            "foot_descent_m_s": self._foot_descent_m_s,
            "push_in_s": self._push_in_s,
            "stats_running": self.stats.running,
            "stats_length": self.stats.length,
        }
