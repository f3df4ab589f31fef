"""The closed loop against the same steps written out, and its ways for a command."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from spot_model.effects.base import CommandEffect
from spot_model.effects.commands import CommandDelay
from spot_model.plant.closed_loop import (
    ClosedLoop,
    StartState,
    put_at,
    schedule_by_messages,
    schedule_by_rate,
    standing_height_m,
    true_state,
)
from spot_model.plant.command_path import ReceiptPath
from spot_model.plant.plant import Plant, PlantOptions, ServoCommand
from spot_model.policy.observation import N_OBSERVATION, Sensed, build_observation
from spot_model.policy.policy import Policy, load_policy
from spot_model.robot import facts
from spot_model.robot.mjcf import MjcfOptions

STATE_STEP = PlantOptions(mjcf=MjcfOptions(timestep_s=0.0015), n_threads=1)


@pytest.fixture(scope="module")
def policy() -> Policy:
    return load_policy(Path(__file__).parents[2] / "policies" / "walk.onnx")


def forward(_: int) -> np.ndarray:
    return np.array([0.5, 0.0, 0.1])


def test_it_is_the_loop_written_out_bit_for_bit(policy):
    plant = Plant([CommandDelay(delay_s=0.005)], 2, PlantOptions(n_threads=1))
    steps = round(0.02 / plant.timestep_s)
    gains, order = policy.gains(), policy.policy_from_canonical
    action = np.zeros((2, 12), dtype=np.float32)
    by_hand = []
    for _ in range(12):
        observation = build_observation(
            world_from_body_wxyz=plant.world_from_body_wxyz,
            linear_vel_of_body_in_world_m_s=plant.linear_vel_of_body_in_world_m_s,
            angular_vel_of_body_in_world_rad_s=plant.angular_vel_of_body_in_world_rad_s,
            velocity_command=np.tile(forward(0), (2, 1)),
            position_rad=plant.joint_position_rad[:, order],
            velocity_rad_s=plant.joint_velocity_rad_s[:, order],
            last_action=action,
            default_position_rad=policy.default_position_rad,
        )
        action = policy.act(observation)
        plant.command(ServoCommand(policy.setpoint_rad(action), 0.0, 0.0, gains.kp_nm_per_rad, gains.kd_nm_s_per_rad))
        plant.advance(steps)
        by_hand.append((observation, action, plant.joint_position_rad))

    again = Plant([CommandDelay(delay_s=0.005)], 2, PlantOptions(n_threads=1))
    loop = ClosedLoop(again, policy)
    ticks = loop.run(forward, schedule_by_rate(12, 50.0, again.timestep_s))
    for tick, (observation, action, position) in zip(ticks, by_hand, strict=True):
        np.testing.assert_array_equal(tick.observation, observation)
        np.testing.assert_array_equal(tick.action, action)
        np.testing.assert_array_equal(again.joint_position_rad, position)


def test_what_the_policy_sees_and_who_is_called_when(policy):
    plant, calls, seen = Plant([], 1, STATE_STEP), [], []

    def sense(message: int) -> Sensed | None:
        calls.append(f"state {message}")
        return true_state(plant) if message == 0 else None

    loop = ClosedLoop(
        plant,
        policy,
        sense=sense,
        see=lambda tick, observation: observation + tick,
        act=lambda observation: seen.append(observation) or np.zeros((1, 12), dtype=np.float32),
        before_tick=lambda tick: calls.append(f"tick {tick}"),
        after_step=lambda: calls.append("step"),
    )
    ticks = list(loop.run(forward, [(1, 2), (1,)]))
    assert calls == ["tick 0", "state 0", "step", "state 1", "step", "step", "tick 1", "state 0", "step"]
    assert [tick.index for tick in ticks] == [0, 1]
    assert seen[1].shape == (1, N_OBSERVATION)
    assert ticks[1].observation[0, 9] == pytest.approx(0.5 + 1.0)


def test_schedules_keep_an_absolute_pace():
    assert schedule_by_rate(4, 50.0, 0.005) == [(4,)] * 4
    assert schedule_by_rate(6, 50.0, 0.003) == [(6,), (7,), (7,), (6,), (7,), (7,)]
    assert sum(steps for (steps,) in schedule_by_rate(300, 50.0, 0.003)) == 2000
    assert [len(messages) for messages in schedule_by_messages(4, 2)] == [7, 7, 6, 7]
    assert [len(messages) for messages in schedule_by_messages(3, 2, 0.018)] == [6, 6, 6]


@dataclass(frozen=True, kw_only=True)
class Lost(CommandEffect):
    """No command ever arrives."""

    name: ClassVar[str] = "lost"

    def arrival_s(self, issued_s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return np.full_like(issued_s, np.inf)


def receipts(delay_s: float, n_steps: int) -> tuple[list[float], ReceiptPath]:
    """Joint set-points that one command from 0 to 1 rad gives at each step of 1.5 ms, and the path."""
    plant, told = Plant([], 1, STATE_STEP), []
    plant.command = lambda command: told.append(float(command.position_rad[0, 0]))  # type: ignore[method-assign]
    channel = [CommandDelay(delay_s=delay_s)] if np.isfinite(delay_s) else [Lost()]
    rng = np.random.default_rng(0)
    path = ReceiptPath(plant, policy_gains(), np.zeros((1, 12)), channel, rng, start_ns=1_000)
    path.send(1, np.ones((1, 12)))
    for _ in range(n_steps):
        path.advance(1)
    return told, path


def policy_gains():
    from spot_model.robot.state import Gains

    return Gains.policy()


def test_a_command_that_arrives_within_a_step_counts_for_the_rest_of_it():
    # 2 ms: a step of 1.5 ms without it, then two thirds of the second step under it.
    told, path = receipts(0.002, 3)
    assert told == pytest.approx([0.0, 2.0 / 3.0, 1.0])
    assert path.key.tolist() == [1]
    assert path.received_ns.tolist() == [2_001_000]


def test_a_lost_command_is_never_received():
    told, path = receipts(np.inf, 3)
    assert told == [0.0]
    assert path.key.tolist() == path.received_ns.tolist() == [0]


def test_each_robot_starts_in_its_own_state_on_the_ground():
    tilt = np.array([np.cos(0.05), np.sin(0.05), 0.0, 0.0])
    starts = [
        StartState(
            position_rad=facts.DEFAULT_POSITION_RAD + 0.1 * i,
            velocity_rad_s=np.full(12, 0.2 * i),
            world_from_body_wxyz=tilt,
            linear_vel_of_body_in_world_m_s=np.array([0.3, 0.0, 0.0]),
            angular_vel_of_body_in_world_rad_s=np.array([0.0, 0.0, 0.4]),
            last_action=np.full(12, i, dtype=np.float32),
        )
        for i in range(2)
    ]
    plant = Plant([], 2, PlantOptions(n_threads=1))
    last = put_at(plant, starts)
    assert last.tolist() == [[0.0] * 12, [1.0] * 12]
    np.testing.assert_allclose(plant.joint_position_rad[1], facts.DEFAULT_POSITION_RAD + 0.1)
    np.testing.assert_allclose(plant.world_from_body_wxyz, np.tile(tilt, (2, 1)))
    np.testing.assert_allclose(plant.angular_vel_of_body_in_world_rad_s, [[0.0, 0.0, 0.4]] * 2, atol=1e-12)
    np.testing.assert_allclose(
        plant.position_of_body_in_world_m[:, 2], [standing_height_m(s) for s in starts], atol=2e-6
    )
    lowest = plant.foot_position_in_world_m[..., 2].min(axis=1)
    np.testing.assert_allclose(lowest, facts.FOOT_RADIUS_M - 1e-6, atol=1e-9)
