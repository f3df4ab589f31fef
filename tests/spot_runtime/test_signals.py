"""Robots that lie, one signal at a time, and robots that do not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from spot_model.robot import facts
from spot_model.robot.state import Gains, JointCommand, RobotState
from spot_runtime.control.modes import Mode
from spot_runtime.control.safety.body_height import body_height_m
from spot_runtime.control.safety.signals import bounds, check, ground, motion, still
from spot_runtime.control.safety.signals.legs import feet, ground_forces_n, sole_speeds_m_s
from spot_runtime.control.safety.signals.readers import READ_FOR_OBSERVATION, Doubt, Signal, relied_on
from spot_runtime.control.safety.signals.window import rotation_matrix, turned_rad, window_of
from spot_runtime.stops import Stop, StopReason
from tests.spot_runtime.conftest import STAND_LOAD_NM
from tests.spot_runtime.walking_robot import WalkingRobot

Lie = Callable[[RobotState], RobotState]
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
IDLE, STANDING, DRIVEN = check.Situation(), check.Situation(is_standing=True), check.Situation(is_driven=True)


def states_of(robot: WalkingRobot, seconds: float) -> tuple[RobotState, ...]:
    return tuple(robot.state(index, key=index) for index in range(round(seconds / 0.003)))


@cache
def walking() -> tuple[RobotState, ...]:
    return states_of(WalkingRobot(), 6.0)


@cache
def standing() -> tuple[RobotState, ...]:
    return states_of(WalkingRobot(is_walking=False), 2.0)


SPARSE = {
    "half the rate": np.arange(0, 2000, 2),
    "100 Hz": np.arange(0, 2000, 3),
    "50 Hz": np.arange(0, 2000, 7),
    "half of them lost": np.flatnonzero(np.random.default_rng(5).random(2000) < 0.5),
}
"""States that arrive of a slow stream, and of one that loses states."""


def sparse(rate: str) -> tuple[RobotState, ...]:
    return tuple(walking()[index] for index in SPARSE[rate])


def ends_a_run(doubt: Doubt, *, is_standing: bool) -> bool:
    """Whether it ends the run of a policy that observes everything."""
    return bool(doubt.suspects & relied_on(READ_FOR_OBSERVATION, Mode.READY if is_standing else Mode.ACTIVE))


def seen(
    states: tuple[RobotState, ...], make_lie: Callable[[], Lie] | None = None, *, begin_s: float = 0.6
) -> tuple[float, Doubt] | None:
    """The first doubt that ends a run, or, where there is none, the first, and when it came, s since the lie began."""
    memory, is_standing = check.SignalMemory(), states is standing()
    lie: Lie | None = None
    told: tuple[float, Doubt] | None = None
    asked = -1
    for true_state in states:
        state, true_rad = true_state, true_state.position_rad
        passed_s, index = (state.robot_stamp_ns - states[0].robot_stamp_ns) / 1e9, state.last_command_key
        if make_lie is not None and passed_s >= begin_s - 1e-9:
            lie = lie or make_lie()
            state = lie(state)
        if index // 7 > asked and not is_standing:  # set-points that gave these loads where the joints really are
            wanted = true_rad + STAND_LOAD_NM / facts.POLICY_KP_NM_PER_RAD
            asked = index // 7
            memory = check.asked(memory, JointCommand(index, wanted, np.zeros(12), np.zeros(12), Gains.policy(), 1))
        memory, doubts = check.check_signals(memory, [state], STANDING if is_standing else DRIVEN)
        ending = [doubt for doubt in doubts if ends_a_run(doubt, is_standing=is_standing)]
        if ending:
            return passed_s - begin_s, ending[0]
        if doubts and told is None:
            told = passed_s - begin_s, doubts[0]
    return told


def frozen(name: str, index: Any = slice(None)) -> Callable[[], Lie]:
    def make() -> Lie:
        kept: list[Any] = []

        def lie(state: RobotState) -> RobotState:
            values = getattr(state, name).copy()
            kept.append(values.copy())
            values[index] = kept[0][index]
            return replace(state, **{name: values})

        return lie

    return make


def changed(**functions: Callable[[Any], Any]) -> Callable[[], Lie]:
    def lie(state: RobotState) -> RobotState:
        return replace(state, **{name: change(getattr(state, name)) for name, change in functions.items()})

    return lambda: lie


def both(*makers: Callable[[], Lie]) -> Callable[[], Lie]:
    def make() -> Lie:
        lies = [maker() for maker in makers]

        def lie(state: RobotState) -> RobotState:
            for each in lies:
                state = each(state)
            return state

        return lie

    return make


def exchanged(a: int, b: int) -> Callable[[], Lie]:
    order = np.arange(12)
    order[3 * a : 3 * a + 3], order[3 * b : 3 * b + 3] = np.arange(3 * b, 3 * b + 3), np.arange(3 * a, 3 * a + 3)
    take = lambda values: values[order]  # noqa: E731 - one expression, used three times
    return changed(position_rad=take, velocity_rad_s=take, load_nm=take)


JOINT_SIGNALS = ("position_rad", "velocity_rad_s", "load_nm")
ATTITUDE, LINEAR, ANGULAR = (
    "odom_from_body_wxyz",
    "linear_vel_of_body_in_odom_m_s",
    "angular_vel_of_body_in_odom_rad_s",
)
CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])


def without_imu(maker: Callable[[], Lie]) -> Callable[[], Lie]:
    return both(maker, changed(imu=lambda _: ()))


def test_a_robot_that_tells_the_truth_is_believed() -> None:
    assert seen(walking()) is None
    assert seen(standing()) is None
    assert seen(states_of(WalkingRobot(is_walking=False, noise=0.0), 0.6)) is None
    assert seen(states_of(WalkingRobot(turn_rate_rad_s=-1.5, noise=3.0), 1.0)) is None
    assert seen(states_of(WalkingRobot(noise=0.01), 1.0)) is None


@pytest.mark.parametrize("name", JOINT_SIGNALS)
@pytest.mark.parametrize("joint", [0, 4, 8, 11])
@pytest.mark.parametrize("is_walking", [True, False])
def test_one_frozen_signal_of_one_joint(name: str, joint: int, is_walking: bool) -> None:
    found = seen(walking() if is_walking else standing(), frozen(name, joint))
    assert found is not None
    after_s, doubt = found
    assert facts.JOINT_NAMES[joint] in doubt.stop.detail
    assert after_s < (0.27 if name != "load_nm" else 0.65)
    # The policy does not read loads, and the stand's mean load is needed until joint control has begun.
    assert ends_a_run(doubt, is_standing=not is_walking) == (name != "load_nm" or not is_walking)


LIES = {
    "eleven joints of twelve": (both(*(frozen(name, slice(0, 11)) for name in JOINT_SIGNALS)), 0.3),
    "all positions": (frozen("position_rad"), 0.3),
    "all velocities": (frozen("velocity_rad_s"), 0.3),
    "all loads": (frozen("load_nm"), 1.0),
    "attitude": (frozen(ATTITUDE), 0.3),
    "attitude, no inertial unit": (without_imu(frozen(ATTITUDE)), 0.3),
    "body velocity": (frozen(LINEAR), 0.3),
    "one component of it": (frozen(LINEAR, 1), 0.3),
    "turn rate": (frozen(ANGULAR), 0.3),
    "body velocity reversed": (changed(**{LINEAR: lambda v: -v}), 1.5),
    "body velocity in another frame": (changed(**{LINEAR: lambda v: np.array([v[1], -v[0], v[2]])}), 1.5),
    "body velocity 1.5 m/s off": (changed(**{LINEAR: lambda v: v + np.array([1.5, 0.0, 0.0])}), 2.5),
    "turn rate in degrees": (changed(**{ANGULAR: lambda v: v * 57.3}), 0.3),
    "turn rate in degrees, no inertial unit": (without_imu(changed(**{ANGULAR: lambda v: v * 57.3})), 0.5),
    "joint velocity in degrees": (changed(velocity_rad_s=lambda v: v * 57.3), 0.3),
    "joint velocity reversed": (changed(velocity_rad_s=lambda v: -v), 0.5),
    "joint velocity zero": (changed(velocity_rad_s=lambda v: v * 0.0), 0.5),
    "load in another unit": (changed(load_nm=lambda v: v * 10.0), 0.5),
    "quaternion conjugated": (changed(**{ATTITUDE: lambda q: q * CONJUGATE}), 0.3),
    "quaternion conjugated, no inertial unit": (without_imu(changed(**{ATTITUDE: lambda q: q * CONJUGATE})), 2.0),
    "quaternion scalar last": (changed(**{ATTITUDE: lambda q: np.roll(q, -1)}), 0.3),
    "front legs exchanged": (exchanged(0, 1), 0.5),
    "left legs exchanged": (exchanged(0, 2), 0.5),
    "diagonal legs exchanged": (exchanged(0, 3), 0.5),
    "inertial unit turned": (
        changed(imu=lambda p: tuple(replace(x, odom_from_link_wxyz=np.array([0.8, 0.6, 0.0, 0.0])) for x in p)),
        0.3,
    ),
    "inertial unit spins": (
        changed(imu=lambda p: tuple(replace(x, angular_vel_of_link_in_link_rad_s=np.full(3, 3.0)) for x in p)),
        0.3,
    ),
    "gravity from the side": (
        changed(imu=lambda p: tuple(replace(x, acceleration_of_imu_in_link_m_s2=np.array([0, 9.81, 0])) for x in p)),
        1.5,
    ),
    "contacts": (frozen("foot_contact"), 4.0),
    "body velocity 4 m/s off, and frozen feet": (
        both(frozen("foot_contact"), changed(**{LINEAR: lambda v: v + np.array([4.0, 0.0, 0.0])})),
        1.5,
    ),
    "loads of the wrong sign": (changed(load_nm=lambda v: -v), 1.0),
    "loads that are zero": (changed(load_nm=lambda v: 0.0 * v), 1.0),
    "loads of a knee of the wrong sign": (changed(load_nm=lambda v: v * np.where(np.arange(12) == 5, -1.0, 1.0)), 1.5),
    "no contact any more": (changed(foot_contact=lambda c: c & False), 1.0),
}


TOLD = {"all loads", "loads that are zero", "contacts", "no contact any more"}
"""What nothing in control relies on while a policy walks, so that it is told and ends nothing."""


@pytest.mark.parametrize("name", LIES)
def test_a_robot_that_lies_while_it_walks(name: str) -> None:
    lie, within_s = LIES[name]
    found = seen(walking(), lie)
    assert found is not None
    after_s, doubt = found
    assert after_s <= within_s, doubt.stop.sentence()
    assert ends_a_run(doubt, is_standing=False) == (name not in TOLD), doubt


STANDING_LIES = (
    "body velocity 1.5 m/s off",
    "load in another unit",
    "loads of the wrong sign",
    "loads of a knee of the wrong sign",
    "quaternion conjugated",
    "quaternion scalar last",
    "front legs exchanged",
    "diagonal legs exchanged",
    "inertial unit turned",
    "inertial unit spins",
    "gravity from the side",
)


@pytest.mark.parametrize("name", STANDING_LIES)
def test_a_robot_that_lies_while_it_stands(name: str) -> None:
    found = seen(standing(), LIES[name][0])
    assert found is not None
    after_s, doubt = found
    assert after_s < 0.27
    assert ends_a_run(doubt, is_standing=True), doubt


RESTING = ("eleven joints of twelve", "all positions", "all velocities", "all loads", "attitude", "body velocity")


@pytest.mark.parametrize("name", [*RESTING, "turn rate"])
def test_what_repeats_itself_at_rest_is_believed_until_the_joints_move(name: str) -> None:
    """Coarse sensors and estimators of a robot that stands may hold their values; those of one that walks may not."""
    assert seen(standing(), LIES[name][0]) is None
    found = seen(walking(), LIES[name][0], begin_s=0.0)
    assert found is not None
    assert found[0] < LIES[name][1]


def test_joints_that_move_though_the_robot_should_stand() -> None:
    """The same states that are a good walk are no good stand."""
    memory = check.SignalMemory()
    for state in walking()[:500]:
        memory, doubts = check.check_signals(memory, [state], STANDING)
        if doubts:
            break
    assert any(stop.detail == "a robot that stands, and its velocities" for _, stop in doubts), doubts


NEEDS_ALL = {"gravity from the side"}
"""What is felt between states is missing from the mean."""


@pytest.mark.parametrize("rate", SPARSE)
def test_a_slow_or_a_lossy_stream_is_believed_while_it_tells_the_truth(rate: str) -> None:
    assert seen(sparse(rate)) is None


@pytest.mark.parametrize("rate", ["50 Hz", "half of them lost"])
@pytest.mark.parametrize("name", [name for name in LIES if name not in NEEDS_ALL])
def test_a_lie_is_found_in_a_slow_or_a_lossy_stream(name: str, rate: str) -> None:
    lie, within_s = LIES[name]
    found = seen(sparse(rate), lie)
    assert found is not None
    assert found[0] <= 1.5 * within_s + 0.1, found[1].stop.sentence()


@pytest.mark.parametrize("joint", [2, 7])
@pytest.mark.parametrize("rate", SPARSE)
def test_a_frozen_joint_is_found_in_a_slow_or_a_lossy_stream(joint: int, rate: str) -> None:
    found = seen(sparse(rate), frozen("position_rad", joint))
    assert found is not None
    assert facts.JOINT_NAMES[joint] in found[1].stop.detail
    assert found[0] < 0.4


def test_states_too_far_apart_are_not_judged_and_those_after_are() -> None:
    memory = check.SignalMemory()
    for state in walking()[:400:9]:
        memory, doubts = check.check_signals(memory, [state], IDLE)
        assert (doubts, memory.motion) == ((), check.SignalMemory().motion)
    memory, doubts = check.check_signals(memory, walking()[400:414], IDLE)
    assert doubts == ()
    assert memory.motion.slope_rad.any()


def test_an_inertial_unit_that_falls_silent_is_doubted_and_one_that_never_spoke_is_not() -> None:
    silent = changed(imu=lambda _: ())
    assert seen(walking(), silent, begin_s=0.0) is None
    found = seen(walking(), silent)
    assert found is not None
    assert found[1].suspects == {Signal.INERTIAL_UNIT}
    assert found[1].stop == Stop(StopReason.SIGNALS_CONTRADICT, "the inertial unit no longer reports")
    assert found[0] == pytest.approx(bounds.IMU_SILENT_WINDOWS * 0.018, abs=0.05)
    quiet = [replace(state, imu=()) for state in walking()[:8]]
    for windows, count in ((2, 0), (1, 1)):
        last = motion.ImuMemory(has_reported=True, silent_windows=bounds.IMU_SILENT_WINDOWS - windows)
        _, doubts = check.check_signals(check.SignalMemory(imu=last), quiet, IDLE)
        assert len(doubts) == count


def test_an_inertial_unit_that_falls_silent_is_doubted_at_any_rate_of_states() -> None:
    states = walking()[::3]  # too far apart for gravity to be felt
    silent = [state if index < len(states) // 3 else replace(state, imu=()) for index, state in enumerate(states)]
    for stream, is_doubted in ((states, False), (silent, True)):
        memory, doubts = check.check_signals(check.SignalMemory(), stream, IDLE)
        assert memory.imu.felt_s == 0.0
        assert any(stop.detail == "the inertial unit no longer reports" for _, stop in doubts) == is_doubted


def test_feet_of_which_none_stands_contradict_the_bodys_velocity() -> None:
    for share, expected in ((1.0, 1), (0.9 * bounds.FOOT_SHARE, 0)):
        of_late = ground.GroundMemory(bounds.FOOT_MEMORY_S, share * bounds.FOOT_MEMORY_S, has_touched=True)
        memory, doubts = check.check_signals(check.SignalMemory(ground=of_late), walking()[:8], IDLE)
        assert len(doubts) == expected
        for _, stop in doubts:
            assert stop.reason is StopReason.SIGNALS_CONTRADICT
            assert "the body's velocity and feet that stand" in stop.detail
            assert stop.values == {"foot_speed_m_s": memory.ground.speed_m_s, "share": memory.ground.sliding_share}


def test_sensors_that_resolve_little_and_have_no_noise_may_repeat_themselves() -> None:
    """Twice the step that is assumed: most joints of a robot that sways show the same value for long."""
    step_rad = 2.5e-4
    coarse = changed(position_rad=lambda q: np.round(q / step_rad) * step_rad)
    swaying = tuple(
        replace(state, position_rad=facts.DEFAULT_POSITION_RAD + 4e-3 * np.sin(0.003 * i * np.arange(1, 13) / 2.0))
        for i, state in enumerate(standing())
    )
    found = seen(swaying, coarse, begin_s=0.0)
    assert found is None or "position of" not in found[1].stop.detail
    assert seen(walking(), both(coarse, frozen("position_rad", 4))) is not None


def test_an_inertial_unit_without_an_attitude_of_its_own() -> None:
    bare = changed(imu=lambda p: tuple(replace(x, odom_from_link_wxyz=np.zeros(4)) for x in p))
    assert seen(walking(), bare) is None


def test_loads_that_are_not_reported_are_no_lie() -> None:
    assert seen(standing(), changed(load_nm=lambda v: v * 0.0), begin_s=0.0) is None


def test_loads_that_push_the_robot_into_the_ground_are_one() -> None:
    found = seen(standing(), changed(load_nm=lambda v: -v))
    assert found is not None
    assert found[1].stop.detail.startswith("joints, loads and weight of a robot that stands")


# Parts ---------------------------------------------------------------------------------------------------------------


def test_feet_move_as_their_positions_do() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        position = facts.DEFAULT_POSITION_RAD + 0.3 * rng.standard_normal(12)
        velocity = rng.standard_normal(12)
        before, after = feet(position - 1e-6 * velocity, velocity), feet(position + 1e-6 * velocity, velocity)
        slope = (after.position_m - before.position_m) / 2e-6
        np.testing.assert_allclose(slope, feet(position, velocity).velocity_m_s, atol=1e-6)
        height = facts.FOOT_RADIUS_M - feet(position, velocity).position_m[:, 2].min()
        assert height == pytest.approx(body_height_m(position, LEVEL))


def test_the_forces_on_the_feet_do_the_work_of_the_loads() -> None:
    """Virtual work: force · foot velocity + load · joint velocity = 0 for every motion."""
    rng = np.random.default_rng(4)
    position, load = facts.DEFAULT_POSITION_RAD + 0.1 * rng.standard_normal(12), 10.0 * rng.standard_normal(12)
    forces = ground_forces_n(position, load)
    for _ in range(5):
        velocity = rng.standard_normal(12)
        work = (forces * feet(position, velocity).velocity_m_s).sum() + load @ velocity
        assert work == pytest.approx(0.0, abs=1e-9)


def test_a_foot_that_stands_under_a_body_that_moves_has_no_speed() -> None:
    """Without joint motion the sole moves with the body: 0.3 m/s forward, and 0.5 rad/s about the sole's own place."""
    legs = feet(facts.DEFAULT_POSITION_RAD, np.zeros(12))
    up = np.array([0.0, 0.0, 1.0])
    forward = sole_speeds_m_s(legs, velocity_m_s=np.array([0.3, 0.0, 0.0]), turn_rate_rad_s=np.zeros(3), up=up)
    np.testing.assert_allclose(forward, 0.3)
    turning = sole_speeds_m_s(legs, velocity_m_s=np.zeros(3), turn_rate_rad_s=np.array([0.0, 0.0, 0.5]), up=up)
    np.testing.assert_allclose(turning, 0.5 * np.hypot(legs.position_m[:, 0], legs.position_m[:, 1]))


def test_a_rotation_between_attitudes_is_the_short_way_round_whatever_the_sign() -> None:
    half = np.array([np.cos(0.1), 0.0, 0.0, np.sin(0.1)])
    for sign in (1.0, -1.0):
        np.testing.assert_allclose(turned_rad(LEVEL, sign * half), [0.0, 0.0, 0.2], atol=1e-12)
    np.testing.assert_array_equal(turned_rad(half, half), np.zeros(3))
    np.testing.assert_allclose(rotation_matrix(half) @ [1.0, 0.0, 0.0], [np.cos(0.2), np.sin(0.2), 0.0])


def test_a_window_with_a_hole_is_not_judged() -> None:
    robot = WalkingRobot()
    assert window_of([robot.state(i) for i in (0, 9)]) is None
    assert window_of([robot.state(0)]) is None
    lossy = window_of([robot.state(i) for i in (0, 1, 2, 5, 6)])
    assert lossy is not None
    assert lossy.hole_s == pytest.approx(0.006)
    whole = window_of([robot.state(i) for i in range(7)])
    assert whole is not None
    assert whole.duration_s == pytest.approx(0.018)
    assert whole.hole_s == pytest.approx(0.0, abs=1e-9)
    assert len(whole.imu) == 18


def test_travel_is_the_integral_of_velocity() -> None:
    """Velocity rises evenly from 0 to 0.6 rad/s within 18 ms: 0.5 · 0.6 · 0.018 = 0.0054 rad."""
    robot = WalkingRobot(noise=0.0)
    states = [replace(robot.state(i), velocity_rad_s=np.full(12, 0.1 * i)) for i in range(7)]
    window = window_of(states)
    assert window is not None
    np.testing.assert_allclose(window.travel_rad, 0.0054)
    np.testing.assert_allclose(window.velocity_range_rad_s, 0.6)


def test_names_and_windows_cover_every_signal() -> None:
    assert len(still.NAMES) == len(still.WINDOWS) == len(still.SUSPECTS) == still.N_SIGNALS == 55
    is_load = np.array([suspects == {Signal.LOAD} for suspects in still.SUSPECTS])
    assert set(still.WINDOWS[is_load]) == {bounds.LOAD_WINDOWS_STILL}
    assert set(still.WINDOWS[~is_load]) == {bounds.STILL_WINDOWS}
