"""Joints with a wrong sign, or taken for others, in all that an adapter reports: feet that stand would slide."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_runtime.control.safety.signals import bounds, check, wiring
from spot_runtime.control.safety.signals.legs import feet, sole_speeds_m_s
from spot_runtime.control.safety.signals.readers import Signal
from spot_runtime.control.safety.signals.window import Window
from spot_runtime.control.safety.signals.wiring import NAMES, WiringMemory, after_window, readings
from tests.spot_runtime.resting_robot import drawn_stand
from tests.spot_runtime.test_signal_memories import window

UP = np.array([0.0, 0.0, 1.0])
CARRIED_N = np.full(4, 0.25 * bounds.WEIGHT_N)
STATES = 1 + len(NAMES)
Lie = Callable[[Array], Array]


def error(name: str) -> Lie:
    return lambda joints: readings(joints)[NAMES.index(name)]


def rates_of(position_rad: Array, velocity_m_s: Array, turn_rate_rad_s: Array) -> Array:
    """The joint velocities with which no foot slides, by the feet's motion with each joint alone."""
    rates = np.vstack([np.zeros(12), np.eye(12)])  # at rest, and each joint alone
    moved = feet(np.tile(position_rad, (13, 1)), rates)
    centres = velocity_m_s + np.cross(turn_rate_rad_s, moved.position_m) + moved.velocity_m_s
    soles_m_s = centres - facts.FOOT_RADIUS_M * np.cross(turn_rate_rad_s + moved.turn_rate_rad_s, UP)
    at_rest, columns = soles_m_s[0], soles_m_s[1:] - soles_m_s[0]
    solved = [np.linalg.solve(columns[3 * leg : 3 * leg + 3, leg].T, -at_rest[leg]) for leg in range(4)]
    return np.concatenate(solved)


def swaying(
    rng: np.random.Generator, lie: Lie = lambda joints: joints, *, noise_rad_s: float = 0.03, slides_m_s: float = 0.0
) -> Iterator[Window]:
    """Windows of a robot that stands on four feet and sways and turns ever more, as with a policy that errs."""
    stand = drawn_stand(rng, payload_kg=rng.uniform(0.0, 14.0), slope_rad=np.radians(rng.uniform(0.0, 5.0)))
    bias_m_s = rng.normal(0.0, 0.02, 3)
    for index in range(120):
        phase = 2.0 * np.pi * 0.018 * index * np.array([0.9, 1.3, 0.7])
        growth = 0.5 + index / 40.0
        velocity = 0.2 * growth * np.sin(phase + np.array([0.0, 1.0, 2.0]))
        turn_rate = growth * np.array([0.2, 0.2, 0.7]) * np.sin(phase + np.array([2.0, 0.5, 1.0]))
        rates = rates_of(stand.position_rad, velocity, turn_rate)
        velocity = velocity + bias_m_s + slides_m_s * np.array([1.0, 0.5, 0.0])
        yield window(
            position_rad=lie(stand.position_rad),
            velocity_rad_s=lie(rates) + noise_rad_s * rng.standard_normal(12),
            linear_vel_of_body_in_odom_m_s=velocity,
            angular_vel_of_body_in_odom_rad_s=turn_rate,
        )


def found_in(windows: Iterator[Window]) -> tuple[int, str]:
    """How many windows it takes to find an error, and its name; 0 where none is found."""
    memory = WiringMemory()
    for index, seen in enumerate(windows, start=1):
        memory = after_window(memory, seen, CARRIED_N)
        if memory.windows >= bounds.MISREAD_WINDOWS:
            return index, memory.explained
    return 0, ""


# Robots --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    [
        "fl_hx mirrored",
        "fl_hx, fr_hx, hl_hx, hr_hx mirrored",
        "fl_hx, fr_hx mirrored",
        "fl_hy and fr_hy exchanged",
        "fl_kn and fr_kn exchanged",
        "legs fl and fr exchanged",
        "legs fl and hr exchanged",
        "left and right legs exchanged",
        "front and hind legs exchanged",
    ],
)
def test_joints_that_are_misread_in_every_signal_are_named_once_the_body_sways(name: str) -> None:
    for seed in range(3):
        rng = np.random.default_rng(seed)
        after, told = found_in(swaying(rng, error(name)))
        assert after > 0
        assert told == name


@pytest.mark.parametrize(("noise_rad_s", "slides_m_s"), [(0.0, 0.0), (0.05, 0.0), (0.3, 0.0), (0.03, 0.3)])
def test_a_robot_whose_joints_are_right_is_believed_also_where_its_feet_slide(
    noise_rad_s: float, slides_m_s: float
) -> None:
    for seed in range(3):
        rng = np.random.default_rng(seed)
        assert found_in(swaying(rng, noise_rad_s=noise_rad_s, slides_m_s=slides_m_s)) == (0, "")


def test_a_robot_at_rest_shows_none_of_it() -> None:
    rng = np.random.default_rng(1)
    stand = drawn_stand(rng)
    lie = error("fl_hy and fr_hy exchanged")
    at_rest = (
        window(position_rad=lie(stand.position_rad), velocity_rad_s=0.02 * rng.standard_normal(12)) for _ in range(99)
    )
    assert found_in(at_rest) == (0, "")


# Errors --------------------------------------------------------------------------------------------------------------


def test_every_joint_kind_and_pair_is_tried_and_legs_alone_and_by_side() -> None:
    tried = dict(zip(NAMES, readings(np.arange(1.0, 13.0)), strict=True))
    assert len(tried) == len(NAMES) == 12 + 15 + 66 + 6 + 2
    ordered = np.arange(1.0, 13.0)
    for name, joints in (
        ("fl_kn mirrored", [2]),
        ("fl_kn, fr_kn, hl_kn, hr_kn mirrored", [2, 5, 8, 11]),
        ("fl_hx, hl_hx mirrored", [0, 6]),
        ("fr_hy, hr_hy mirrored", [4, 10]),
        ("hl_hx, hr_hx mirrored", [6, 9]),
    ):
        np.testing.assert_array_equal(tried[name], ordered * np.where(np.isin(np.arange(12), joints), -1.0, 1.0))
    np.testing.assert_array_equal(tried["fl_hx and hr_kn exchanged"], [12, *range(2, 12), 1])
    np.testing.assert_array_equal(tried["legs fl and hl exchanged"], [7, 8, 9, 4, 5, 6, 1, 2, 3, 10, 11, 12])
    np.testing.assert_array_equal(tried["left and right legs exchanged"], [4, 5, 6, 1, 2, 3, 10, 11, 12, 7, 8, 9])
    np.testing.assert_array_equal(tried["front and hind legs exchanged"], [*range(7, 13), *range(1, 7)])


# By hand -------------------------------------------------------------------------------------------------------------


def test_only_feet_that_touch_throughout_and_carry_something_stand() -> None:
    seen = window(foot_contact=np.array([True, True, True, False]))
    lifted = np.array([True, False, True, True])
    seen = seen._replace(first=replace(seen.first, foot_contact=lifted))
    enough = bounds.FOOT_LEAST_SHARE * bounds.WEIGHT_N
    carried = np.array([np.nextafter(enough, 999.0), 99.0, enough, 99.0])
    assert wiring.standing(seen, carried).tolist() == [True, False, False, False]
    assert wiring.standing(seen, None).tolist() == [False] * 4
    memory = WiringMemory(0.3, np.full(STATES, 0.1), 3)
    assert after_window(memory, seen, None) is memory
    assert after_window(memory, seen, np.zeros(4)) is memory


def test_squares_of_the_soles_speeds_fade_and_add_up_and_none_counts_as_more_than_a_foot_may_err() -> None:
    rates = np.zeros(12)
    rates[1], rates[5] = 0.5, 3.0
    velocity, turn_rate = np.array([0.1, -0.2, 0.05]), np.array([0.1, 0.2, -0.3])
    seen = window(
        position_rad=facts.DEFAULT_POSITION_RAD,
        velocity_rad_s=rates,
        linear_vel_of_body_in_odom_m_s=velocity,
        angular_vel_of_body_in_odom_rad_s=turn_rate,
    )
    carried = CARRIED_N * [1.0, 1.0, 0.0, 1.0]
    after = after_window(WiringMemory(0.4, np.full(STATES, 0.2)), seen, carried)
    fade = 1.0 - 0.018 / 0.5
    assert after.felt_s == pytest.approx(0.4 * fade + 0.018)
    for row, joints in ((0, rates), (1 + NAMES.index("fl_hy and hr_kn exchanged"), None)):
        name = "fl_hy and hr_kn exchanged"
        position = facts.DEFAULT_POSITION_RAD if joints is not None else error(name)(facts.DEFAULT_POSITION_RAD)
        moved = feet(position, rates if joints is not None else error(name)(rates))
        speeds = sole_speeds_m_s(moved, velocity_m_s=velocity, turn_rate_rad_s=turn_rate, up=UP)[[0, 1, 3]]
        assert speeds.max() > 0.5 > speeds.min()
        expected = 0.2 * fade + 0.018 * float(np.mean(np.minimum(speeds, 0.5) ** 2))
        assert after.slid[row] == pytest.approx(expected)
    long = after_window(WiringMemory(0.4, np.full(STATES, 0.2)), seen._replace(duration_s=1.0), carried)
    assert long.felt_s == 1.0


def judged(felt_s: float, reported: float, best: float) -> int:
    """Windows in a row, after three, in one that adds nothing to these sums."""
    slid = np.full(STATES, reported)
    slid[7] = best
    seen = window(position_rad=facts.DEFAULT_POSITION_RAD)._replace(duration_s=0.0)
    return after_window(WiringMemory(felt_s, slid, 3), seen, CARRIED_N).windows


def test_an_error_counts_once_enough_was_felt_slid_and_explained() -> None:
    enough_s, most = 0.25, 0.05**2 * 0.4
    assert judged(enough_s, most, 0.0) == 4
    assert judged(np.nextafter(enough_s, 0.0), most, 0.0) == 0
    assert judged(0.4, np.nextafter(most, 1.0), 0.33 * most) == 4
    assert judged(0.4, most, 0.33 * most) == 0
    share = bounds.MISREAD_SHARE * 0.1
    assert judged(0.4, 0.1, share) == 4
    assert judged(0.4, 0.1, np.nextafter(share, 1.0)) == 0


def test_counting_begins_with_the_window_that_makes_enough_time_felt() -> None:
    """Nothing is remembered before the first window, which lasts just as long as is asked for."""
    *_, last = swaying(np.random.default_rng(0), error("fl_kn and fr_kn exchanged"))
    enough_s = 0.5 * bounds.FOOT_MEMORY_S
    assert after_window(WiringMemory(), last._replace(duration_s=enough_s), CARRIED_N).windows == 1


def test_the_likeliest_error_is_named_and_the_reported_joints_are_none() -> None:
    slid = np.full(STATES, 0.5)
    slid[0], slid[8] = 0.1, 0.2
    assert WiringMemory(1.0, slid).explained == NAMES[7]


def test_who_is_suspected_and_that_nothing_is_judged_while_nobody_has_the_joints() -> None:
    (doubt,) = check._doubts(check.SignalMemory(wiring=WiringMemory(windows=bounds.MISREAD_WINDOWS)))
    assert doubt.suspects == {Signal.POSITION, Signal.VELOCITY, Signal.BODY_VELOCITY, Signal.TURN_RATE}
    states = [window(position_rad=facts.DEFAULT_POSITION_RAD, load_nm=np.full(12, 1.0)).last]
    stood = window(position_rad=facts.DEFAULT_POSITION_RAD, load_nm=np.full(12, 1.0))
    memory = check.SignalMemory(states=(stood.first,), wiring=WiringMemory(0.3, np.full(STATES, 0.1), 3))
    for situation, is_kept in (
        (check.Situation(), False),
        (check.Situation(is_standing=True), True),
        (check.Situation(is_held=True), True),
        (check.Situation(is_driven=True), True),
    ):
        after, _ = check.check_signals(memory, states, situation)
        assert (after.wiring.felt_s > 0.0) is is_kept
