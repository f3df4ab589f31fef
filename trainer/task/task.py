"""The walking task, written once over any device: observe, reward, end, start again."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

import torch
from torch import Tensor

from spot_model.io.model_file import RobotModel
from spot_model.policy.observation import N_OBSERVATION, OBSERVATION_LAYOUT, build_observation
from spot_model.robot import facts
from spot_model.robot.rotation import rotate_inverse_wxyz
from trainer.config.task_config import TaskConfig
from trainer.config.train_config import TrainConfig
from trainer.simulate.engine import check_device
from trainer.task.draws import Draws, VelocityCommands, draw_initial_state, draw_simulations, training_effects
from trainer.task.feet import FootMotion, FootTimers, Ground, motion_at_feet
from trainer.task.plant_backend import PlantBackend, TaskState
from trainer.task.rewards import Moment, reward_term


class EpisodeStats:
    """Reward sums by term, lengths and falls of episodes."""

    def __init__(self, terms: Iterable[str], n: int, device: torch.device | str) -> None:
        self.terms = tuple(terms)
        self.running = torch.zeros(n, len(self.terms), device=device)
        self.length = torch.zeros(n, device=device)
        self._finished_terms = torch.zeros(len(self.terms), device=device)
        self._counts = torch.zeros(3, device=device)

    def add(self, by_term: Tensor, done: Tensor, fell: Tensor) -> None:
        """Count one step: weighted rewards (n, terms), and which episodes ended, and by a fall (bool, (n,))."""
        self.running += by_term
        self.length += 1.0
        ended = done.float()
        self._finished_terms += ended @ self.running
        self._counts += torch.stack([ended.sum(), ended @ self.length, fell.float().sum()])
        self.running *= (1.0 - ended)[:, None]
        self.length *= 1.0 - ended

    def drain(self) -> dict[str, float]:
        """Means over the episodes that ended since the last call, then start afresh; empty if none ended."""
        episodes, length, falls = self._counts.tolist()
        terms = self._finished_terms.tolist()
        self._counts.zero_()
        self._finished_terms.zero_()
        if episodes == 0:
            return {}
        means = {f"reward/{name}": value / episodes for name, value in zip(self.terms, terms, strict=True)}
        return {
            "reward": sum(terms) / episodes,
            "episode_length": length / episodes,
            "fall_share": falls / episodes,
            "episodes": episodes,
            **means,
        }


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

    def __init__(self, config: TaskConfig, backend: PlantBackend, generator: torch.Generator) -> None:
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
        self._sigmas = torch.from_numpy(config.noise.sigmas()).to(device)
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
        feet = motion_at_feet(state)
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

    def _moment(self, state: TaskState, feet: FootMotion, touched_down: Tensor, action: Tensor) -> Moment:
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
            down=self.into_ground(state, seen["projected_gravity_in_body"]),
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

    def into_ground(self, state: TaskState, gravity: Tensor) -> Tensor:
        """Into the ground below each robot, in its body frame: gravity's direction where the ground is level."""
        if self._ground.is_level:
            return gravity
        normal = self._ground.normal(state.body_position_m[:, :2])
        into: Tensor = rotate_inverse_wxyz(state.world_from_body_wxyz, -normal)
        return into

    def _weighted_rewards(self, moment: Moment) -> Tensor:
        """Each term times its weight and the period, shape (n, terms), in the order of the config's fields."""
        shape = self.config.reward_shape
        values = torch.stack([term(moment, shape) for term in self._terms], dim=-1)
        return values * self._weights

    def _reset(self, mask: Tensor) -> None:
        config = self.config
        initial = draw_initial_state(config.randomisation, self._ground, self.n_envs, self._draws)
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

    def _observation(self, state: TaskState) -> Tensor:
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

    def _observe(self, state: TaskState) -> dict[str, Tensor]:
        """The blocks of the observation by name."""
        blocks = torch.split(self._observation(state), [size for _, size in OBSERVATION_LAYOUT], dim=-1)
        return {name: block for (name, _), block in zip(OBSERVATION_LAYOUT, blocks, strict=True)}

    def _observed(self, state: TaskState, reward: Tensor, done: Tensor, timed_out: Tensor) -> StepResult:
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


PART_SIZE: Final = 512
"""Robots of one part on a CPU: enough that its arithmetic outweighs Python, and two parts of the usual 1,024. From
four parts on they are twice as large: 4 % faster."""


def make_tasks(
    config: TrainConfig, device: str, *, rank: int = 0, kind: type[Task] = Task, model: RobotModel | None = None
) -> list[Task]:
    """The robots of a config: one task on a GPU, parts of some :data:`PART_SIZE` robots on a CPU.

    The parts depend on the config alone, not on the machine, so a run can be repeated on another. ``kind`` and
    ``model`` are those of :func:`make_task`.

    Raises:
        BadInputError: The device does not exist, or the model or an effect is not allowed.
    """
    size = PART_SIZE if config.n_envs < 4 * PART_SIZE else 2 * PART_SIZE
    n_parts = math.ceil(config.n_envs / size) if device == "cpu" else 1
    threads = max(1, len(os.sched_getaffinity(0)) // n_parts)
    ends = [round(config.n_envs * i / n_parts) for i in range(n_parts + 1)]
    return [
        make_task(
            config.model_copy(update={"n_envs": end - start}),
            device,
            seed=(config.seed * 1000 + rank) * 10_000 + part,
            n_threads=threads,
            kind=kind,
            model=model,
        )
        for part, (start, end) in enumerate(itertools.pairwise(ends))
    ]


def make_task(
    config: TrainConfig,
    device: str,
    *,
    seed: int,
    n_threads: int = 0,
    kind: type[Task] = Task,
    model: RobotModel | None = None,
) -> Task:
    """Build one back end and its task.

    Args:
        config: What to train.
        device: "cpu", or a CUDA device such as "cuda:0".
        seed: Of all draws.
        n_threads: CPU threads for physics, 0 for all.
        kind: The task's class.
        model: The simulated robot, in place of the config's.

    Raises:
        BadInputError: The device does not exist, or the model or an effect is not allowed.
    """
    check_device(device)
    generator = torch.Generator(device=device)
    generator.manual_seed(seed)
    draws = Draws(generator)
    randomisation = config.task.randomisation
    effects = training_effects(model or config.model, randomisation, config.n_envs, draws)
    simulations = draw_simulations(randomisation, config.n_envs, draws)
    backend = PlantBackend(config.task, effects, simulations, device, n_threads, seed=seed)
    return kind(config.task, backend, generator)
