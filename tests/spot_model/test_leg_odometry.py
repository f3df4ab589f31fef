"""The estimator's error in motions that are worked out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from spot_model.effects.base import BodyEstimate, JointReading
from spot_model.effects.leg_odometry import LegOdometry
from spot_model.plant.plant import Plant, PlantOptions
from spot_model.robot import facts


def _held(
    n: int, velocity_m_s: np.ndarray, rates_rad_s: np.ndarray, contact: np.ndarray
) -> tuple[BodyEstimate, JointReading]:
    """What the estimator is shown of a robot in a given state."""
    plant = Plant((), n, PlantOptions(n_threads=1))
    plant.reset(linear_vel_of_body_in_world_m_s=velocity_m_s, joint_velocity_rad_s=rates_rad_s)
    return replace(plant.true_estimate(), foot_contact=contact.astype(np.float64)), plant.true_reading()


def _error(held: tuple[BodyEstimate, JointReading], times_s: list[float], n_states: int) -> np.ndarray:
    """What is reported beside the truth after some states of 3 ms, body axes."""
    truth, joints = held
    odometry = LegOdometry(time_s=np.array(times_s)[:, None]).arrays_like(np.zeros((1, 12)))
    memory = odometry.start(truth)
    for _ in range(n_states):
        reported, memory = odometry.estimate(truth, joints, 0.003, memory, np.random.default_rng(0))
    return reported.linear_vel_of_body_in_body_m_s - truth.linear_vel_of_body_in_body_m_s


def test_feet_that_slide_with_the_body_are_believed_to_stand() -> None:
    # The body and all feet slide ahead at 0.4 m/s: legs that do not move say that nothing moves.
    all_on = np.ones((3, 4), dtype=bool)
    sliding = _held(3, np.array([0.4, 0.0, 0.0]), np.zeros((3, 12)), all_on)
    error = _error(sliding, [0.02, 0.1, 0.0], 2000)
    assert error[:2] == pytest.approx(np.tile([-0.4, 0.0, 0.0], (2, 1)), abs=1e-6)
    assert not error[2].any()


def test_the_error_comes_with_its_time_constant() -> None:
    sliding = _held(1, np.array([0.4, 0.0, 0.0]), np.zeros((1, 12)), np.ones((1, 4), dtype=bool))
    # Eight states until feet count, then a hundred of 3 ms: 0.3 s.
    assert _error(sliding, [0.3], 108)[0, 0] == pytest.approx(-0.4 * (1.0 - np.exp(-1.0)), rel=1e-6)


def test_without_a_standing_foot_legs_say_nothing() -> None:
    nothing = _held(1, np.array([0.4, 0.0, 0.0]), np.zeros((1, 12)), np.zeros((1, 4), dtype=bool))
    assert not _error(nothing, [0.05], 500).any()


def test_a_swinging_leg_does_not_count() -> None:
    rates = np.zeros((1, facts.N_JOINTS))
    rates[0, 1] = 4.0
    contact = np.array([[False, True, True, True]])
    assert not np.abs(_error(_held(1, np.zeros(3), rates, contact), [0.05], 500)).max() > 1e-9
    contact[0, 0] = True
    assert np.abs(_error(_held(1, np.zeros(3), rates, contact), [0.05], 500)).max() > 0.1
