from typing import Any

import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from spot_model.robot import facts
from trainer.config.train_config import TrainConfig, train_config_from_data
from trainer.ppo.vec_env import TaskVecEnv, TrainingDivergedError
from trainer.task.plant_backend import InitialState, TaskState
from trainer.task.task import PERIOD_S, Task, make_task

N = 4


class StillBackend:
    """A fake that moves nothing: robots hang where they were put, and touch what the test says."""

    def __init__(self, n: int = N) -> None:
        self.n_envs = n
        self.device = torch.device("cpu")
        self.body_contact = torch.zeros(n, dtype=torch.bool)
        self.foot_contact = torch.ones(n, 4, dtype=torch.bool)
        self.pushed = torch.zeros(n, 3)
        self.setpoints: list[torch.Tensor] = []
        self.resets = torch.zeros(n)
        pose = torch.tensor(facts.DEFAULT_POSITION_RAD, dtype=torch.float32).repeat(n, 1)
        self.velocity_rad_s = torch.zeros(n, 12)
        self.level = torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(n, 1)
        self.position_rad = pose

    def step(self, setpoint_position_rad: torch.Tensor) -> None:
        self.setpoints.append(setpoint_position_rad)

    def read(self) -> TaskState:
        zero, joints, feet = torch.zeros(self.n_envs, 3), (self.position_rad, self.velocity_rad_s), self.foot_contact
        torque = torch.zeros(self.n_envs, 12)
        return TaskState(*joints, torque, zero, self.level, zero, zero, feet, self.body_contact, feet.float())

    def read_reported(self, truth: TaskState) -> TaskState:
        return truth

    def reset(self, mask: torch.Tensor, initial: InitialState) -> None:
        self.resets += mask

    def add_velocity(self, delta_m_s: torch.Tensor) -> None:
        self.pushed = self.pushed + delta_m_s.abs()

    def snapshot(self) -> dict[str, Any]:
        return {}

    def restore(self, snapshot: dict[str, Any]) -> None:
        pass


def config(*overrides: str) -> TrainConfig:
    return train_config_from_data({"name": "t", "iterations": 1, "n_envs": N}, source="test", overrides=overrides)


def task(backend: Any, *overrides: str, seed: int = 0) -> Task:
    return Task(config(*overrides).task, backend, torch.Generator().manual_seed(seed))


def test_an_action_becomes_setpoints_about_the_default_pose() -> None:
    backend = StillBackend()
    t = task(backend)
    t.start()
    t.step(torch.full((N, 12), 2.0))
    expected = torch.tensor(facts.DEFAULT_POSITION_RAD, dtype=torch.float32) + 0.4
    torch.testing.assert_close(backend.setpoints[0], expected.repeat(N, 1))


def test_an_episode_ends_by_a_fall_or_after_twenty_seconds() -> None:
    backend = StillBackend()
    t = task(backend)
    t.start()
    backend.body_contact = torch.tensor([False, True, False, False])
    t.episode_steps[2] = 999
    result = t.step(torch.zeros(N, 12))
    assert result.done.tolist() == [False, True, True, False]
    assert result.timed_out.tolist() == [False, False, True, False]
    assert t.episode_steps.tolist() == [1, 0, 0, 1]
    assert backend.resets.tolist() == [1.0, 2.0, 2.0, 1.0]


def test_reward_is_the_weighted_sum_times_the_period_and_late_rewards_change_evenly() -> None:
    zero = ("linear_velocity", "gait", "air_time", "foot_clearance", "joint_acceleration")
    plain = [*(f"rewards.{name}=0" for name in zero), "rewards.yaw_rate=4", "commands.standing_share=1"]
    late = ["late_rewards.weights={yaw_rate: 8}", "late_rewards.from_iteration=10", "late_rewards.over_iterations=4"]
    for overrides, by_iteration in (
        (plain, {0: 4.0, 99: 4.0}),
        (plain + late, {0: 4.0, 10: 4.0, 11: 5.0, 14: 8.0, 99: 8.0}),
    ):
        t = task(StillBackend(), *overrides)
        t.start()
        for iteration, weight in by_iteration.items():
            t.advance_schedule(iteration)
            reward = t.step(torch.zeros(N, 12)).reward
            torch.testing.assert_close(reward, torch.full((N,), weight * PERIOD_S))


def test_a_share_of_the_robots_has_short_episodes() -> None:
    t = task(StillBackend(), "short_episode_share=0.5", "short_episode_s=0.04")
    t.start()
    assert not t.step(torch.zeros(N, 12)).done.any()
    assert t.step(torch.zeros(N, 12)).timed_out.tolist() == [True, True, False, False]


def test_commands_stay_in_their_ranges_and_some_stand() -> None:
    backend = StillBackend(2000)
    t = task(backend, "commands.v_x_m_s=[-2, 5]", "commands.straight_share=0.25", "commands.turning_share=0.2")
    t.start()
    command = t.commands.command
    low, high = torch.tensor([-2.0, -1.5, -2.0]), torch.tensor([5.0, 1.5, 2.0])
    assert bool(((command >= low) & (command <= high)).all())
    standing = (command == 0).all(dim=-1).float().mean()
    assert 0.07 < float(standing) < 0.13
    straight = ((command[:, 1:] == 0).all(dim=-1) & (command[:, 0] != 0)).float().mean()
    assert 0.2 < float(straight) < 0.3
    turning = ((command[:, :2] == 0).all(dim=-1) & (command[:, 2] != 0)).float().mean()
    assert 0.15 < float(turning) < 0.25


def test_commands_are_held_and_drawn_anew_when_their_time_is_up() -> None:
    t = task(StillBackend(), "commands.resample_s=0.1")
    t.start()
    first = t.commands.command.clone()
    for _ in range(4):
        t.step(torch.zeros(N, 12))
    assert torch.equal(t.commands.command, first)
    t.step(torch.zeros(N, 12))
    assert not torch.equal(t.commands.command, first)


def test_lateral_acceleration_is_bounded() -> None:
    t = task(StillBackend(500), "commands.lateral_acceleration_limit_m_s2=3")
    t.start()
    assert float((t.commands.command[:, 0] * t.commands.command[:, 2]).abs().max()) <= 3.0 + 1e-5


def test_curriculum_grows_the_ranges() -> None:
    t = task(StillBackend(500), "commands.curriculum_iterations=10", "commands.curriculum_start=0.2")
    t.commands.advance_curriculum(0)
    assert float(t.commands.draw()[:, 0].max()) <= 0.2 * 5.5
    t.commands.advance_curriculum(5)
    assert t.commands.share == pytest.approx(0.6)
    t.commands.advance_curriculum(50)
    assert t.commands.share == 1.0


def test_pushes_come_at_their_interval() -> None:
    backend = StillBackend()
    t = task(backend, "randomisation.push_interval_s=[0.1, 0.1]", "randomisation.push_m_s=[0.5, 0.5]")
    t.start()
    for _ in range(4):
        t.step(torch.zeros(N, 12))
    assert not backend.pushed.any()
    t.step(torch.zeros(N, 12))
    torch.testing.assert_close(backend.pushed, torch.tensor([[0.5, 0.5, 0.0]]).repeat(N, 1))


def test_noise_has_the_configured_deviations_and_spares_command_and_action() -> None:
    t = task(StillBackend(4000))
    result = t.start()
    noise = result.observation - result.clean_observation
    assert not noise[:, 9:12].any()
    assert not noise[:, 36:].any()
    assert float(noise[:, 24:36].std()) == pytest.approx(0.45, rel=0.05)
    assert float(noise[:, 3].std()) == pytest.approx(0.105, rel=0.1)
    silent = task(StillBackend(), "noise.scale=0").start()
    assert torch.equal(silent.observation, silent.clean_observation)


def roll(seed: int, steps: int = 15) -> torch.Tensor:
    t = make_task(config("n_envs=6"), "cpu", seed=seed, n_threads=1)
    t.start()
    generator = torch.Generator().manual_seed(9)
    results = [t.step(0.5 * torch.randn(6, 12, generator=generator)) for _ in range(steps)]
    return torch.cat([torch.cat([r.observation, r.reward[:, None]], dim=-1) for r in results])


def test_a_seed_fixes_everything() -> None:
    assert torch.equal(roll(3), roll(3))
    assert not torch.equal(roll(3), roll(4))


def test_a_number_that_is_not_finite_is_named_with_environment_and_step() -> None:
    env = TaskVecEnv([task(StillBackend())], steps_per_iteration=3)
    env.steps = 6
    seen, rewards = torch.zeros(3, N, 48), torch.zeros(3, N, 1)
    env.check_finite(seen, rewards)
    seen[2, 1, 3] = torch.inf
    seen[1, 2, 24 + 5] = torch.nan
    with pytest.raises(TrainingDivergedError, match=r"environment 2 of 4 .* in joint_velocity_rad_s at policy step 4 "):
        env.check_finite(seen, rewards)
    rewards[0, 0] = torch.nan
    with pytest.raises(TrainingDivergedError, match=r"environment 0 of 4 .* in the reward at policy step 4 \(3 env"):
        env.check_finite(seen, rewards)
    env.get_observations()["policy"][0, 0] = torch.nan
    with pytest.raises(TrainingDivergedError, match=r"environment 0 of 4 .* at policy step 6 \(1 env"):
        env.check_finite(torch.zeros(3, N, 48), torch.zeros(3, N, 1))


class ForbidWaiting(TorchDispatchMode):
    """Fails on operations that make a GPU's host wait, or that copy Python data to the device."""

    WAITING = ("nonzero", "_local_scalar_dense", "masked_select", "lift_fresh", "_unique")

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        name = str(func)
        indices = args[1] if "index" in name and len(args) > 1 and isinstance(args[1], (list, tuple)) else ()
        by_mask = any(isinstance(i, torch.Tensor) and i.dtype == torch.bool for i in indices)
        assert not by_mask, f"{name} by a mask waits for the device"
        assert not any(word in name for word in self.WAITING), f"{name} waits for the device"
        return func(*args, **(kwargs or {}))


@pytest.mark.parametrize("override", ["n_envs=4", "commands.curriculum_iterations=3", "terrain.kind=noise"])
def test_no_step_waits_for_the_device(override: str) -> None:
    t = task(StillBackend(), override)
    t.start()
    t.step(torch.zeros(N, 12))
    action = torch.zeros(N, 12)
    with ForbidWaiting(), torch.inference_mode():
        t.step(action)


def test_episode_statistics_are_means_over_finished_episodes() -> None:
    backend = StillBackend()
    t = task(backend)
    t.start()
    for _ in range(3):
        t.step(torch.zeros(N, 12))
    backend.body_contact = torch.tensor([True, False, False, False])
    t.step(torch.zeros(N, 12))
    figures = t.stats.drain()
    assert (figures["episodes"], figures["episode_length"], figures["fall_share"]) == (1.0, 4.0, 1.0)
    assert figures["reward"] == pytest.approx(sum(v for k, v in figures.items() if k.startswith("reward/")), rel=1e-5)
    assert t.stats.drain() == {}
