"""The robot walks by itself: velocities are followed, goals reached, stops are stops, feet are placed."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fake_robot.network.requests import (
    PathPlan,
    PathPoint,
    StandPose,
    Velocity,
    VelocityPlan,
    WalkLimits,
    WalkProgress,
)
from fake_robot.network.status import EstopLevel, Mode, MotorPower, StanceProgress
from fake_robot.robot.modes import MotionRefusedError
from fake_robot.robot.motion.stance import load_shares
from fake_robot.robot.motion.steering import GroundPose, slewed, steer

NS = 1_000_000_000
FAST = ((-1.6, -1.6, -2.0), (1.6, 1.6, 2.0))


def limits(driver: Any, seconds: float, pose: StandPose = StandPose()) -> WalkLimits:  # noqa: B008 - frozen
    return WalkLimits(driver.robot.clock.now_ns() + round(seconds * NS), *FAST, pose)


def walk(driver: Any, velocity: Velocity, seconds: float = 60.0, **keywords: Any) -> None:
    driver.robot.walk(VelocityPlan(velocity, True, (4.0, 4.0, 2.0), limits(driver, seconds, **keywords)))


def place(driver: Any) -> tuple[float, float, float]:
    snapshot = driver.robot.snapshot()
    x, y, _ = snapshot.position_of_body_in_odom_m.tolist()
    w, a, b, c = snapshot.odom_from_body_wxyz.tolist()
    return x, y, math.atan2(2 * (w * c + a * b), 1 - 2 * (b * b + c * c))


def go(driver: Any, ahead_m: float, left_m: float, turn_rad: float, seconds: float = 30.0) -> PathPoint:
    x, y, yaw = place(driver)
    cos, sin = math.cos(yaw), math.sin(yaw)
    goal = PathPoint(x + cos * ahead_m - sin * left_m, y + sin * ahead_m + cos * left_m, yaw + turn_rad)
    driver.robot.walk(PathPlan((goal,), limits(driver, seconds)))
    return goal


def feet_in_odom_m(driver: Any) -> Any:
    x, y, yaw = place(driver)
    cos, sin = math.cos(yaw), math.sin(yaw)
    return driver.robot.snapshot().foot_position_in_body_m[:, :2] @ np.array([[cos, sin], [-sin, cos]]) + (x, y)


def run_until_standing(driver: Any, seconds: float = 30.0) -> None:
    for _ in range(round(seconds / 0.2)):
        driver.run(0.2)
        if driver.robot.snapshot().mode is Mode.STANDING:
            return
    pytest.fail(f"still {driver.robot.snapshot().mode} after {seconds} s")


@pytest.mark.parametrize("velocity", [(0.6, 0.0, 0.0), (-0.4, 0.0, 0.0), (0.0, 0.3, 0.0), (0.0, 0.0, 0.6)])
def test_a_velocity_is_followed_until_its_end_and_the_robot_stands_again(
    standing: Callable[..., Any], velocity: Velocity
) -> None:
    driver = standing()
    walk(driver, velocity, seconds=5.0)
    driver.run(2.0)
    x, y, yaw = place(driver)
    driver.run(2.0)
    x2, y2, yaw2 = place(driver)
    cos, sin = math.cos(yaw), math.sin(yaw)
    moved = ((x2 - x) * cos + (y2 - y) * sin, (y2 - y) * cos - (x2 - x) * sin, math.remainder(yaw2 - yaw, math.tau))
    main = int(np.argmax(np.abs(velocity)))
    assert moved[main] / 2.0 == pytest.approx(velocity[main], rel=0.35)
    run_until_standing(driver)
    assert driver.robot.snapshot().walk_progress is WalkProgress.TIMED_OUT
    assert not driver.robot.snapshot().behavior_faults


def test_the_same_walk_is_the_same_bit_for_bit(standing: Callable[..., Any]) -> None:
    ends = []
    for _ in range(2):
        driver = standing()
        walk(driver, (0.5, 0.0, 0.3))
        driver.run(1.5)
        ends.append(driver.robot.truth().joint_position_rad)
    np.testing.assert_array_equal(*ends)


@pytest.mark.parametrize("way", [(1.0, 0.0, 0.0), (0.0, -0.6, 0.0), (0.3, 0.2, 1.2), (1.65, -0.23, 1.33)])
def test_a_goal_is_reached(standing: Callable[..., Any], way: tuple[float, float, float]) -> None:
    driver = standing()
    goal = go(driver, *way)
    run_until_standing(driver)
    x, y, yaw = place(driver)
    assert driver.robot.snapshot().walk_progress is WalkProgress.ARRIVED
    assert math.hypot(goal.x_m - x, goal.y_m - y) < 0.15
    assert abs(math.remainder(goal.yaw_rad - yaw, math.tau)) < 0.15


def test_a_command_right_after_a_stop_moves_the_robot_at_once(standing: Callable[..., Any]) -> None:
    driver = standing()
    walk(driver, (0.5, 0.0, 0.0), seconds=0.6)
    while driver.robot.snapshot().mode is Mode.WALKING:
        driver.run(0.03)
    assert driver.robot.snapshot().mode is Mode.STANDING_UP
    x, y, yaw = place(driver)
    walk(driver, (-0.5, 0.0, 0.0), seconds=0.6)
    assert driver.robot.snapshot().mode is Mode.WALKING
    run_until_standing(driver)
    x2, y2, _ = place(driver)
    assert (x2 - x) * math.cos(yaw) + (y2 - y) * math.sin(yaw) < -0.12


def test_a_robot_that_sits_stands_up_first(make: Callable[..., Any]) -> None:
    driver = make()
    driver.robot.power_on()
    driver.run(2.1)
    walk(driver, (0.5, 0.0, 0.0))
    driver.run(0.5)
    assert driver.robot.snapshot().mode is Mode.STANDING_UP
    driver.run(4.0)
    assert driver.robot.snapshot().mode is Mode.WALKING


@pytest.mark.parametrize(("verb", "mode"), [("sit", Mode.SITTING), ("stop_motion", Mode.STANDING)])
def test_a_walk_comes_to_a_stop_before_anything_else(standing: Callable[..., Any], verb: str, mode: Mode) -> None:
    driver = standing()
    walk(driver, (1.0, 0.0, 0.0))
    driver.run(2.5)
    getattr(driver.robot, verb)()
    driver.run(6.0)
    assert driver.robot.snapshot().mode is mode
    assert not driver.robot.snapshot().behavior_faults


def test_safe_power_off_ends_a_walk_and_cuts_power(standing: Callable[..., Any]) -> None:
    driver = standing()
    walk(driver, (0.8, 0.0, 0.0))
    driver.run(2.0)
    driver.robot.safe_power_off()
    driver.run(7.0)
    assert driver.robot.snapshot().motor_power is MotorPower.OFF


@pytest.mark.parametrize("level", [EstopLevel.SETTLE_THEN_CUT, EstopLevel.CUT])
def test_the_estop_ends_a_walk(standing: Callable[..., Any], level: EstopLevel) -> None:
    driver = standing()
    walk(driver, (0.8, 0.0, 0.0))
    driver.run(2.0)
    driver.robot.set_estop_level(level)
    driver.run(6.0)
    assert driver.robot.snapshot().motor_power is MotorPower.OFF
    with pytest.raises(MotionRefusedError):
        walk(driver, (0.1, 0.0, 0.0))


@pytest.mark.parametrize("height_m", [-0.06, 0.05])
def test_the_body_is_held_higher_or_lower_while_walking(standing: Callable[..., Any], height_m: float) -> None:
    heights = []
    for pose in (StandPose(), StandPose(height_m=height_m)):
        driver = standing()
        walk(driver, (0.4, 0.0, 0.0), pose=pose)
        driver.run(2.5)
        samples = []
        for _ in range(20):
            driver.run(0.05)
            samples.append(driver.robot.truth().body_height_m)
        heights.append(float(np.mean(samples)))
    assert heights[1] - heights[0] == pytest.approx(height_m, abs=0.03)


def test_feet_step_to_their_places(standing: Callable[..., Any]) -> None:
    driver = standing()
    goal = feet_in_odom_m(driver) + np.array([[0.06, 0.04], [0.03, -0.04], [-0.04, 0.04], [0.0, -0.06]])
    driver.robot.place_feet(goal, 0.05)
    run_until_standing(driver)
    assert driver.robot.snapshot().stance_progress is StanceProgress.REACHED
    assert np.linalg.norm(feet_in_odom_m(driver) - goal, axis=1).max() < 0.07
    driver.robot.place_feet(goal + 2.0, 0.05)
    driver.run(0.1)
    assert driver.robot.snapshot().stance_progress is StanceProgress.TOO_FAR
    assert driver.robot.snapshot().mode is Mode.STANDING


def test_a_stance_that_is_asked_for_again_and_again_is_reached_and_kept(standing: Callable[..., Any]) -> None:
    """As the vendor's stance example, which sends it every second for ever."""
    driver = standing()
    x, y, _ = driver.robot.snapshot().position_of_body_in_odom_m
    goal = np.add([[0.35, 0.18], [0.35, -0.18], [-0.35, 0.18], [-0.35, -0.18]], (x + 0.05, y + 0.02))
    for _ in range(25):
        driver.robot.place_feet(goal, 0.02)
        driver.run(1.0)
    assert driver.robot.snapshot().mode is Mode.STANDING
    assert driver.robot.snapshot().stance_progress is StanceProgress.REACHED
    assert np.linalg.norm(feet_in_odom_m(driver) - goal, axis=1).max() < 0.02
    assert driver.robot.truth().body_height_m == pytest.approx(0.52, abs=0.015)


def test_shares_of_the_weight_balance_it() -> None:
    feet = np.array([[0.3, 0.2, -0.5], [0.3, -0.2, -0.5], [-0.3, 0.2, -0.5], [-0.3, -0.2, -0.5]]) - (0.05, 0.03, 0.0)
    for without in (None, 0, 3):
        share = load_shares(feet, without=without)
        assert share.sum() == pytest.approx(1.0)
        assert share @ feet[:, 0] == pytest.approx(-0.026)
        assert share @ feet[:, 1] == pytest.approx(0.0, abs=1e-12)
        assert without is None or share[without] == 0.0


speeds = st.floats(-3.0, 3.0)


@given(st.tuples(speeds, speeds, speeds), st.floats(-4.0, 4.0))
def test_a_velocity_of_the_world_means_the_same_whatever_way_the_body_looks(velocity: Velocity, yaw_rad: float) -> None:
    wide = WalkLimits(0, (-9.0, -9.0, -9.0), (9.0, 9.0, 9.0))
    told = steer(VelocityPlan(velocity, False, (1.0, 1.0, 1.0), wide), 0.0, GroundPose(0.0, 0.0, yaw_rad)).velocity
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    assert cos * told[0] - sin * told[1] == pytest.approx(velocity[0], abs=1e-9)
    assert sin * told[0] + cos * told[1] == pytest.approx(velocity[1], abs=1e-9)


@given(st.tuples(speeds, speeds, speeds), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-3.0, 3.0))
def test_a_walk_never_exceeds_its_limits(velocity: Velocity, x_m: float, y_m: float, yaw_rad: float) -> None:
    narrow = WalkLimits(0, (-0.2, -0.3, -0.4), (0.5, 0.6, 0.7))
    plans = [VelocityPlan(velocity, True, (1.0,) * 3, narrow), PathPlan((PathPoint(1.0, -1.0, 0.5),), narrow)]
    for plan in plans:
        told = steer(plan, 1.0, GroundPose(x_m, y_m, yaw_rad)).velocity
        for value, low, high in zip(told, narrow.low, narrow.high, strict=True):
            assert low - 1e-12 <= value <= high + 1e-12


def test_a_path_with_times_is_followed_in_time() -> None:
    wide = WalkLimits(0, *FAST)
    path = PathPlan((PathPoint(0.0, 0.0, 0.0, 0.0), PathPoint(2.0, 0.0, 0.0, 4.0)), wide)
    # One second on, the target is 0.5 m ahead of a robot that has not moved: 1.2/s times that.
    assert steer(path, 1.0, GroundPose(0.0, 0.0, 0.0)).velocity[0] == pytest.approx(0.6)
    assert not steer(path, 1.0, GroundPose(2.0, 0.0, 0.0)).is_there
    assert steer(path, 4.0, GroundPose(2.0, 0.0, 0.0)).is_there


def test_a_velocity_changes_no_faster_than_its_slew_limit() -> None:
    assert slewed((0.0, 0.0, 0.0), (1.0, -1.0, 0.01), (2.0, 4.0, 1.0), 0.02) == pytest.approx((0.04, -0.08, 0.01))
