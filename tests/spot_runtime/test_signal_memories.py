"""The arithmetic of the plausibility checks, computed a second way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spot_model.robot import facts
from spot_model.robot.state import ImuPacket, RobotState
from spot_runtime.control.safety.signals import bounds, ground, motion
from spot_runtime.control.safety.signals.legs import feet, ground_forces_n
from spot_runtime.control.safety.signals.window import Window, length, rotation_matrix, turned_rad, window_of
from tests.spot_runtime.walking_robot import WalkingRobot

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
ZERO = np.zeros(12)


def wxyz(rotation: Rotation) -> np.ndarray:
    return np.roll(rotation.as_quat(), 1)


def states_at_rest() -> list[RobotState]:
    still = {"position_rad": ZERO, "velocity_rad_s": ZERO, "odom_from_body_wxyz": LEVEL, "imu": ()}
    still |= {"linear_vel_of_body_in_odom_m_s": np.zeros(3), "angular_vel_of_body_in_odom_rad_s": np.zeros(3)}
    still |= {"foot_contact": np.ones(4, dtype=np.bool_)}
    return [replace(WalkingRobot(noise=0.0).state(i), **still) for i in range(7)]


AT_REST = states_at_rest()


def window(**changes: object) -> Window:
    """18 ms of a robot at rest whose last state differs by these."""
    *states, last = AT_REST
    found = window_of([*states, replace(last, **changes)])
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
        slope_rad=np.full((2, 12), 0.01),
        change_rad_s=np.full((2, 12), -3.0),
        blur_rad=np.full((2, 12), 0.02),
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
    fades = np.repeat([[0.91], [0.982]], 12, axis=1)
    np.testing.assert_allclose(after.slope_rad, 0.01 * fades + 0.02 - 0.0015)
    np.testing.assert_allclose(after.change_rad_s, -3.0 * fades + 1.0)
    np.testing.assert_allclose(after.blur_rad, 0.02 * fades)
    fade = 1.0 - 0.018 / 0.5
    np.testing.assert_allclose(after.turn_rad, np.array([0.01, 0.02, -0.03]) * fade + [0.0, 0.0, 0.05 - 0.003])
    np.testing.assert_allclose(after.turn_change_rad_s, np.array([1.0, 0.0, -1.0]) * fade + [0.0, 0.0, 2.0])
    assert after.turn_blur_rad == pytest.approx(2.0 * bounds.TURN_BEND_S)
    # What lies in a hole between two states is known by half of it: 8 ms of 16 ms, times what the rates changed by.
    holed = motion.after_window(before, seen._replace(hole_s=0.016))
    longer = motion.after_window(motion.MotionMemory(), seen._replace(hole_s=0.016))
    np.testing.assert_allclose(longer.blur_rad, 1.0 * (bounds.SLOPE_BEND_S + 0.008))
    np.testing.assert_allclose(holed.blur_rad, 0.02 * fades)
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


@pytest.mark.parametrize(("drift_rad_s", "within_s"), [(0.11, None), (0.15, 2.0), (-0.19, 1.1), (0.3, 0.35)])
def test_an_encoder_that_drifts_is_told_though_it_hides_within_a_stride(
    drift_rad_s: float, within_s: float | None
) -> None:
    """A velocity biased by 0.1 rad/s is no contradiction for ever; a drift of twice that is none within 0.2 s."""
    memory, told_s = motion.MotionMemory(), None
    for index in range(1, 500):
        memory = motion.after_window(memory, window(position_rad=np.full(12, 0.018 * drift_rad_s)))
        if told_s is None and (memory.slope_windows >= bounds.SLOPE_WINDOWS).all():
            told_s = 0.018 * index
    assert (told_s is None) if within_s is None else (told_s is not None and told_s < within_s)


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
    before = ground.GroundMemory(0.4, 0.2, 0.1, travel_m=0.3, slid_m=0.2, airborne_s=0.1, has_touched=False)
    fade, travel_fade = 1.0 - 0.018 / 0.5, 1.0 - 0.018 * 0.4 / bounds.TRAVEL_M
    slow = ground.after_window(before, window(linear_vel_of_body_in_odom_m_s=np.array([0.6, 0.0, 0.8])), None)
    assert slow.touching_s == pytest.approx(0.4 * fade + 0.018)
    assert slow.sliding_s == pytest.approx(0.2 * fade)
    assert slow.unloaded_s == pytest.approx(0.1 * fade)
    assert slow.travel_m == pytest.approx(0.3 * travel_fade + 1.0 * 0.018)
    assert slow.slid_m == pytest.approx(0.2 * travel_fade + 1.0 * 0.018)
    assert slow.airborne_s == 0.0
    assert slow.has_touched
    fast = ground.after_window(before, window(linear_vel_of_body_in_odom_m_s=np.array([1.2, 0.0, 0.0])), None)
    assert fast.speed_m_s == pytest.approx(1.2)
    assert fast.sliding_s == pytest.approx(0.2 * fade + 0.018)
    at_bound = ground.after_window(before, window(linear_vel_of_body_in_odom_m_s=np.array([1.0, 0.0, 0.0])), None)
    assert at_bound.sliding_s == pytest.approx(0.2 * fade)
    flying = ground.after_window(before, window(foot_contact=np.zeros(4, dtype=np.bool_)), None)
    assert (flying.travel_m, flying.slid_m, flying.speed_m_s, flying.has_touched) == (0.0, 0.0, 0.0, False)
    assert flying.airborne_s == pytest.approx(0.118)
    forgotten = ground.after_window(before, window()._replace(duration_s=1.0), None)
    assert (forgotten.touching_s, forgotten.sliding_s, forgotten.unloaded_s) == (1.0, 0.0, 0.0)
    long = ground.after_window(before, window()._replace(duration_s=4.0), None)
    assert (long.travel_m, long.slid_m) == (0.0, 0.0)


def test_shares_of_time_are_told_once_half_the_memory_is_filled() -> None:
    half = 0.5 * bounds.FOOT_MEMORY_S
    memory = ground.GroundMemory(half, 0.1, 0.05)
    assert (memory.sliding_share, memory.unloaded_share) == pytest.approx((0.1 / half, 0.05 / half))
    short = memory._replace(touching_s=0.999 * half)
    assert (short.sliding_share, short.unloaded_share) == (0.0, 0.0)


@pytest.mark.parametrize(("share", "carries"), [(0.099, False), (0.101, True), (-0.3, False)])
def test_a_foot_in_contact_that_carries_nothing_is_not_believed(share: float, carries: bool) -> None:
    """One foot touches; the body moves too fast for a foot that stands."""
    only = np.array([False, False, True, False])
    seen = window(linear_vel_of_body_in_odom_m_s=np.array([1.2, 0.0, 0.0]), foot_contact=only)
    seen = seen._replace(first=replace(seen.first, foot_contact=only))
    carried_n = np.where(only, share, 0.5) * bounds.WEIGHT_N
    after = ground.after_window(ground.GroundMemory(), seen, carried_n)
    assert after.touching_s == pytest.approx(0.018)
    assert (after.sliding_s, after.unloaded_s) == pytest.approx((0.018, 0.0) if carries else (0.0, 0.018))
    assert after.speed_m_s == pytest.approx(1.2 if carries else 0.0)
    # Where loads tell nothing, contacts are believed.
    assert ground.after_window(ground.GroundMemory(), seen, None).sliding_s == pytest.approx(0.018)


def test_the_foot_that_carries_exactly_a_tenth_is_not_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounds, "WEIGHT_N", 300.0)
    monkeypatch.setattr(bounds, "FOOT_LEAST_SHARE", 0.125)
    for carried_n, unloaded_s in ((37.5, 0.018), (np.nextafter(37.5, 99.0), 0.0)):
        after = ground.after_window(ground.GroundMemory(), window(), np.full(4, carried_n))
        assert after.unloaded_s == pytest.approx(unloaded_s)


@pytest.mark.parametrize("is_touching", [True, False])
def test_the_path_of_the_slowest_foot_counts_whether_it_is_in_contact_or_not(is_touching: bool) -> None:
    """The body moves ahead over one foot that stands, while the other legs swing; contacts may say anything."""
    position, rates = np.array(facts.DEFAULT_POSITION_RAD), np.tile([0.0, -2.0, 0.0], 4)
    rates[9:] = [0.0, 2.0, 0.0]
    still_foot = legs_of(position, rates)
    seen = window(position_rad=position, velocity_rad_s=rates, linear_vel_of_body_in_odom_m_s=-still_foot)
    contact = (np.arange(4) == 3) == is_touching
    states = (replace(state, foot_contact=contact) for state in (seen.first, seen.last))
    seen = seen._replace(**dict(zip(("first", "last"), states, strict=True)), contact_changed=False)
    after = ground.after_window(ground.GroundMemory(), seen, None)
    assert after.travel_m == pytest.approx(0.018 * np.linalg.norm(still_foot))
    assert after.slid_m == pytest.approx(0.0, abs=1e-9)
    assert (after.speed_m_s < 1e-6) == is_touching
    changed = ground.after_window(ground.GroundMemory(), seen._replace(contact_changed=True), None)
    assert (changed.slid_m, changed.travel_m) == (0.0, 0.0)


def legs_of(position_rad: np.ndarray, velocity_rad_s: np.ndarray) -> np.ndarray:
    """How the sole of the last leg moves relative to the body: as its foot's centre does, and by its rolling."""
    moving = feet(position_rad, velocity_rad_s)
    rolling = facts.FOOT_RADIUS_M * np.cross(moving.turn_rate_rad_s[3], [0.0, 0.0, 1.0])
    return moving.velocity_m_s[3] - rolling


def test_the_noise_of_a_velocity_near_zero_does_not_add_up_in_an_hour_and_a_travel_does() -> None:
    """Noise and an offset that sum up to 0.4 m/s for ever; at a little more, four time constants are enough."""
    rest = window()
    for speed_m_s, minutes, is_found in ((0.399, 5.0, False), (0.6, 0.25, True)):
        memory = ground.GroundMemory()
        moving = rest._replace(last=replace(rest.last, linear_vel_of_body_in_odom_m_s=np.array([0.0, speed_m_s, 0.0])))
        most_m = 0.0
        for _ in range(round(minutes * 60.0 / 0.018)):
            memory = ground.after_window(memory, moving, None)
            most_m = max(most_m, memory.travel_m)
        assert (most_m > bounds.TRAVEL_M) == is_found


def test_what_the_inertial_unit_felt_fades_and_adds_up() -> None:
    packet = ImuPacket(
        robot_stamp_ns=0,
        acceleration_of_imu_in_link_m_s2=np.array([1.0, 2.0, 9.0]),
        angular_vel_of_link_in_link_rad_s=np.array([0.0, 0.0, 3.0]),
        odom_from_link_wxyz=wxyz(Rotation.from_rotvec([0.3, 0.0, 0.0])),
    )
    before = motion.ImuMemory(np.array([0.1, 0.2, 4.0]), 0.5, 2, 3, has_reported=True)
    seen = window(imu=(packet,), linear_vel_of_body_in_odom_m_s=np.array([0.01, 0.0, 0.02]))
    after = motion.after_imu_window(before, seen)
    fade = 1.0 - 0.018 / 1.0
    felt = np.array([0.1, 0.2, 4.0]) * fade + np.array([1.0, 2.0, 9.0]) * 0.018 - [0.01, 0.0, 0.02]
    np.testing.assert_allclose(after.force_m_s2, felt)
    assert after.felt_s == pytest.approx(0.5 * fade + 0.018)
    assert (after.angle_windows, after.turn_rate_windows) == (3, 4)
    assert motion.after_imu_window(motion.ImuMemory(), window()) == motion.ImuMemory()
    assert motion.after_imu_window(before, window()) == before._replace(silent_windows=1)
    assert motion.after_imu_window(motion.ImuMemory(), seen).has_reported
    assert motion.after_imu_window(before._replace(silent_windows=5), seen).silent_windows == 0
    broken = window(imu=(replace(packet, odom_from_link_wxyz=np.full(4, np.nan)),))
    assert motion.after_imu_window(before._replace(silent_windows=5), broken).silent_windows == 0
    assert motion.after_imu_window(motion.ImuMemory(), broken).has_reported
    assert motion.after_imu_window(motion.ImuMemory(), seen._replace(hole_s=1.01 * bounds.GRAVITY_HOLE_S)).has_reported
    holed = motion.after_imu_window(before, seen._replace(hole_s=1.01 * bounds.GRAVITY_HOLE_S))
    assert (holed.felt_s, holed.angle_windows, holed.turn_rate_windows) == (0.5, 3, 4)
    assert holed.force_m_s2 is before.force_m_s2
    assert motion.after_imu_window(before, seen._replace(hole_s=bounds.GRAVITY_HOLE_S)).felt_s > 0.5
    forgotten = motion.after_imu_window(before, seen._replace(duration_s=2.0))
    assert forgotten.felt_s == pytest.approx(2.0)


def test_a_tilt_is_told_once_enough_is_felt_and_gravity_is_there() -> None:
    quarter = 0.25 * bounds.GRAVITY_MEMORY_S
    force = 9.81 * quarter * np.array([np.sin(0.4), 0.0, np.cos(0.4)])
    assert motion.ImuMemory(force, quarter).tilt_error_rad == pytest.approx(0.4)
    assert motion.ImuMemory(force, 0.999 * quarter).tilt_error_rad == 0.0
    least = bounds.GRAVITY_LEAST_M_S2 * quarter * np.array([0.0, 1.0, 0.0])
    assert motion.ImuMemory(least, quarter).tilt_error_rad == pytest.approx(np.pi / 2.0)
    assert motion.ImuMemory(0.999 * least, quarter).tilt_error_rad == 0.0


def test_an_inertial_unit_that_reports_what_is_no_number_is_counted_and_leaves_the_memory_good() -> None:
    good = ImuPacket(0, np.array([0.0, 0.0, 9.81]), np.zeros(3), LEVEL)
    before = motion.ImuMemory(np.array([0.1, 0.2, 4.0]), 0.5, 2, 3, 1, has_reported=True)
    for changes in (
        {"acceleration_of_imu_in_link_m_s2": np.array([0.0, np.nan, 9.81])},
        {"angular_vel_of_link_in_link_rad_s": np.array([0.0, 0.0, np.inf])},
        {"odom_from_link_wxyz": np.full(4, np.nan)},
    ):
        after = motion.after_imu_window(before, window(imu=(good, replace(good, **changes))))
        assert after == before._replace(unknown_windows=2)
    assert motion.after_imu_window(before, window(imu=(good,))).unknown_windows == 0


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


def test_what_legs_carry_fades_and_adds_up() -> None:
    before = ground.WeightMemory(np.array([10.0, 20.0, 30.0, 40.0]), 3.0, 0.9)
    seen, carried_n = window(), np.array([0.1, 0.2, 0.3, 0.4]) * WEIGHT_N
    after = ground.after_weight_window(before, seen, carried_n)
    fade = 1.0 - 0.018 / 1.0
    pushed = np.array([10.0, 20.0, 30.0, 40.0]) * fade + np.array([0.1, 0.2, 0.3, 0.4]) * WEIGHT_N * 0.018
    np.testing.assert_allclose(after.pushed_n_s, pushed, rtol=1e-4)
    assert after.gained_n_s == pytest.approx(3.0 * fade)
    assert after.felt_s == pytest.approx(0.9 * fade + 0.018)
    slow, fast = (window(linear_vel_of_body_in_odom_m_s=np.array([5.0, 5.0, up_m_s])) for up_m_s in (0.2, 0.5))
    rising = ground.after_weight_window(before, slow, carried_n)
    assert rising.gained_n_s == pytest.approx(3.0 * fade + 31.60 * 0.2, rel=1e-3)
    braked = ground.after_weight_window(before, slow._replace(first=fast.last), carried_n)
    assert braked.gained_n_s == pytest.approx(3.0 * fade - 31.60 * 0.3, rel=1e-3)
    assert ground.after_weight_window(before, seen._replace(duration_s=2.0), carried_n).felt_s == pytest.approx(2.0)


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
    memory = ground.WeightMemory(np.array(shares) * bounds.WEIGHT_N, gained_n_s, 1.0)
    assert memory.is_wrong == is_wrong
    short = ground.WeightMemory(0.75 * np.array(shares) * bounds.WEIGHT_N, 0.75 * gained_n_s, 0.75)
    assert short.is_wrong == is_wrong
    assert not short._replace(felt_s=0.749).is_wrong
    np.testing.assert_allclose(short.legs_share, shares)


def test_a_share_at_its_bound_is_right(monkeypatch: pytest.MonkeyPatch) -> None:
    memory = ground.WeightMemory(np.array([0.3, 0.4, 0.5, -0.1]) * WEIGHT_N, 0.0, 1.0)
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


def test_what_legs_carry_fades_within_its_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounds, "WEIGHT_MEMORY_S", 2.0)
    after = ground.after_weight_window(ground.WeightMemory(felt_s=1.0), window(), np.zeros(4))
    assert after.felt_s == pytest.approx(1.0 - 0.009 + 0.018)


def test_forces_on_the_feet_are_those_that_the_loads_balance() -> None:
    """Worked out a second way, by finite differences of where the feet are."""
    shares = [0.1, 0.2, 0.3, 0.4]
    upward_n = ground_forces_n(facts.DEFAULT_POSITION_RAD, carrying(shares))[:, 2]
    np.testing.assert_allclose(upward_n, np.array(shares) * WEIGHT_N, rtol=1e-4)
