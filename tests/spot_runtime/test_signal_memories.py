"""The arithmetic of the plausibility checks, computed a second way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spot_model.robot import facts
from spot_model.robot.state import ImuPacket, RobotState
from spot_runtime.control.safety.signals import bounds, ground, imu, motion, weight
from spot_runtime.control.safety.signals.legs import feet, foot_jacobians, ground_forces_n
from spot_runtime.control.safety.signals.window import Window, length, rotation_matrix, turned_rad, window_of
from tests.spot_runtime.walking_robot import WalkingRobot

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
ZERO = np.zeros(12)


def wxyz(rotation: Rotation) -> np.ndarray:
    return np.roll(rotation.as_quat(), 1)


def window(**changes: object) -> Window:
    """18 ms of a robot at rest whose last state differs by these."""
    still = {"position_rad": ZERO, "velocity_rad_s": ZERO, "odom_from_body_wxyz": LEVEL, "imu": ()}
    still |= {"linear_vel_of_body_in_odom_m_s": np.zeros(3), "angular_vel_of_body_in_odom_rad_s": np.zeros(3)}
    still |= {"foot_contact": np.ones(4, dtype=np.bool_)}
    states: list[RobotState] = [replace(WalkingRobot(noise=0.0).state(i), **still) for i in range(7)]
    states[-1] = replace(states[-1], **changes)
    found = window_of(states)
    assert found is not None
    return found


def test_rotations_are_those_of_another_library() -> None:
    rng = np.random.default_rng(7)
    for before, step in zip(Rotation.random(20, rng=rng), rng.uniform(-1.5, 1.5, (20, 3)), strict=True):
        after = Rotation.from_rotvec(step) * before
        np.testing.assert_allclose(rotation_matrix(wxyz(after)), after.as_matrix(), atol=1e-12)
        for sign in (1.0, -1.0):
            np.testing.assert_allclose(turned_rad(wxyz(before), sign * wxyz(after)), step, atol=1e-9)


def test_a_window_keeps_the_widest_of_the_turn_rates_and_counts_two_states_as_enough() -> None:
    seen = window(angular_vel_of_body_in_odom_rad_s=np.array([0.2, -0.5, 0.1]))
    assert seen.turn_rate_range_rad_s == pytest.approx(0.5)
    np.testing.assert_allclose(seen.turn_rad, 0.0015 * np.array([0.2, -0.5, 0.1]))
    assert window_of([WalkingRobot().state(0), WalkingRobot().state(1)]) is not None


def test_differences_of_motion_fade_and_add_up() -> None:
    before = motion.MotionMemory(
        slope_rad=np.full(12, 0.01),
        change_rad_s=np.full(12, -3.0),
        blur_rad=np.full(12, 0.02),
        turn_rad=np.array([0.01, 0.02, -0.03]),
        turn_change_rad_s=np.array([1.0, 0.0, -1.0]),
        turn_blur_rad=0.01,
    )
    seen = window(
        position_rad=np.full(12, 0.02),
        velocity_rad_s=np.full(12, 1.0),
        odom_from_body_wxyz=wxyz(Rotation.from_rotvec([0.0, 0.0, 0.05])),
        angular_vel_of_body_in_odom_rad_s=np.array([0.0, 0.0, 2.0]),
    )
    after = motion.after_window(before, seen)
    np.testing.assert_allclose(after.slope_rad, 0.01 * (1.0 - 0.018 / 0.2) + 0.02 - 0.0015)
    np.testing.assert_allclose(after.change_rad_s, -3.0 * 0.91 + 1.0)
    np.testing.assert_allclose(after.blur_rad, 0.02 * 0.91)
    fade = 1.0 - 0.018 / 0.5
    np.testing.assert_allclose(after.turn_rad, np.array([0.01, 0.02, -0.03]) * fade + [0.0, 0.0, 0.05 - 0.003])
    np.testing.assert_allclose(after.turn_change_rad_s, np.array([1.0, 0.0, -1.0]) * fade + [0.0, 0.0, 2.0])
    assert after.turn_blur_rad == pytest.approx(2.0 * bounds.TURN_BEND_S)
    # What lies in a hole between two states is known by half of it: 8 ms of 16 ms, times what the rates changed by.
    holed = motion.after_window(before, seen._replace(hole_s=0.016))
    longer = motion.after_window(motion.MotionMemory(), seen._replace(hole_s=0.016))
    np.testing.assert_allclose(longer.blur_rad, 1.0 * (bounds.SLOPE_BEND_S + 0.008))
    np.testing.assert_allclose(holed.blur_rad, 0.02 * 0.91)
    assert holed.turn_blur_rad == pytest.approx(2.0 * (bounds.TURN_BEND_S + 0.008))
    long = motion.after_window(before, seen._replace(duration_s=3.0))
    np.testing.assert_allclose(long.slope_rad, 0.02 - 0.0015)
    np.testing.assert_allclose(long.turn_rad, [0.0, 0.0, 0.05 - 0.003], atol=1e-12)


@pytest.mark.parametrize(("slope_rad", "speed_rad_s", "counted"), [(0.04, 0.0, 0), (0.0401, 0.0, 1), (0.05, 1.0, 0)])
def test_a_slope_counts_beyond_its_bound_which_grows_with_the_velocitys_range(
    slope_rad: float, speed_rad_s: float, counted: int
) -> None:
    travel_rad = 0.0015 * speed_rad_s
    seen = window(position_rad=np.full(12, slope_rad + travel_rad), velocity_rad_s=np.full(12, speed_rad_s))
    before = motion.MotionMemory(slope_windows=np.full(12, 3))
    assert set(motion.after_window(before, seen).slope_windows) == {4 * counted}


@pytest.mark.parametrize(("lag_s", "is_believed"), [(0.012, True), (0.0, True), (0.06, False)])
def test_a_lag_of_the_velocity_is_no_contradiction_however_quickly_the_joint_turns_round(
    lag_s: float, is_believed: bool
) -> None:
    """A knee that swings by 0.7 rad at 3 Hz passes 13 rad/s; 12 ms of lag are 0.16 rad, 60 ms are 0.8 rad."""
    memory, rate = motion.MotionMemory(), 2.0 * np.pi * 3.0
    robot, worst = WalkingRobot(noise=0.0), 0
    for start in range(0, 300, 6):
        times = [0.003 * (start + i) for i in range(7)]
        states = [
            replace(
                robot.state(start + i),
                position_rad=np.full(12, 0.7 * np.sin(rate * t)),
                velocity_rad_s=np.full(12, 0.7 * rate * np.cos(rate * (t - lag_s))),
            )
            for i, t in enumerate(times)
        ]
        seen = window_of(states)
        assert seen is not None
        memory = motion.after_window(memory, seen)
        worst = max(worst, int(memory.slope_windows.max()))
    assert (worst < bounds.SLOPE_WINDOWS) == is_believed


@pytest.mark.parametrize(("turn_rad", "rate_rad_s", "counted"), [(0.0599, 0.0, 0), (0.061, 0.0, 1), (0.08, 2.0, 0)])
def test_a_turn_counts_beyond_its_bound(turn_rad: float, rate_rad_s: float, counted: int) -> None:
    seen = window(
        odom_from_body_wxyz=wxyz(Rotation.from_rotvec([0.0, turn_rad + 0.0015 * rate_rad_s, 0.0])),
        angular_vel_of_body_in_odom_rad_s=np.array([0.0, rate_rad_s, 0.0]),
    )
    assert motion.after_window(motion.MotionMemory(turn_windows=3), seen).turn_windows == 4 * counted


def test_a_turn_at_its_bound_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = window(odom_from_body_wxyz=wxyz(Rotation.from_rotvec([0.0, 0.05, 0.0])))
    turned = length(turned_rad(LEVEL, seen.last.odom_from_body_wxyz))
    for bound_rad, counted in ((turned, 0), (float(np.nextafter(turned, 0.0)), 1)):
        monkeypatch.setattr(bounds, "TURN_RAD", bound_rad)
        assert motion.after_window(motion.MotionMemory(), seen).turn_windows == counted


def test_what_feet_did_fades_and_adds_up() -> None:
    before = ground.GroundMemory(0.4, 0.2, travel_m=0.3, airborne_s=0.1, has_touched=False)
    fade = 1.0 - 0.018 / 0.5
    slow = ground.after_window(before, window(linear_vel_of_body_in_odom_m_s=np.array([0.6, 0.0, 0.8])))
    assert slow.touching_s == pytest.approx(0.4 * fade + 0.018)
    assert slow.sliding_s == pytest.approx(0.2 * fade)
    assert slow.travel_m == pytest.approx(0.3 + 1.0 * 0.018)
    assert slow.airborne_s == 0.0
    assert slow.has_touched
    fast = ground.after_window(before, window(linear_vel_of_body_in_odom_m_s=np.array([1.2, 0.0, 0.0])))
    assert fast.speed_m_s == pytest.approx(1.2)
    assert fast.sliding_s == pytest.approx(0.2 * fade + 0.018)
    at_bound = ground.after_window(before, window(linear_vel_of_body_in_odom_m_s=np.array([1.0, 0.0, 0.0])))
    assert at_bound.sliding_s == pytest.approx(0.2 * fade)
    flying = ground.after_window(before, window(foot_contact=np.zeros(4, dtype=np.bool_)))
    assert (flying.travel_m, flying.speed_m_s, flying.has_touched) == (0.0, 0.0, False)
    assert flying.airborne_s == pytest.approx(0.118)
    forgotten = ground.after_window(before, window()._replace(duration_s=1.0))
    assert (forgotten.touching_s, forgotten.sliding_s) == (1.0, 0.0)


def test_sliding_is_a_share_of_time_once_half_the_memory_is_filled() -> None:
    half = 0.5 * bounds.FOOT_MEMORY_S
    assert ground.GroundMemory(half, 0.1).sliding_share == pytest.approx(0.1 / half)
    assert ground.GroundMemory(0.999 * half, 0.1).sliding_share == 0.0


def test_what_the_inertial_unit_felt_fades_and_adds_up() -> None:
    packet = ImuPacket(
        robot_stamp_ns=0,
        acceleration_of_imu_in_link_m_s2=np.array([1.0, 2.0, 9.0]),
        angular_vel_of_link_in_link_rad_s=np.array([0.0, 0.0, 3.0]),
        odom_from_link_wxyz=wxyz(Rotation.from_rotvec([0.3, 0.0, 0.0])),
    )
    before = imu.ImuMemory(np.array([0.1, 0.2, 4.0]), 0.5, 2, 3, has_reported=True)
    seen = window(imu=(packet,), linear_vel_of_body_in_odom_m_s=np.array([0.01, 0.0, 0.02]))
    after = imu.after_window(before, seen)
    fade = 1.0 - 0.018 / 1.0
    felt = np.array([0.1, 0.2, 4.0]) * fade + np.array([1.0, 2.0, 9.0]) * 0.018 - [0.01, 0.0, 0.02]
    np.testing.assert_allclose(after.force_m_s2, felt)
    assert after.felt_s == pytest.approx(0.5 * fade + 0.018)
    assert (after.angle_windows, after.turn_rate_windows) == (3, 4)
    assert imu.after_window(imu.ImuMemory(), window()) == imu.ImuMemory()
    assert imu.after_window(before, window()) == before._replace(silent_windows=1)
    assert imu.after_window(imu.ImuMemory(), seen).has_reported
    assert imu.after_window(before._replace(silent_windows=5), seen).silent_windows == 0
    broken = window(imu=(replace(packet, odom_from_link_wxyz=np.full(4, np.nan)),))
    assert imu.after_window(before._replace(silent_windows=5), broken).silent_windows == 0
    assert imu.after_window(imu.ImuMemory(), broken).has_reported
    assert imu.after_window(imu.ImuMemory(), seen._replace(hole_s=1.01 * bounds.GRAVITY_HOLE_S)).has_reported
    holed = imu.after_window(before, seen._replace(hole_s=1.01 * bounds.GRAVITY_HOLE_S))
    assert (holed.felt_s, holed.angle_windows, holed.turn_rate_windows) == (0.5, 3, 4)
    assert holed.force_m_s2 is before.force_m_s2
    assert imu.after_window(before, seen._replace(hole_s=bounds.GRAVITY_HOLE_S)).felt_s > 0.5
    forgotten = imu.after_window(before, seen._replace(duration_s=2.0))
    assert forgotten.felt_s == pytest.approx(2.0)


def test_a_tilt_is_told_once_enough_is_felt_and_gravity_is_there() -> None:
    quarter = 0.25 * bounds.GRAVITY_MEMORY_S
    force = 9.81 * quarter * np.array([np.sin(0.4), 0.0, np.cos(0.4)])
    assert imu.ImuMemory(force, quarter).tilt_error_rad == pytest.approx(0.4)
    assert imu.ImuMemory(force, 0.999 * quarter).tilt_error_rad == 0.0
    least = bounds.GRAVITY_LEAST_M_S2 * quarter * np.array([0.0, 1.0, 0.0])
    assert imu.ImuMemory(least, quarter).tilt_error_rad == pytest.approx(np.pi / 2.0)
    assert imu.ImuMemory(0.999 * least, quarter).tilt_error_rad == 0.0


def test_an_inertial_unit_that_reports_what_is_no_number_is_counted_and_leaves_the_memory_good() -> None:
    good = ImuPacket(0, np.array([0.0, 0.0, 9.81]), np.zeros(3), LEVEL)
    before = imu.ImuMemory(np.array([0.1, 0.2, 4.0]), 0.5, 2, 3, 1, has_reported=True)
    for changes in (
        {"acceleration_of_imu_in_link_m_s2": np.array([0.0, np.nan, 9.81])},
        {"angular_vel_of_link_in_link_rad_s": np.array([0.0, 0.0, np.inf])},
        {"odom_from_link_wxyz": np.full(4, np.nan)},
    ):
        after = imu.after_window(before, window(imu=(good, replace(good, **changes))))
        assert after == before._replace(unknown_windows=2)
    assert imu.after_window(before, window(imu=(good,))).unknown_windows == 0


# Weight ---------------------------------------------------------------------------------------------------------------

WEIGHT_N = 31.60 * 9.81


def carrying(shares: list[float]) -> np.ndarray:
    """Loads by which the ground pushes each foot up by this share of the weight: -Jᵀ·f, J by finite differences."""
    loads = []
    for leg, share in enumerate(shares):
        rises = []
        for joint in range(3 * leg, 3 * leg + 3):
            step = np.zeros(12)
            step[joint] = 1e-6
            rise = (
                feet(facts.DEFAULT_POSITION_RAD + step, ZERO).position_m
                - feet(facts.DEFAULT_POSITION_RAD - step, ZERO).position_m
            )
            rises.append(rise[leg, 2] / 2e-6)
        loads += [-share * WEIGHT_N * rise for rise in rises]
    return np.array(loads)


def standing(shares: list[float]) -> Window:
    return window(position_rad=facts.DEFAULT_POSITION_RAD, load_nm=carrying(shares))


def test_what_legs_carry_fades_and_adds_up() -> None:
    before = weight.WeightMemory(np.array([10.0, 20.0, 30.0, 40.0]), 3.0, 0.9)
    seen = standing([0.1, 0.2, 0.3, 0.4])
    after = weight.after_window(before, seen)
    fade = 1.0 - 0.018 / 1.0
    pushed = np.array([10.0, 20.0, 30.0, 40.0]) * fade + np.array([0.1, 0.2, 0.3, 0.4]) * WEIGHT_N * 0.018
    np.testing.assert_allclose(after.pushed_n_s, pushed, rtol=1e-4)
    assert after.gained_n_s == pytest.approx(3.0 * fade)
    assert after.felt_s == pytest.approx(0.9 * fade + 0.018)
    assert after.has_loads
    rising = weight.after_window(before, window(linear_vel_of_body_in_odom_m_s=np.array([5.0, 5.0, 0.2]), load_nm=ZERO))
    assert rising.gained_n_s == pytest.approx(3.0 * fade + 31.60 * 0.2, rel=1e-3)
    assert not rising.has_loads
    assert weight.after_window(before, seen._replace(duration_s=2.0)).felt_s == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("shares", "gained_n_s", "is_wrong"),
    [
        ([0.25, 0.25, 0.25, 0.25], 0.0, False),
        ([0.5, 0.5, -0.11, -0.11], 0.0, False),
        ([0.5, 0.5, 0.5, -0.12], 0.0, True),
        ([0.08, 0.08, 0.08, 0.05], 0.0, True),
        ([0.08, 0.08, 0.08, 0.07], 0.0, False),
        ([0.7, 0.7, 0.7, 0.89], 0.0, False),
        ([0.7, 0.7, 0.7, 0.91], 0.0, True),
        ([-0.25, -0.25, -0.25, -0.25], 0.0, True),
        ([0.0, 0.0, 0.0, 0.0], -1.0 * WEIGHT_N, False),  # it falls freely
        ([0.08, 0.08, 0.08, 0.07], 0.1 * WEIGHT_N, True),
        ([0.1, 0.1, 0.1, 0.1], 0.15 * WEIGHT_N, True),
    ],
)
def test_loads_that_do_not_carry_the_robot(shares: list[float], gained_n_s: float, is_wrong: bool) -> None:
    memory = weight.WeightMemory(np.array(shares) * bounds.WEIGHT_N, gained_n_s, 1.0, has_loads=True)
    assert memory.is_wrong == is_wrong
    assert not memory._replace(has_loads=False).is_wrong
    short = weight.WeightMemory(0.75 * np.array(shares) * bounds.WEIGHT_N, 0.75 * gained_n_s, 0.75, has_loads=True)
    assert short.is_wrong == is_wrong
    assert not short._replace(felt_s=0.749).is_wrong
    np.testing.assert_allclose(short.legs_share, shares)


def test_a_share_at_its_bound_is_right(monkeypatch: pytest.MonkeyPatch) -> None:
    memory = weight.WeightMemory(np.array([0.3, 0.4, 0.5, -0.1]) * WEIGHT_N, 0.0, 1.0, has_loads=True)
    legs_share = memory.legs_share
    for name, value, towards in (
        ("PULL_SHARE", -float(legs_share[3]), 0.0),
        ("CARRIED_LEAST", float(legs_share.sum()), 9.0),
        ("CARRIED_MOST", float(legs_share.sum()), 0.0),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(bounds, name, value)
            assert not memory.is_wrong
            patch.setattr(bounds, name, float(np.nextafter(value, towards)))
            assert memory.is_wrong


def test_one_load_tells_that_loads_are_reported_and_all_fades_within_the_memory(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(bounds, "WEIGHT_MEMORY_S", 2.0)
    after = weight.after_window(weight.WeightMemory(felt_s=1.0), window(load_nm=1.0 * (np.arange(12) == 0)))
    assert after.has_loads
    assert after.felt_s == pytest.approx(1.0 - 0.009 + 0.018)


def pressing(forces_n: list[list[float]]) -> Window:
    """A robot that stands, whose loads balance these forces of the ground on its feet."""
    _, jacobians = foot_jacobians(facts.DEFAULT_POSITION_RAD)
    loads = -np.einsum("lij,li->lj", jacobians, np.array(forces_n)).ravel()
    return window(position_rad=facts.DEFAULT_POSITION_RAD, load_nm=loads)


QUARTER_N = 0.25 * WEIGHT_N


@pytest.mark.parametrize(
    ("foot", "is_wrong"),
    [
        ([0.0, 0.0, QUARTER_N], False),
        ([0.99 * QUARTER_N, 0.0, QUARTER_N], False),
        ([1.01 * QUARTER_N, 0.0, QUARTER_N], True),
        ([0.0, -1.01 * QUARTER_N, QUARTER_N], True),
        ([0.72 * QUARTER_N, 0.72 * QUARTER_N, QUARTER_N], True),
        ([1.1 * 0.099 * WEIGHT_N, 0.0, 0.099 * WEIGHT_N], False),
        ([1.1 * 0.101 * WEIGHT_N, 0.0, 0.101 * WEIGHT_N], True),
    ],
)
def test_the_feet_of_a_robot_that_stands_press_down(foot: list[float], is_wrong: bool) -> None:
    others = [[0.0, 0.0, QUARTER_N]] * 3
    assert weight.is_burden_wrong(pressing([foot, *others])) is is_wrong
    assert weight.is_burden_wrong(pressing([*others, foot])) is is_wrong


def test_loads_of_a_robot_that_stands_carry_it_unless_none_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    standing_ = pressing([[0.0, 0.0, QUARTER_N]] * 4)
    turned = np.where(np.arange(12) == 0, 0.0, -standing_.last.load_nm)
    assert weight.is_burden_wrong(window(position_rad=facts.DEFAULT_POSITION_RAD, load_nm=turned)) is True
    assert weight.is_burden_wrong(window(position_rad=facts.DEFAULT_POSITION_RAD, load_nm=ZERO)) is False
    forces = ground_forces_n(standing_.last.position_rad, standing_.last.load_nm)
    share = float((forces @ standing_.odom_from_body[2]).sum()) / bounds.WEIGHT_N
    for name, towards in (("CARRIED_LEAST", 9.0), ("CARRIED_MOST", 0.0)):
        with monkeypatch.context() as patch:
            patch.setattr(bounds, name, share)
            assert not weight.is_burden_wrong(standing_)
            patch.setattr(bounds, name, float(np.nextafter(share, towards)))
            assert weight.is_burden_wrong(standing_)
