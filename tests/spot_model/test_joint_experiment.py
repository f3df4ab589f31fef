"""Joint experiments: files, inverse kinematics, motions, and what they do to a simulated robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spot_model.errors import BadInputError
from spot_model.io.joint_experiment import (
    JointExperiment,
    Squat,
    Standing,
    Sweep,
    joint_experiment_from_data,
    load_joint_experiment,
)
from spot_model.plant.closed_loop import ClosedLoop, schedule_by_messages
from spot_model.plant.plant import Plant, PlantOptions
from spot_model.policy.joint_script import SPEED_RAD_S, TABLE_HZ, joint_script, motion_of
from spot_model.policy.observation import Sensed
from spot_model.robot import facts
from spot_model.robot.leg_kinematics import foot_position_in_body_m, joints_of_feet
from spot_model.robot.mjcf import MjcfOptions
from spot_model.robot.rotation import projected_gravity

EVERY: tuple[JointExperiment, ...] = (
    Standing(name="sway", duration_s=8.0),
    Squat(name="squat", duration_s=8.0),
    Sweep(name="knee", duration_s=10.0, joint="fl_kn"),
    Sweep(name="knee_down", duration_s=6.0, joint="hr_kn", amplitude_rad=0.05, is_leg_lifted=False),
)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(-0.35, 0.35), min_size=12, max_size=12))
def test_inverse_kinematics_undoes_the_forward_one(offset: list[float]) -> None:
    pose = facts.DEFAULT_POSITION_RAD + np.array(offset)
    found = joints_of_feet(np.asarray(foot_position_in_body_m(pose)), facts.DEFAULT_POSITION_RAD)
    np.testing.assert_allclose(foot_position_in_body_m(found), foot_position_in_body_m(pose), atol=1e-6)


def test_a_foot_out_of_reach_is_refused() -> None:
    feet = np.asarray(foot_position_in_body_m(facts.DEFAULT_POSITION_RAD)) - np.array([0.0, 0.0, 0.5])
    with pytest.raises(ValueError, match="stays 0"):
        joints_of_feet(feet, facts.DEFAULT_POSITION_RAD)


@pytest.mark.parametrize("experiment", EVERY, ids=lambda e: e.name)
def test_a_file_comes_back_as_it_went(experiment: JointExperiment, tmp_path: Path) -> None:
    path = tmp_path / "e.yaml"
    path.write_text(experiment.model_dump_json(by_alias=True))  # JSON is YAML
    assert load_joint_experiment(path) == experiment


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"kind": "sweep", "joint": "fl_xx", "name": "a", "duration_s": 10}, "fl_xx"),
        ({"kind": "sweep", "joint": "fl_kn", "name": "a", "duration_s": 7}, "at least 8"),
        ({"kind": "squat", "name": "a", "duration_s": 10, "kp_nm_per_rad": 900}, "kp_nm_per_rad"),
        (
            {"kind": "sweep", "joint": "fl_hy", "name": "a", "duration_s": 8, "is_leg_lifted": False},
            "up to 0.15 with the leg on the ground",
        ),
        ({"kind": "jump", "name": "a", "duration_s": 10}, "jump"),
        ({"kind": "squat", "name": "a", "duration_s": 10, "depht_m": 0.1}, "depht_m"),
    ],
)
def test_what_is_not_allowed_is_named(data: dict[str, object], words: str) -> None:
    with pytest.raises(BadInputError, match=words):
        joint_experiment_from_data({"schema": "spot-rl/joint-experiment/1", **data})


@pytest.mark.parametrize("experiment", EVERY, ids=lambda e: e.name)
def test_a_motion_begins_and_ends_at_rest_and_keeps_its_speed(experiment: JointExperiment) -> None:
    motion = motion_of(experiment)
    assert motion.duration_s == experiment.duration_s
    for end_s in (0.0, experiment.duration_s, -1.0, experiment.duration_s + 1.0):
        np.testing.assert_allclose(motion.at(end_s), 0.0, atol=1e-9)
    assert np.abs(motion.offset_rad).max() > 0.01
    assert np.abs(np.diff(motion.offset_rad, axis=0)).max() * TABLE_HZ <= SPEED_RAD_S


def test_too_fast_and_too_far_are_refused_by_joint_value_and_bound() -> None:
    with pytest.raises(BadInputError, match=r"fl_kn moves at .* rad/s; allowed: up to 6 rad/s"):
        motion_of(Sweep(name="a", duration_s=10.0, joint="fl_kn", amplitude_rad=0.5, end_hz=5.0))
    with pytest.raises(BadInputError, match=r"hr_hx lies .* rad outside"):
        motion_of(Sweep(name="a", duration_s=10.0, joint="hr_hx", amplitude_rad=0.6, end_hz=1.0))


def test_a_body_that_would_be_thrown_is_refused_with_its_acceleration() -> None:
    """Down and up by 0.16 m at 2 Hz: 0.08 · (2π · 2)² = 12.6 m/s², and the feet would leave the ground."""
    with pytest.raises(BadInputError, match=r"by 12\.6 m/s²; allowed: up to 4 m/s²"):
        motion_of(Squat(name="a", duration_s=8.0, depth_m=0.16, frequency_hz=2.0))
    motion_of(Squat(name="a", duration_s=8.0, depth_m=0.16, frequency_hz=1.0))


def test_set_points_at_rest_carry_the_weight() -> None:
    """At rest kp·(q_des − q) = −Jᵀf, with f a quarter of the weight on each foot, as the stance is nearly symmetric."""
    experiment = EVERY[0]
    torque = experiment.kp_nm_per_rad * (motion_of(experiment).rest_rad - facts.DEFAULT_POSITION_RAD)
    height = 1e-3
    raised = np.asarray(foot_position_in_body_m(facts.DEFAULT_POSITION_RAD)) + np.array([0.0, 0.0, height])
    per_m = (joints_of_feet(raised, facts.DEFAULT_POSITION_RAD) - facts.DEFAULT_POSITION_RAD) / height
    # Virtual work: raising all four feet by dz against the ground takes the whole weight times dz.
    assert -(torque @ per_m) == pytest.approx(facts.TOTAL_MASS_KG * 9.81, rel=0.02)


def _simulated(experiment: JointExperiment) -> tuple[float, float, np.ndarray]:
    """Largest tilt (rad), largest torque (N·m) and the share of ticks with each foot on the ground."""
    script = joint_script(experiment)
    plant = Plant((), 1, PlantOptions(mjcf=MjcfOptions(timestep_s=0.0015, visuals=False), n_threads=1))
    asked = np.concatenate([np.zeros((50, facts.N_JOINTS)), script.motion.sampled(50.0)])
    tilt, torque, down = 0.0, 0.0, np.zeros(facts.N_LEGS)
    for tick in ClosedLoop(plant, script).run(lambda i: asked[i][None], schedule_by_messages(len(asked), 2)):
        if tick.index < 50:
            continue
        up = -float(projected_gravity(plant.world_from_body_wxyz)[0, 2])
        tilt = max(tilt, float(np.arccos(min(up, 1.0))))
        torque = max(torque, float(np.abs(plant.applied_torque_nm).max()))
        down += plant.foot_contact[0] / (len(asked) - 50)
    return tilt, torque, down


@pytest.mark.parametrize("experiment", EVERY, ids=lambda e: e.name)
def test_the_nominal_robot_stays_on_its_feet(experiment: JointExperiment) -> None:
    tilt, torque, down = _simulated(experiment)
    assert tilt < 0.15
    assert torque < experiment.torque_nm
    if isinstance(experiment, Sweep) and experiment.is_leg_lifted:
        assert down[0] < 0.7
        assert (down[1:] > 0.9).all()
    else:
        assert (down > 0.95).all()


def test_a_servo_that_is_held_fast_is_asked_for_no_more_than_the_torque() -> None:
    script = joint_script(Squat(name="a", duration_s=8.0, kp_nm_per_rad=200.0, torque_nm=40.0))
    stuck = facts.DEFAULT_POSITION_RAD - 1.0
    asked = 200.0 * (script.followed_rad(stuck, np.zeros(12)) - stuck)
    np.testing.assert_allclose(asked, 40.0)


def test_a_body_that_leans_goes_back_to_the_stand() -> None:
    """Whole up to 0.12 rad, a half at 0.16 rad, nothing from 0.2 rad on."""
    script = joint_script(Squat(name="a", duration_s=8.0, torque_nm=100.0))
    rest, offset = script.motion.rest_rad, np.full(12, 0.1)
    for lean_rad, share in ((0.0, 1.0), (0.12, 1.0), (0.16, 0.5), (0.2, 0.0), (1.0, 0.0)):
        half = 0.5 * lean_rad
        sensed = Sensed(
            position_rad=rest[None],
            velocity_rad_s=np.zeros((1, 12)),
            world_from_body_wxyz=np.array([[np.cos(half), np.sin(half), 0.0, 0.0]]),
            linear_vel_of_body_in_world_m_s=np.zeros((1, 3)),
            angular_vel_of_body_in_world_rad_s=np.zeros((1, 3)),
        )
        action = script.act(script.observe_many(sensed, offset[None], np.zeros((1, 12))))
        np.testing.assert_allclose(action[0], share * offset, atol=1e-6)
