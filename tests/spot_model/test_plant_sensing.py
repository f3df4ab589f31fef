from __future__ import annotations

import numpy as np
import pytest

from spot_model.effects.commands import ActionScale, CommandJitter
from spot_model.effects.estimator import ContactDelay, VelocityEstimate
from spot_model.effects.joint_sensors import EncoderOffset, SensorNoise
from spot_model.effects.registry import BUILT_IN
from spot_model.plant.plant import Plant, PlantOptions, ServoCommand
from spot_model.robot import facts


def trajectory(plant: Plant, n_ticks: int = 25) -> np.ndarray:
    seen = []
    for k in range(n_ticks):
        plant.step(facts.DEFAULT_POSITION_RAD + 0.2 * np.sin(0.4 * k), 4)
        seen.append(np.concatenate([plant.reading.position_rad, plant.joint_velocity_rad_s], axis=1))
    return np.array(seen)


def test_all_null_effects_together_change_no_bit():
    plain = trajectory(Plant((), 2))
    np.testing.assert_array_equal(trajectory(Plant(tuple(cls() for cls in BUILT_IN.values()), 2)), plain)


def test_the_servo_believes_its_encoder():
    offset = 0.05
    plant = Plant((EncoderOffset(joints=("fl_kn",), offset_rad=offset),), 1)
    honest = Plant((), 1)
    for _ in range(200):
        plant.step(facts.DEFAULT_POSITION_RAD, 4)
        honest.step(facts.DEFAULT_POSITION_RAD, 4)
    assert plant.reading.position_rad[0, 2] == pytest.approx(plant.joint_position_rad[0, 2] + offset, abs=1e-12)
    # Held at the same set-point, the knee itself settles lower by most of the offset.
    assert plant.joint_position_rad[0, 2] < honest.joint_position_rad[0, 2] - 0.5 * offset


def test_a_seed_gives_the_same_draws_and_another_seed_others():
    effects = (SensorNoise(position_rad=0.001), CommandJitter(mean_s=0.003))
    runs = [trajectory(Plant(effects, 2, PlantOptions(seed=seed))) for seed in (1, 1, 2)]
    np.testing.assert_array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])


def test_a_snapshot_continues_noise_and_memories_bit_for_bit():
    effects = (SensorNoise(velocity_rad_s=0.05), VelocityEstimate(lag_s=0.02), ContactDelay(delay_s=0.02))
    plant = Plant(effects, 2, PlantOptions(seed=3))
    trajectory(plant, 10)
    saved = plant.snapshot()
    expected = trajectory(plant, 10)
    reported = plant.estimate.linear_vel_of_body_in_body_m_s
    other = Plant(effects, 2, PlantOptions(seed=99))
    other.restore(saved)
    np.testing.assert_array_equal(trajectory(other, 10), expected)
    np.testing.assert_array_equal(other.estimate.linear_vel_of_body_in_body_m_s, reported)


def test_a_program_with_a_wrong_action_scale_moves_further():
    setpoint = facts.DEFAULT_POSITION_RAD + 0.1
    scaled, plain, larger = Plant((ActionScale(scale=1.5),), 1), Plant((), 1), Plant((), 1)
    for _ in range(10):
        scaled.step(setpoint, 4)
        plain.step(setpoint, 4)
        larger.step(facts.DEFAULT_POSITION_RAD + 0.15, 4)
    np.testing.assert_allclose(scaled.joint_position_rad, larger.joint_position_rad, atol=1e-9)
    assert np.abs(scaled.joint_position_rad - plain.joint_position_rad).max() > 0.01


def test_the_body_may_be_estimated_less_often_than_the_physics_steps():
    effects = (VelocityEstimate(lag_s=0.02), EncoderOffset(offset_rad=0.01))
    often, seldom = (Plant(effects, 1, PlantOptions(estimate_steps=n)) for n in (1, 2))
    start = seldom.estimate
    for plant in (often, seldom):
        plant.command(ServoCommand(position_rad=facts.DEFAULT_POSITION_RAD + 0.3))
        plant.advance()
    assert seldom.estimate is start
    np.testing.assert_array_equal(seldom.reading.position_rad, often.reading.position_rad)
    for plant in (often, seldom):
        plant.advance(19)
    np.testing.assert_array_equal(seldom.joint_position_rad, often.joint_position_rad)
    lag = [p.estimate.linear_vel_of_body_in_body_m_s for p in (often, seldom)]
    np.testing.assert_allclose(lag[1], lag[0], atol=0.05 * np.abs(lag[0]).max())
