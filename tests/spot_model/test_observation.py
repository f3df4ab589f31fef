from __future__ import annotations

import numpy as np
import pytest

from spot_model.policy.observation import (
    COLUMNS,
    N_OBSERVATION,
    OBSERVATION,
    build_observation,
    is_fallen,
    observation_of_one,
    observed,
)
from spot_model.robot.control import pd_torque, saturate_setpoint


def test_blocks_stand_in_the_papers_order():
    quarter_turn_left = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
    observation = build_observation(
        world_from_body_wxyz=quarter_turn_left,
        linear_vel_of_body_in_world_m_s=np.array([0.0, 2.0, 0.5]),
        angular_vel_of_body_in_world_rad_s=np.array([1.0, 0.0, 0.25]),
        velocity_command=np.array([2.0, 0.1, -0.2]),
        position_rad=np.arange(12) + 1.0,
        velocity_rad_s=np.arange(12) * 10.0,
        last_action=np.arange(12) * 100.0,
        default_position_rad=np.ones(12),
    )
    assert observation.shape == (N_OBSERVATION,) == (48,)
    # Facing the world's y axis, moving along it is moving forward.
    np.testing.assert_allclose(observation[0:3], [2.0, 0.0, 0.5], atol=1e-12)
    np.testing.assert_allclose(observation[3:6], [0.0, -1.0, 0.25], atol=1e-12)
    np.testing.assert_allclose(observation[6:9], [0.0, 0.0, -1.0], atol=1e-12)
    np.testing.assert_array_equal(observation[9:12], [2.0, 0.1, -0.2])
    np.testing.assert_array_equal(observation[12:24], np.arange(12))
    np.testing.assert_array_equal(observation[24:36], np.arange(12) * 10.0)
    np.testing.assert_array_equal(observation[36:48], np.arange(12) * 100.0)


def test_batched_numpy_and_torch_agree():
    torch = pytest.importorskip("torch")
    rng = np.random.default_rng(0)
    quaternion = rng.normal(size=(5, 4))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    parts = {
        "world_from_body_wxyz": quaternion,
        "linear_vel_of_body_in_world_m_s": rng.normal(size=(5, 3)),
        "angular_vel_of_body_in_world_rad_s": rng.normal(size=(5, 3)),
        "velocity_command": rng.normal(size=(5, 3)),
        "position_rad": rng.normal(size=(5, 12)),
        "velocity_rad_s": rng.normal(size=(5, 12)),
        "last_action": rng.normal(size=(5, 12)),
        "default_position_rad": rng.normal(size=12),
    }
    expected = build_observation(**parts)
    out = build_observation(**{k: torch.as_tensor(v) for k, v in parts.items()})
    np.testing.assert_allclose(out.numpy(), expected, rtol=1e-12)
    np.testing.assert_allclose(
        build_observation(**{k: (v if v.ndim == 1 else v[2]) for k, v in parts.items()}),
        expected[2],
        rtol=1e-12,
    )


def test_one_robot_in_the_loop_gets_the_same_bits():
    rng = np.random.default_rng(1)
    for _ in range(50):
        quaternion = rng.normal(size=4)
        parts = {
            "world_from_body_wxyz": quaternion / np.linalg.norm(quaternion),
            "linear_vel_of_body_in_world_m_s": rng.normal(size=3),
            "angular_vel_of_body_in_world_rad_s": rng.normal(size=3),
            "velocity_command": rng.normal(size=3),
            "position_rad": rng.normal(size=12),
            "velocity_rad_s": rng.normal(size=12),
            "last_action": rng.normal(size=12).astype(np.float32),
            "default_position_rad": rng.normal(size=12),
        }
        one = observation_of_one(**parts)
        assert one.dtype == np.float64
        np.testing.assert_array_equal(one, build_observation(**parts))


def test_servo_law_by_hand():
    torque = pd_torque(
        position_rad=np.array([0.4]),
        velocity_rad_s=np.array([2.0]),
        setpoint_position_rad=np.array([0.5]),
        setpoint_velocity_rad_s=0.5,
        feedforward_nm=3.0,
        kp_nm_per_rad=np.array([60.0]),
        kd_nm_s_per_rad=np.array([1.5]),
    )
    # 60 · 0.1 + 1.5 · (0.5 − 2) + 3
    np.testing.assert_allclose(torque, [6.75])


def test_setpoints_saturate_at_the_stops():
    low, high = np.array([-0.5, -1.0]), np.array([0.5, 2.0])
    np.testing.assert_array_equal(
        saturate_setpoint(np.array([[0.2, -3.0], [0.9, 2.0]]), low, high), [[0.2, -1.0], [0.5, 2.0]]
    )


def test_fields_cover_the_observation_and_are_named_once():
    assert [field.name for field in OBSERVATION] == list(COLUMNS)
    columns = np.concatenate([np.arange(N_OBSERVATION)[COLUMNS[name]] for name in COLUMNS])
    np.testing.assert_array_equal(columns, np.arange(N_OBSERVATION))
    for field in OBSERVATION:
        assert field.mirror is None or len(field.mirror) == field.width
        np.testing.assert_array_equal(
            observed(np.arange(N_OBSERVATION)[None], field.name)[0], columns[COLUMNS[field.name]]
        )
    with pytest.raises(KeyError):
        observed(np.zeros(N_OBSERVATION), "no_such_field")


def test_noise_keys_are_those_of_the_training_config():
    config = pytest.importorskip("trainer.config.task_config").NoiseConfig
    assert {field.noise for field in OBSERVATION if field.noise} == set(config.model_fields) - {"scale"}


def test_a_robot_that_leans_by_more_than_60_degrees_has_fallen():
    observation = np.zeros((3, N_OBSERVATION))
    observed(observation, "projected_gravity_in_body")[:, 2] = [-1.0, -np.cos(np.radians(59)), -np.cos(np.radians(61))]
    np.testing.assert_array_equal(is_fallen(observation), [False, False, True])
