"""Ground that leans and grass, in the plant: against MuJoCo's own, and what robots report on them."""

import numpy as np
import pytest

from spot_model.effects.ground import FootDrag, GroundSlope, foot_motion
from spot_model.plant.closed_loop import StartState, put_at, true_state
from spot_model.plant.plant import Plant, PlantOptions
from spot_model.robot import facts
from spot_model.robot.mjcf import MjcfOptions
from spot_model.robot.rotation import multiply_wxyz, projected_gravity, rotate_wxyz

RISE_RAD = 0.1
SHANKS = slice(4, None, 3)
UPRIGHT = np.array([[1.0, 0.0, 0.0, 0.0]])


def test_feet_are_held_back_against_their_velocity_and_only_where_they_are_low() -> None:
    plant = Plant([FootDrag(drag_n_s_per_m=7.0, height_m=0.05)])
    lifted = np.array(facts.DEFAULT_POSITION_RAD)
    lifted[[1, 2]] += (0.4, -0.6)
    turned = np.array([0.98, 0.02, -0.02, 0.2]) / np.linalg.norm([0.98, 0.02, -0.02, 0.2])
    plant.reset(joint_position_rad=lifted, joint_velocity_rad_s=1.0, world_from_body_wxyz=turned)
    plant.outside.act(0.0)
    pushed, velocity = plant.physics.live("xfrc_applied")[0, SHANKS], plant.foot_velocity_in_world_m_s[0]
    np.testing.assert_allclose(pushed[1:, :3], -7.0 * velocity[1:], atol=1e-9)
    assert not pushed[0].any()
    # At the foot, not at the middle of the lower leg.
    arm = plant.foot_position_in_world_m[0] - plant.physics.live("xipos")[0, SHANKS]
    np.testing.assert_allclose(pushed[:, 3:], np.cross(arm, pushed[:, :3]), atol=1e-6)


def test_a_load_cell_feels_what_holds_a_foot_back() -> None:
    loads = []
    for drag in (0.0, 20.0):
        options = PlantOptions(mjcf=MjcfOptions(timestep_s=0.001, link_torque_sensors=True))
        plant = Plant([FootDrag(drag_n_s_per_m=drag, height_m=0.5)], options=options)
        plant.reset(position_of_body_in_world_m=(0.0, 0.0, 2.0), linear_vel_of_body_in_world_m_s=(1.0, 0.0, 0.0))
        plant.advance(20)
        loads.append(plant.link_torque_nm[0, 1::3])
    # Each of four thighs holds its foot against some newtons, half a metre down, once it has been moved along.
    assert np.all(np.abs(loads[1] - loads[0]) > 1.0)


def test_a_robot_falls_down_the_slope_and_reports_its_attitude_against_the_vertical() -> None:
    plant = Plant([GroundSlope(rise_x_rad=RISE_RAD)])
    plant.reset(position_of_body_in_world_m=(0.0, 0.0, 3.0))
    plant.advance(20)
    down = plant.linear_vel_of_body_in_world_m_s[0] / (20 * plant.timestep_s)
    np.testing.assert_allclose(down, 9.81 * np.array([-np.sin(RISE_RAD), 0.0, -np.cos(RISE_RAD)]), atol=1e-6)
    for attitude in (plant.estimate.world_from_body_wxyz, true_state(plant).world_from_body_wxyz):
        # Its nose points up the slope: the vertical leans towards its tail.
        np.testing.assert_allclose(projected_gravity(attitude)[0], down / 9.81, atol=1e-6)
    np.testing.assert_allclose(plant.world_from_body_wxyz, UPRIGHT, atol=1e-6)


def test_stretches_of_a_run_follow_each_other() -> None:
    slopes = [GroundSlope(rise_x_rad=RISE_RAD, until_s=2.0), GroundSlope(rise_y_rad=-RISE_RAD, from_s=2.0, until_s=4.0)]
    plant = Plant(slopes)
    found = []
    for time_s in (0.0, 1.0, 2.0, 3.0, 5.0):
        plant.outside.act(time_s)
        found.append(plant.physics.gravity()[0, :2] / 9.81)
    steep = np.sin(RISE_RAD)
    expected = [(-steep, 0.0), (-steep, 0.0), (-0.5 * steep, 0.5 * steep), (0.0, steep), (0.0, 0.0)]
    np.testing.assert_allclose(found, expected, atol=2e-4)


def test_a_logged_start_is_put_onto_the_slope() -> None:
    plant = Plant([GroundSlope(rise_x_rad=RISE_RAD)])
    odom_from_ground = plant.outside.odom_from_ground_wxyz()
    reported = np.asarray(multiply_wxyz(odom_from_ground, np.array([[np.cos(0.4), 0.0, 0.0, np.sin(0.4)]])))
    velocity = np.asarray(rotate_wxyz(odom_from_ground, np.array([[0.8, 0.1, 0.0]])))
    start = StartState(
        facts.DEFAULT_POSITION_RAD, np.zeros(12), reported[0], velocity[0], np.zeros(3), np.zeros(12, dtype=np.float32)
    )
    level = Plant().foot_position_in_world_m[0, :, 2]
    put_at(plant, [start])
    np.testing.assert_allclose(plant.foot_position_in_world_m[0, :, 2], level, atol=1e-5)
    np.testing.assert_allclose(plant.linear_vel_of_body_in_world_m_s, [[0.8, 0.1, 0.0]], atol=1e-9)
    np.testing.assert_allclose(plant.estimate.world_from_body_wxyz, reported, atol=1e-9)


def test_effects_that_end_leave_no_force_and_no_lean() -> None:
    plant = Plant([GroundSlope(rise_y_rad=RISE_RAD), FootDrag(drag_n_s_per_m=10.0, height_m=0.5)])
    plant.reset(joint_velocity_rad_s=1.0)
    plant.advance()
    plant.outside.act(0.0)
    assert plant.physics.live("xfrc_applied").any()
    plant.change_effects([])
    assert not plant.physics.live("xfrc_applied").any()
    assert plant.physics.gravity()[0].tolist() == [0.0, 0.0, -9.81]
    assert plant.outside.odom_from_ground_wxyz() is None


def test_a_foot_moves_as_its_place_does() -> None:
    q, dt = np.array(facts.DEFAULT_POSITION_RAD)[None], 1e-6
    rates, linear = np.linspace(-1.0, 1.0, 12)[None], np.array([[0.5, -0.2, 0.1]])
    foot, _, velocity = foot_motion(linear, np.zeros((1, 3)), q, rates)
    later, _, _ = foot_motion(linear, np.zeros((1, 3)), q + dt * rates, rates)
    assert velocity - linear[:, None] == pytest.approx((later - foot) / dt, abs=1e-5)


def test_a_slope_without_an_end_is_laid_once(monkeypatch: pytest.MonkeyPatch) -> None:
    plants = [Plant([GroundSlope(rise_x_rad=RISE_RAD, until_s=until_s)]) for until_s in (np.inf, 1e5)]
    laid: list[object] = []
    surround = GroundSlope.surround
    monkeypatch.setattr(GroundSlope, "surround", lambda self, outside: laid.append(self) or surround(self, outside))
    for plant in plants:
        plant.advance(5)
    assert len(laid) == 5
    np.testing.assert_array_equal(plants[0].batch.state, plants[1].batch.state)
