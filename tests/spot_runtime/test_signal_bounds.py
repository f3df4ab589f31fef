"""Every bound of the plausibility checks from both sides: at it all is well, one step beyond it is not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from spot_model.robot import facts
from spot_model.robot.state import Gains, ImuPacket, JointCommand, SlowState
from spot_runtime.control.safety.battery import BatteryMemory
from spot_runtime.control.safety.battery import watch as watch_battery
from spot_runtime.control.safety.commands import SetpointMemory
from spot_runtime.control.safety.signals import (
    answer,
    bounds,
    check,
    ground,
    legs,
    motion,
    still,
    wiring,
)
from spot_runtime.control.safety.signals.check import SignalMemory, Situation, check_signals
from spot_runtime.control.safety.signals.readers import Signal
from spot_runtime.control.safety.signals.window import Window, length, turned_rad, window_of
from spot_runtime.control.safety.states import StateMemory
from spot_runtime.control.safety.watchdogs import LossMemory, WatchMemory, confirm
from spot_runtime.stops import Stop
from tests.spot_runtime.conftest import STAND_LOAD_NM
from tests.spot_runtime.walking_robot import WalkingRobot

ZERO = np.zeros(12)
ONE = np.arange(12) == 3
NONE = ONE & False
ROBOT = WalkingRobot(noise=0.0)
IDLE, STANDING, DRIVEN = Situation(), Situation(is_standing=True), Situation(is_driven=True)


def below(value: float) -> float:
    return float(np.nextafter(value, -np.inf))


def window(**changes: Any) -> Window:
    """18 ms of a level robot whose joints and body stand; its last state differs by these."""
    rest: dict[str, Any] = dict.fromkeys(("position_rad", "velocity_rad_s", "load_nm"), ZERO)
    rest |= {"odom_from_body_wxyz": np.array([1.0, 0.0, 0.0, 0.0]), "imu": ()}
    rest |= {"linear_vel_of_body_in_odom_m_s": np.zeros(3), "angular_vel_of_body_in_odom_rad_s": np.zeros(3)}
    states = [replace(ROBOT.state(i), **rest) for i in range(7)]
    states[-1] = replace(states[-1], **changes)
    made = window_of(states)
    assert made is not None
    return made


@pytest.mark.parametrize(
    "memory",
    [
        *(StateMemory, SetpointMemory, LossMemory, BatteryMemory, WatchMemory, SignalMemory),
        *(motion.MotionMemory, ground.GroundMemory, motion.ImuMemory, ground.WeightMemory),
        *(answer.AnswerMemory, answer.HoldMemory, wiring.WiringMemory),
    ],
)
def test_a_memory_begins_with_nothing(memory: Any) -> None:
    for name, value in memory()._asdict().items():
        if not isinstance(value, tuple):
            assert value is None or not np.any(value), name


def test_windows_are_counted_in_whole_numbers() -> None:
    memory = SignalMemory()
    counts = (memory.still, memory.load_windows, memory.motion.slope_windows)
    assert {count.dtype for count in (*counts, memory.answer.wrong_windows, memory.answer.anothers_windows)} == {
        np.dtype(np.int64)
    }


# From memory to stops ------------------------------------------------------------------------------------------------

COUNTS = {
    "still": lambda n: SignalMemory(still=np.where(np.arange(55) == 50, n, 0)),
    "velocity and position of fr_hx": lambda n: SignalMemory(motion=motion.MotionMemory(slope_windows=n * ONE)),
    "attitude and turn rate of the body": lambda n: SignalMemory(motion=motion.MotionMemory(turn_windows=n)),
    "attitude of the body and of its inertial unit": lambda n: SignalMemory(imu=motion.ImuMemory(angle_windows=n)),
    "turn rate of the body and of its inertial unit": lambda n: SignalMemory(imu=motion.ImuMemory(turn_rate_windows=n)),
    "the inertial unit reports what is no number": lambda n: SignalMemory(imu=motion.ImuMemory(unknown_windows=n)),
    "load and set-point of fr_hx": lambda n: SignalMemory(load_windows=n * ONE),
    "the body's motion and feet that stand, unless fl_hx mirrored": lambda n: SignalMemory(
        wiring=wiring.WiringMemory(windows=n)
    ),
    "a robot that stands, and its velocities": lambda n: SignalMemory(restless_windows=n),
    "joints, loads and weight of a robot that stands": lambda n: SignalMemory(wrong_stances=n),
    "position of fr_hx and load, which does not answer what is asked": lambda n: SignalMemory(
        answer=answer.AnswerMemory(wrong_windows=n * ONE)
    ),
}


@pytest.mark.parametrize(
    ("detail", "enough"),
    [
        ("still", bounds.STILL_WINDOWS),
        ("velocity and position of fr_hx", bounds.SLOPE_WINDOWS),
        ("attitude and turn rate of the body", bounds.TURN_WINDOWS),
        ("attitude of the body and of its inertial unit", bounds.IMU_WINDOWS),
        ("turn rate of the body and of its inertial unit", bounds.IMU_WINDOWS),
        ("the inertial unit reports what is no number", bounds.IMU_WINDOWS),
        ("load and set-point of fr_hx", bounds.LOAD_WINDOWS),
        ("the body's motion and feet that stand, unless fl_hx mirrored", bounds.MISREAD_WINDOWS),
        ("a robot that stands, and its velocities", bounds.RESTLESS_WINDOWS),
        ("joints, loads and weight of a robot that stands", bounds.REST_WINDOWS),
        ("position of fr_hx and load, which does not answer what is asked", bounds.LOAD_WINDOWS),
    ],
)
def test_so_many_windows_in_a_row_are_a_stop_and_one_less_is_none(detail: str, enough: int) -> None:
    assert list(check._doubts(COUNTS[detail](enough - 1))) == []
    ((_, stop),) = check._doubts(COUNTS[detail](enough))
    assert stop.detail == ("the body's velocity, y" if detail == "still" else detail)
    assert stop.values == {}


AMOUNTS = {
    "GRAVITY_ANGLE_RAD": SignalMemory(imu=motion.ImuMemory(np.array([3.0, 0.0, 9.0]), 1.0)),
    "FOOT_SHARE": SignalMemory(ground=ground.GroundMemory(0.5, 0.45)),
    "FOOT_SHARE, loads": SignalMemory(ground=ground.GroundMemory(0.5, 0.0, 0.45)),
    "TRAVEL_M": SignalMemory(ground=ground.GroundMemory(travel_m=2.0)),
    "AIRBORNE_S": SignalMemory(ground=ground.GroundMemory(airborne_s=0.9, has_touched=True)),
}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("GRAVITY_ANGLE_RAD", np.arctan2(3.0, 9.0)),
        ("FOOT_SHARE", 0.9),
        ("FOOT_SHARE, loads", 0.9),
        ("TRAVEL_M", 2.0),
        ("AIRBORNE_S", 0.9),
    ],
)
def test_an_amount_at_its_bound_is_no_doubt(name: str, value: float, monkeypatch: pytest.MonkeyPatch) -> None:
    bound = name.split(",", maxsplit=1)[0]
    monkeypatch.setattr(bounds, bound, value)
    assert list(check._doubts(AMOUNTS[name])) == []
    monkeypatch.setattr(bounds, bound, below(value))
    ((_, stop),) = check._doubts(AMOUNTS[name])
    assert value in stop.values.values()


@pytest.mark.parametrize(
    ("slid_share", "suspects"), [(0.5, {Signal.CONTACTS}), (0.51, {Signal.CONTACTS, Signal.BODY_VELOCITY})]
)
def test_a_travel_without_steps_blames_the_bodys_velocity_too_where_no_foot_stands(
    slid_share: float, suspects: set[Signal]
) -> None:
    travel_m = 2.0 * bounds.TRAVEL_M
    (doubt,) = check._doubts(SignalMemory(ground=ground.GroundMemory(travel_m=travel_m, slid_m=slid_share * travel_m)))
    assert doubt.suspects == suspects


SUSPECTS = {
    "motion": (COUNTS["velocity and position of fr_hx"], {Signal.POSITION, Signal.VELOCITY}),
    "turn": (COUNTS["attitude and turn rate of the body"], {Signal.ATTITUDE, Signal.TURN_RATE}),
    "tilt": (lambda _: AMOUNTS["GRAVITY_ANGLE_RAD"], {Signal.ATTITUDE, Signal.INERTIAL_UNIT}),
    "angle": (COUNTS["attitude of the body and of its inertial unit"], {Signal.ATTITUDE, Signal.INERTIAL_UNIT}),
    "rate": (COUNTS["turn rate of the body and of its inertial unit"], {Signal.TURN_RATE, Signal.INERTIAL_UNIT}),
    "unknown": (COUNTS["the inertial unit reports what is no number"], {Signal.INERTIAL_UNIT}),
    "silent": (lambda n: SignalMemory(imu=motion.ImuMemory(silent_windows=n)), {Signal.INERTIAL_UNIT}),
    "stamps": (lambda n: SignalMemory(imu=motion.ImuMemory(stamp_windows=n)), {Signal.INERTIAL_UNIT}),
    "sliding": (
        lambda _: AMOUNTS["FOOT_SHARE"],
        {Signal.POSITION, Signal.VELOCITY, Signal.BODY_VELOCITY, Signal.TURN_RATE, Signal.CONTACTS},
    ),
    "unloaded": (lambda _: AMOUNTS["FOOT_SHARE, loads"], {Signal.CONTACTS, Signal.LOAD}),
    "airborne": (lambda _: AMOUNTS["AIRBORNE_S"], {Signal.CONTACTS}),
    "load": (COUNTS["load and set-point of fr_hx"], {Signal.LOAD, Signal.POSITION}),
    "weight": (
        lambda _: SignalMemory(weight=ground.WeightMemory(np.zeros(4), 0.0, 1.0)),
        {Signal.LOAD, Signal.POSITION},
    ),
    "stance": (COUNTS["joints, loads and weight of a robot that stands"], {Signal.LOAD, Signal.POSITION}),
    "restless": (
        COUNTS["a robot that stands, and its velocities"],
        {Signal.POSITION, Signal.VELOCITY, Signal.BODY_VELOCITY, Signal.TURN_RATE},
    ),
}


@pytest.mark.parametrize("name", SUSPECTS)
def test_a_doubt_names_all_signals_that_may_be_wrong(name: str) -> None:
    memory_of, suspects = SUSPECTS[name]
    (doubt,) = check._doubts(memory_of(99))
    assert doubt.suspects == suspects


def test_frozen_signals_of_one_kind_are_one_doubt() -> None:
    counts = np.zeros(55, dtype=np.int64)
    counts[[0, 2, 12, 24, 25, 37, 48, 50, 51, 53]] = 99
    told = {doubt.stop.detail: doubt.suspects for doubt in check._doubts(SignalMemory(still=counts))}
    assert told == {
        "position of fl_hx, position of fl_kn": {Signal.POSITION},
        "velocity of fl_hx": {Signal.VELOCITY},
        "load of fl_hx, load of fl_hy": {Signal.LOAD},
        "all of fl_hy": {Signal.POSITION, Signal.VELOCITY},
        "attitude": {Signal.ATTITUDE},
        "the body's velocity, y, the body's velocity, z": {Signal.BODY_VELOCITY},
        "the body's turn rate, y": {Signal.TURN_RATE},
    }


def test_the_sum_of_windows_with_wrong_loads_begins_anew_after_a_right_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(answer, "disagreeing", lambda *_: ONE)
    memory = SignalMemory(commands=(numbered(1),), load_windows=np.full(12, 2))
    memory, _ = check_signals(memory, [ROBOT.state(i) for i in range(7)], DRIVEN)
    assert memory.load_windows.tolist() == [0, 0, 0, 3, *[0] * 8]


@pytest.mark.parametrize(("load_nm", "felt_s"), [(ZERO, 0.0), (5.0 * ONE, 0.018)])
def test_one_load_that_is_reported_is_held_against_what_was_asked(load_nm: np.ndarray, felt_s: float) -> None:
    states = [replace(ROBOT.state(i), load_nm=load_nm, last_command_key=1) for i in range(7)]
    memory, _ = check_signals(SignalMemory(commands=(numbered(1),)), states, DRIVEN)
    assert memory.answer.felt_s == pytest.approx(felt_s, abs=1e-6)


# From windows to memory ----------------------------------------------------------------------------------------------


def test_a_window_is_full_after_18_ms_and_the_next_begins_with_its_last_state() -> None:
    states = [ROBOT.state(i) for i in range(7)]
    memory, _ = check_signals(SignalMemory(), states[:6], IDLE)
    assert memory.states == tuple(states[:6])
    memory, _ = check_signals(memory, states[6:], IDLE)
    assert memory.states == (states[6],)


def numbered(key: int) -> JointCommand:
    return JointCommand(key, ZERO, ZERO, ZERO, Gains.policy(), 1)


def test_a_load_may_answer_the_newest_commands_that_were_confirmed_and_all_later_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    memory, answered = SignalMemory(commands=tuple(numbered(key) for key in range(1, 7))), list[list[int]]()

    def disagreeing(_window: object, commands: Sequence[JointCommand]) -> np.ndarray:
        answered.append([command.key for command in commands])
        return ONE > 1

    monkeypatch.setattr(answer, "disagreeing", disagreeing)
    for key in (4, 2):
        states = [replace(ROBOT.state(i), last_command_key=key) for i in range(7)]
        check_signals(memory, states, DRIVEN)
    assert answered == [[2, 3, 4, 5, 6], [1, 2, 3, 4, 5, 6]]
    memory = SignalMemory()
    for key in range(1, 10):
        memory = check.asked(memory, numbered(key))
    assert [c.key for c in memory.commands] == [4, 5, 6, 7, 8, 9]


def test_loads_are_held_against_commands_only_while_those_drive_the_joints() -> None:
    wrong = [replace(ROBOT.state(i), load_nm=np.full(12, 300.0)) for i in range(7)]
    memory = check.asked(SignalMemory(load_windows=2 + 0 * still.NO_COUNTS[:12]), numbered(1))
    driven, _ = check_signals(memory, wrong, DRIVEN)
    assert set(driven.load_windows) == {3}
    idle, _ = check_signals(memory, wrong, IDLE)
    assert set(idle.load_windows) == {0}


@pytest.mark.parametrize(
    ("name", "restless"),
    [
        ("REST_SPEED_M_S", lambda v: window(linear_vel_of_body_in_odom_m_s=np.array([0.0, v, 0.0]))),
        ("REST_TURN_RATE_RAD_S", lambda v: window()._replace(turn_rad=np.array([0.0, 0.0, -v * 0.018]))),
        ("REST_JOINT_SPEED_RAD_S", lambda v: window()._replace(travel_rad=-v * 0.018 * ONE)),
    ],
)
def test_a_robot_at_rest_may_move_up_to_the_bound(name: str, restless: Any) -> None:
    bound = getattr(bounds, name)
    assert not check._is_restless(restless(bound))
    assert check._is_restless(restless(1.000001 * bound))
    states = [ROBOT.state(i) for i in range(7)]  # walks
    for situation, counted in ((STANDING, 5), (IDLE, 0), (DRIVEN, 0)):
        memory, _ = check_signals(SignalMemory(restless_windows=4), states, situation)
        assert memory.restless_windows == counted


def test_windows_of_a_stance_that_cannot_be_are_counted_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(legs, "is_stance_wrong", lambda _: True)
    for situation, counted in ((STANDING, 5), (IDLE, 0), (DRIVEN, 0)):
        memory, _ = check_signals(SignalMemory(wrong_stances=4), [ROBOT.state(i) for i in range(7)], situation)
        assert memory.wrong_stances == counted


# Signals that stand still --------------------------------------------------------------------------------------------

STEP = bounds.STILL_WINDOWS // bounds.QUICK_WINDOWS
KINDS = {
    "position_rad": (0, bounds.POSITION_NOISE_RAD),
    "velocity_rad_s": (12, bounds.VELOCITY_NOISE_RAD_S),
    "load_nm": (24, bounds.LOAD_NOISE_NM),
}


def counted(**moves: float | np.ndarray) -> np.ndarray:
    """Counts after one window from 3 each, in which joints moved by so many resolutions; from 1 N·m of load."""
    first = replace(ROBOT.state(0), position_rad=ZERO, velocity_rad_s=ZERO, load_nm=np.ones(12))
    changes = {name: getattr(first, name) + moves[name] * KINDS[name][1] for name in moves}
    body = {name: getattr(first, name) for name in ("odom_from_body_wxyz", "linear_vel_of_body_in_odom_m_s")}
    last = replace(ROBOT.state(6), **{n: getattr(first, n) for n in KINDS}, **body)
    last = replace(last, angular_vel_of_body_in_odom_rad_s=first.angular_vel_of_body_in_odom_rad_s)
    return still.still_windows(np.full(55, 3), first, replace(last, **changes), NONE, has_loads=True)


MOVES = np.where(ONE, 0.0, np.where(np.arange(12) == 0, 0.25, 1.0))
"""Eleven joints move, one of them less, which shows that the sensors resolve it; one stands."""


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize(
    ("factor", "step"), [(1.0, -1), (1.01, 1), (bounds.QUICK_FACTOR, 1), (1.01 * bounds.QUICK_FACTOR, STEP)]
)
def test_a_joint_that_stands_counts_while_others_move_and_more_where_they_are_quick(
    name: str, factor: float, step: int
) -> None:
    begin, noise = KINDS[name]
    first = replace(ROBOT.state(0), **{name: ZERO})
    after = still.still_windows(
        np.full(55, 3), first, replace(ROBOT.state(6), **{name: MOVES * factor * noise}), NONE, has_loads=True
    )
    step = min(step, 1) if name == "load_nm" else step
    np.testing.assert_array_equal(after[begin : begin + 12], np.where(ONE, 3 + step, 0))


@pytest.mark.parametrize("name", KINDS)
def test_a_joint_that_rests_may_repeat_a_position_or_velocity_but_not_both(name: str) -> None:
    begin, noise = KINDS[name]
    first = replace(ROBOT.state(0), position_rad=ZERO, velocity_rad_s=ZERO, load_nm=ZERO)
    moving = {other: np.full(12, 10.0) for other in KINDS}
    alone = replace(ROBOT.state(6), **{**moving, name: MOVES * 2.0 * noise})
    judged = 2 if name != "load_nm" else 4
    assert still.still_windows(np.full(55, 3), first, alone, ONE, has_loads=True)[begin + 3] == judged
    assert still.still_windows(np.full(55, 3), first, alone, ~ONE, has_loads=True)[begin + 3] == 4
    pair = replace(alone, position_rad=MOVES * 2.0 * 1e-4, velocity_rad_s=MOVES * 2.0 * 0.01)
    assert set(still.still_windows(np.full(55, 3), first, pair, ~NONE, has_loads=True)[[3, 15]]) == {4}


def test_a_joint_rests_while_its_position_and_velocity_agree() -> None:
    """A fifth of a radian a second, for 18 ms: the slope's 0.04 rad in 0.2 s."""
    allowed = 0.04 * 0.018 / 0.2
    for moved, travelled, rests in (
        (0.99 * allowed, 0.0, True),
        (-1.01 * allowed, 0.0, False),
        (0.0, 0.99 * allowed, True),
        (0.0, 1.01 * allowed, False),
        (1.0, 1.0 - 0.99 * allowed, True),
        (1.0, -1.0, False),
    ):
        seen = window(position_rad=moved * ONE)._replace(travel_rad=travelled * ONE)
        seen = seen._replace(
            first=replace(seen.first, position_rad=ZERO + 0.5),
            last=replace(seen.last, position_rad=seen.last.position_rad + 0.5),
        )
        assert motion.resting(seen).tolist() == [rests or joint != 3 for joint in range(12)]


def test_a_joint_that_misses_by_just_as_much_as_is_allowed_rests() -> None:
    seen = window()
    allowed = bounds.SLOPE_RAD * seen.duration_s / bounds.SLOPE_MEMORY_S
    assert motion.resting(seen._replace(travel_rad=ZERO + allowed)).all()
    assert not motion.resting(seen._replace(travel_rad=ZERO - np.nextafter(allowed, 1.0))).any()


def test_resting_excuses_only_while_commands_drive_the_joints() -> None:
    """In ready, where the vendor's stand keeps the robot still, the noise of the neighbours alone is the measure."""
    states = [replace(ROBOT.state(i), velocity_rad_s=np.full(12, 1e-6 * i)) for i in range(7)]
    noise = 2e-4 * MOVES
    for i, state in enumerate(states):
        states[i] = replace(state, position_rad=(i % 2) * noise if i < 6 else noise)
    for situation, count in ((STANDING, 1), (IDLE, 1), (DRIVEN, 0)):
        memory, _ = check_signals(SignalMemory(), states, situation)
        assert memory.still[3] == count


def half_and_one(moved: float, least: float, count: int = 6) -> np.ndarray:
    """So many joints move by one amount, one by another; joint 11 stands."""
    return np.where(np.arange(12) < count, moved, np.where(np.arange(12) == 10, least, 0.0))


def test_half_of_the_joints_must_move() -> None:
    for moving, step in ((6, 1), (5, -1)):
        assert counted(position_rad=half_and_one(2.0, 0.5, moving))[11] == 3 + step


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize(("least", "step"), [(1.99, 1), (2.01, -1)])
def test_joints_that_move_by_few_steps_of_their_sensors_say_nothing(name: str, least: float, step: int) -> None:
    """The least change of any joint shows the step; three of them are needed."""
    begin, _ = KINDS[name]
    assert counted(**{name: half_and_one(6.0, least)})[begin + 11] == 3 + step


@pytest.mark.parametrize(("factor", "step"), [(bounds.QUICK_FACTOR, -1), (1.01 * bounds.QUICK_FACTOR, 1)])
def test_all_joints_of_a_kind_that_stand_count_while_the_joints_move_quickly(factor: float, step: int) -> None:
    assert set(counted(position_rad=factor)[12:24]) == {3 + step}
    assert set(counted(position_rad=factor)[24:36]) == {3 + step}
    assert set(counted(velocity_rad_s=factor)[24:36]) == {3 + step}
    assert set(counted(load_nm=10.0 * factor)[12:24]) == {2}, "loads tell of no motion"
    assert set(counted(velocity_rad_s=factor, load_nm=factor)[:12]) == {2}, "positions that all stand are no lie"


@pytest.mark.parametrize("before", [0, 1, 7])
def test_a_window_in_which_nothing_happens_takes_one_back(before: int) -> None:
    """So that nothing gathers in an hour in which a value repeats itself now and then."""
    first = replace(ROBOT.state(0), position_rad=ZERO, velocity_rad_s=ZERO, load_nm=np.ones(12))
    after = still.still_windows(np.full(55, before), first, first, NONE, has_loads=True)
    expected = np.full(55, max(0, before - 1))
    expected[36:48] = 0
    assert after.tolist() == expected.tolist()


def test_three_steps_are_enough() -> None:
    first = replace(ROBOT.state(0), position_rad=ZERO, velocity_rad_s=ZERO, load_nm=ZERO)
    last = replace(first, position_rad=half_and_one(0.75, 0.25))
    assert still.still_windows(np.full(55, 3), first, last, NONE, has_loads=True)[11] == 5


@pytest.mark.parametrize("name", KINDS)
def test_a_joint_of_which_one_signal_changes_is_not_still_as_a_whole(name: str) -> None:
    assert counted(**{name: 5.0 * ONE})[39] == 0


def test_loads_that_are_not_reported_are_not_still() -> None:
    first = replace(ROBOT.state(0), position_rad=ZERO, velocity_rad_s=ZERO, load_nm=ZERO)
    last = replace(first, position_rad=ZERO + 1.0, velocity_rad_s=ZERO + 1.0)
    for has_loads, count in ((False, 2), (True, 4)):
        after = still.still_windows(np.full(55, 3), first, last, NONE, has_loads=has_loads)
        assert set(after[24:36]) == {count}


def test_one_load_that_was_ever_reported_tells_that_loads_are() -> None:
    states = [replace(ROBOT.state(i), load_nm=ZERO) for i in range(13)]
    memory, _ = check_signals(SignalMemory(), states[:7], DRIVEN)
    assert not memory.has_loads
    states[6] = replace(states[6], load_nm=1e-9 * ONE)
    memory, _ = check_signals(SignalMemory(), states[:7], DRIVEN)
    assert memory.has_loads
    memory, _ = check_signals(memory, states[7:], DRIVEN)
    assert memory.has_loads


QUICK = bounds.QUICK_FACTOR * np.where(np.arange(12) == 0, 1.0, 0.0)
"""One joint alone moves."""
HALF = np.where(np.arange(12) < 6, 1.0, 0.0)


@pytest.mark.parametrize(
    ("moves", "count"),
    [
        (dict.fromkeys(("velocity_rad_s", "load_nm"), QUICK), 0),  # a position that stands, though all else moves
        (dict.fromkeys(KINDS, 1e-06 * HALF), 4),  # sensors that live show it in all that they report
        (dict.fromkeys(KINDS, 1e-06 * HALF * (np.arange(12) != 5)), 0),
        (dict.fromkeys(("position_rad", "velocity_rad_s"), 1e-06 * HALF), 0),
        *(({name: QUICK}, 0) for name in KINDS),
        ({"position_rad": 1.0001 * QUICK}, 4),
        ({"velocity_rad_s": 1.0001 * QUICK}, 4),
        ({"load_nm": 9.0 * QUICK}, 0),  # one step of a coarse sensor
    ],
)
def test_a_joint_of_which_nothing_changes_counts_while_half_of_the_others_live_or_one_is_quick(
    moves: dict[str, np.ndarray], count: int
) -> None:
    assert set(counted(**moves)[42:48]) == {count}


@pytest.mark.parametrize(("has_loads", "count"), [(False, 4), (True, 0)])
def test_joints_of_a_robot_that_reports_no_loads_live_by_position_and_velocity(has_loads: bool, count: int) -> None:
    first = replace(ROBOT.state(0), position_rad=ZERO, velocity_rad_s=ZERO, load_nm=ZERO)
    last = replace(first, position_rad=1e-6 * HALF, velocity_rad_s=1e-6 * HALF)
    assert set(still.still_windows(np.full(55, 3), first, last, NONE, has_loads=has_loads)[42:48]) == {count}


@pytest.mark.parametrize("steps", [(1e-4, 0.01, 0.055), (3e-4, 0.03, 0.2), (1e-3, 0.1, 1.0), (1e-4, 0.05, 3.0)])
@pytest.mark.parametrize("noise", [0.1, 0.5])
@pytest.mark.parametrize("rate_hz", [250, 333, 400])
def test_a_robot_at_rest_with_coarse_sensors_is_not_stopped(
    steps: tuple[float, ...], noise: float, rate_hz: int
) -> None:
    """Most values repeat, and a few cannot decide between two steps; its estimator has decimals of its own."""
    rng, robot, memory = np.random.default_rng(3), ROBOT.state(0), check.SignalMemory()
    middles = (facts.DEFAULT_POSITION_RAD + rng.uniform(-0.01, 0.01, 12), ZERO, STAND_LOAD_NM + rng.uniform(-1, 1, 12))
    for number in range(5 * rate_hz):
        values = [
            np.round((middle + noise * size * rng.standard_normal(12)) / step) * step
            for middle, size, step in zip(middles, (1e-4, 0.005, 0.05), steps, strict=True)
        ]
        x, y, z = 1e-6 * rng.standard_normal(3)
        state = replace(
            robot,
            robot_stamp_ns=robot.robot_stamp_ns + number * 10**9 // rate_hz,
            **dict(zip(KINDS, values, strict=True)),
            odom_from_body_wxyz=np.array([1.0, x, y, z]),
            linear_vel_of_body_in_odom_m_s=1e-3 * rng.standard_normal(3),
            angular_vel_of_body_in_odom_rad_s=1e-3 * rng.standard_normal(3),
            foot_contact=np.ones(4, dtype=np.bool_),
            imu=(),
        )
        memory, stops = check.check_signals(memory, [state], STANDING)
        assert stops == ()


@pytest.mark.parametrize(
    ("moves", "step"),
    [
        ({"position_rad": bounds.QUICK_FACTOR}, -1),
        ({"position_rad": 1.01 * bounds.QUICK_FACTOR}, 1),
        ({"velocity_rad_s": 1.01 * bounds.QUICK_FACTOR}, 1),
        ({"load_nm": 9.0 * bounds.QUICK_FACTOR}, -1),
    ],
)
def test_the_bodys_signals_count_while_joints_move_quickly_and_may_repeat_at_rest(
    moves: dict[str, float], step: int
) -> None:
    assert set(counted(**moves)[48:]) == {3 + step}


def test_each_of_the_bodys_signals_begins_anew_when_it_changes() -> None:
    first = ROBOT.state(0)
    same = replace(first, position_rad=first.position_rad + 1.0)
    assert set(still.still_windows(np.full(55, 3), first, same, NONE, has_loads=True)[48:]) == {4}
    for index in range(3):
        for place, name in ((49, "linear_vel_of_body_in_odom_m_s"), (52, "angular_vel_of_body_in_odom_rad_s")):
            moved = getattr(same, name).copy()
            moved[index] += 0.1
            after = still.still_windows(np.full(55, 3), first, replace(same, **{name: moved}), NONE, has_loads=True)
            assert [i for i in range(48, 55) if after[i] == 0] == [place + index]
    tilted = replace(same, odom_from_body_wxyz=np.array([0.8, 0.6, 0.0, 0.0]))
    assert [
        i for i in range(48, 55) if still.still_windows(np.full(55, 3), first, tilted, NONE, has_loads=True)[i] == 0
    ] == [48]


# Loads ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("asked_nm", "low_nm", "high_nm"),
    # 30 N·m, half of what was asked, and nothing for the lag of a robot at rest; a weak motor may give less, down to 0.
    [((0.0,), -30.0, 30.0), ((40.0,), -50.0, 90.0), ((-40.0,), -90.0, 50.0), ((20.0, -40.0), -90.0, 70.0)],
)
def test_a_load_may_lie_within_its_bound_of_what_was_asked(
    asked_nm: tuple[float, ...], low_nm: float, high_nm: float
) -> None:
    commands = [replace(numbered(1), load_nm=np.full(12, nm)) for nm in asked_nm]
    for load_nm, is_wrong in ((low_nm, False), (high_nm, False), (low_nm - 1e-9, True), (high_nm + 1e-9, True)):
        assert set(answer.disagreeing(window(load_nm=np.full(12, load_nm)), commands)) == {is_wrong}


def test_what_is_asked_of_one_joint_excuses_no_other() -> None:
    joints = np.arange(12)
    asked = replace(numbered(1), load_nm=np.where(joints == 3, 100.0, np.where(joints == 4, -100.0, 0.0)))
    for load_nm in (60.0, -60.0):
        measured = window(load_nm=np.where(joints == 7, load_nm, asked.load_nm))
        assert answer.disagreeing(measured, [asked]).tolist() == (joints == 7).tolist()


def test_a_load_may_lag_behind_position_and_velocity() -> None:
    """2 rad/s gained within 18 ms: 12 ms of kp·2 = 60·2·0.012 and of kd·2/0.018 = 1.5·2/0.018·0.012; kd·2 is asked."""
    gains = Gains(np.full(12, 60.0), np.full(12, 1.5))
    command = replace(numbered(1), gains=gains, position_rad=np.full(12, 0.1))
    moving = window(velocity_rad_s=np.full(12, 2.0))
    asked_nm = 60.0 * 0.1 - 1.5 * 2.0
    allowed_nm = 30.0 + 0.5 * asked_nm + 60.0 * 2.0 * 0.012 + 1.5 * 2.0 / 0.018 * 0.012
    for load_nm, is_wrong in ((asked_nm + allowed_nm - 1e-6, False), (asked_nm + allowed_nm + 1e-6, True)):
        state = replace(moving.last, load_nm=np.full(12, load_nm))
        assert set(answer.disagreeing(moving._replace(last=state), [command])) == {is_wrong}


# The inertial unit ---------------------------------------------------------------------------------------------------


def packet(**changes: Any) -> ImuPacket:
    level = ImuPacket(0, np.array([0.0, 0.0, 9.81]), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    return replace(level, **changes)


def test_the_units_attitude_and_turn_rate_may_differ_up_to_their_bounds(monkeypatch: pytest.MonkeyPatch) -> None:
    turned = window(imu=(packet(odom_from_link_wxyz=np.array([np.cos(0.15), np.sin(0.15), 0.0, 0.0])),))
    spun = window(imu=(packet(angular_vel_of_link_in_link_rad_s=np.array([0.0, 2.0, 0.0])),))
    angle = length(turned_rad(turned.last.odom_from_body_wxyz, turned.imu[0].odom_from_link_wxyz))
    assert angle == pytest.approx(0.3)
    monkeypatch.setattr(bounds, "IMU_ANGLE_RAD", angle)
    monkeypatch.setattr(bounds, "IMU_TURN_RATE_RAD_S", 2.0)
    before = motion.ImuMemory(angle_windows=2, turn_rate_windows=3)
    assert motion.after_imu_window(before, turned).angle_windows == 0
    assert motion.after_imu_window(before, spun).turn_rate_windows == 0
    monkeypatch.setattr(bounds, "IMU_ANGLE_RAD", below(angle))
    monkeypatch.setattr(bounds, "IMU_TURN_RATE_RAD_S", below(2.0))
    assert motion.after_imu_window(before, turned).angle_windows == 3
    assert motion.after_imu_window(before, spun).turn_rate_windows == 4


def test_a_robot_that_turns_may_disagree_by_a_share_of_its_turn_rate() -> None:
    spins = window(imu=(packet(angular_vel_of_link_in_link_rad_s=np.array([0.0, 0.0, 5.0])),))
    for rate_rad_s, counted_windows in ((10.0, 1), (6.0, 0)):
        # |5 − 10| = 5 beyond 1 + 0.3·10; |5 − 6| = 1 within 1 + 0.3·6
        turning = spins._replace(turn_rad=np.array([0.0, 0.0, rate_rad_s * spins.duration_s]))
        assert motion.after_imu_window(motion.ImuMemory(), turning).turn_rate_windows == counted_windows


@pytest.mark.parametrize("side", [1, -1])
def test_the_newest_packet_may_be_a_tenth_of_a_second_from_the_joints(side: int) -> None:
    before = motion.ImuMemory(stamp_windows=3)
    now_ns = window().last.robot_stamp_ns
    for apart_ns, count in ((100_000_000, 0), (100_000_001, 4), (199_190_000_000, 4)):
        packets = (packet(), packet(robot_stamp_ns=now_ns + side * apart_ns))
        after = motion.after_imu_window(before, window(imu=packets))
        assert after.stamp_windows == count
        assert after.stamp_error_s == pytest.approx(side * apart_ns / 1e9)


def test_stamps_of_another_clock_are_told_with_their_error() -> None:
    (doubt,) = check._doubts(SignalMemory(imu=motion.ImuMemory(stamp_windows=bounds.IMU_WINDOWS, stamp_error_s=199.19)))
    assert doubt.stop.detail == "stamps of the inertial unit and of the joints"
    assert doubt.stop.values == {"apart_s": 199.19, "bound_s": 0.1}
    assert not list(check._doubts(SignalMemory(imu=motion.ImuMemory(stamp_windows=bounds.IMU_WINDOWS - 1))))


def test_packets_of_a_window_are_averaged() -> None:
    pair = (packet(angular_vel_of_link_in_link_rad_s=np.array([0.0, 3.0, 0.0])), packet())
    assert motion.after_imu_window(motion.ImuMemory(), window(imu=pair)).turn_rate_windows == 1
    many = motion.after_imu_window(motion.ImuMemory(), window(imu=(packet(),) * 5))
    np.testing.assert_allclose(many.force_m_s2, [0.0, 0.0, 9.81 * 0.018])


def test_what_was_felt_fades_within_its_memory_and_is_judged_after_a_quarter_of_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(bounds, "GRAVITY_MEMORY_S", 2.0)
    assert motion.ImuMemory(np.array([3.0, 0.0, 3.0]), 0.499).tilt_error_rad == 0.0
    assert motion.ImuMemory(np.array([3.0, 0.0, 3.0]), 0.5).tilt_error_rad == pytest.approx(np.pi / 4.0)
    assert motion.after_imu_window(motion.ImuMemory(felt_s=1.0), window(imu=(packet(),))).felt_s == pytest.approx(
        1.0 - 0.009 + 0.018
    )


# Numbers by hand ------------------------------------------------------------------------------------------------------


def test_feet_stand_below_their_hips() -> None:
    feet_m = legs.feet(np.array(facts.DEFAULT_POSITION_RAD), ZERO).position_m
    for i, leg in enumerate(facts.LEG_NAMES):
        assert np.sign(feet_m[i, 0]) == facts.end_sign(leg)
        assert np.sign(feet_m[i, 1]) == facts.side_sign(leg)
        assert abs(feet_m[i, 0]) == pytest.approx(facts.HX_FROM_BODY_M[0], abs=0.2)


def test_feet_of_legs_that_are_stretched() -> None:
    """All joints at 0: thigh and shank hang down, outside of the hips."""
    thigh_x, _, thigh_z = facts.KN_FROM_HY_M
    for i, leg in enumerate(facts.LEG_NAMES):
        expected = [
            (1.0 if leg.startswith("f") else -1.0) * facts.HX_FROM_BODY_M[0] + thigh_x,
            (1.0 if leg.endswith("l") else -1.0) * (facts.HX_FROM_BODY_M[1] + facts.HY_FROM_HX_M[1]),
            thigh_z + facts.FOOT_FROM_KN_M[2],
        ]
        assert legs.feet(ZERO, ZERO).position_m[i] == pytest.approx(expected)


def test_lower_legs_turn_with_hips_and_knees() -> None:
    """About the axes of a leg that hx has turned by 0.3 rad: 1 rad/s about x, 2 + 0.5 rad/s about its own y."""
    rates = legs.feet(np.tile([0.3, 0.9, -1.5], 4), np.tile([1.0, 2.0, 0.5], 4)).turn_rate_rad_s
    np.testing.assert_allclose(rates, np.tile([1.0, 2.5 * np.cos(0.3), 2.5 * np.sin(0.3)], (4, 1)))


def test_a_foot_that_rolls_has_the_speed_of_what_it_rolls_by() -> None:
    """Body and foot turn about y by 1 and 2 rad/s: the sole moves by 3 rad/s times the radius."""
    still = legs.Feet(np.zeros((4, 3)), np.zeros((4, 3)), np.tile([0.0, 2.0, 0.0], (4, 1)))
    turn, up = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    speeds = legs.sole_speeds_m_s(still, velocity_m_s=np.zeros(3), turn_rate_rad_s=turn, up=up)
    assert speeds == pytest.approx(np.full(4, 3.0 * facts.FOOT_RADIUS_M))


def test_the_sole_of_a_foot_that_rolls_forward_stands() -> None:
    rolling = legs.Feet(np.zeros((4, 3)), np.zeros((4, 3)), np.tile([0.0, 3.0, 0.0], (4, 1)))
    ahead, up = np.array([3.0 * facts.FOOT_RADIUS_M, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    speeds = legs.sole_speeds_m_s(rolling, velocity_m_s=ahead, turn_rate_rad_s=np.zeros(3), up=up)
    assert speeds == pytest.approx(np.zeros(4), abs=1e-12)


def test_only_feet_that_touch_throughout_are_judged_and_the_slowest_counts() -> None:
    rates = np.repeat([1.0, 3.0, 0.0, 0.0], 3)
    begun = np.array([True, True, False, False])
    for ended, speeds in ((begun, True), (~begun, False)):
        seen = window(position_rad=np.array(facts.DEFAULT_POSITION_RAD), velocity_rad_s=rates, foot_contact=ended)
        seen = seen._replace(first=replace(seen.first, foot_contact=begun))
        after = ground.after_window(ground.GroundMemory(), seen, None)
        assert (after.touching_s > 0.0) is speeds
        soles = legs.sole_speeds_m_s(
            legs.feet(facts.DEFAULT_POSITION_RAD, rates),
            velocity_m_s=np.zeros(3),
            turn_rate_rad_s=np.zeros(3),
            up=np.array([0.0, 0.0, 1.0]),
        )
        assert after.speed_m_s == pytest.approx(soles[0] if speeds else 0.0)
        assert soles[0] < soles[1]


def test_a_window_knows_the_range_of_each_velocity_and_holds_no_gap(monkeypatch: pytest.MonkeyPatch) -> None:
    states = [replace(ROBOT.state(i), velocity_rad_s=np.arange(12) * (i - 3.0)) for i in range(7)]
    made = window_of(states)
    assert made is not None
    np.testing.assert_allclose(made.velocity_range_rad_s, np.arange(12) * 6.0)
    exactly_s = float(np.diff([(state.robot_stamp_ns - states[0].robot_stamp_ns) / 1e9 for state in states]).max())
    monkeypatch.setattr(bounds, "GAP_S", exactly_s)
    assert window_of(states) is not None
    monkeypatch.setattr(bounds, "GAP_S", below(exactly_s))
    assert window_of(states) is None


@pytest.mark.parametrize("changed", [(), (2,), (0, 1, 2, 3)])
@pytest.mark.parametrize("touched", [True, False])
def test_one_foot_that_lifts_off_or_touches_down_is_a_change(touched: bool, changed: tuple[int, ...]) -> None:
    contacts = np.full(4, touched)
    states = [replace(ROBOT.state(i), foot_contact=contacts) for i in range(7)]
    contacts = contacts.copy()
    contacts[list(changed)] = not touched
    states[3] = replace(states[3], foot_contact=contacts)
    made = window_of(states)
    assert made is not None
    assert made.contact_changed is bool(changed)


def test_a_foot_moves_with_the_body_with_its_turn_and_with_its_leg() -> None:
    """Along y: 1 m/s of the body, 2 rad/s at 1 m from its middle, and 0.5 m/s of the leg."""
    away, ahead = np.tile([1.0, 0.0, 0.0], (4, 1)), np.array([0.0, 1.0, 0.0])
    moving = legs.Feet(away, np.tile(0.5 * ahead, (4, 1)), np.zeros((4, 3)))
    turn, up = np.array([0.0, 0.0, 2.0]), np.array([0.0, 0.0, 1.0])
    speeds = legs.sole_speeds_m_s(moving, velocity_m_s=ahead, turn_rate_rad_s=turn, up=up)
    assert speeds == pytest.approx(np.full(4, 3.5))


def test_a_window_is_turned_as_its_last_state() -> None:
    turned = np.array([np.cos(0.1), 0.0, 0.0, np.sin(0.1)])
    assert window(odom_from_body_wxyz=turned).odom_from_body[0, 0] == pytest.approx(np.cos(0.2))


def test_losses_are_counted_over_exactly_so_many_keys() -> None:
    memory = confirm(LossMemory(), 1)
    for key in range(5, 1500, 4):
        memory = confirm(memory, key)
    assert (memory.first_key, memory.share) == (1, 0.0)
    assert confirm(memory, 1500).first_key == 1
    full = confirm(memory, 1501)
    assert full.first_key == 1501
    assert full.share > 0.5


def test_half_an_ampere_is_a_charge_or_a_discharge() -> None:
    def slow(current_a: float, stamp_s: float) -> SlowState:
        return SlowState(0, round(stamp_s * 1e9), True, False, 50.0, 52.0, current_a)

    def after(memory: BatteryMemory, current_a: float, stamp_s: float) -> tuple[BatteryMemory, Stop | None]:
        return watch_battery(memory, slow(current_a, stamp_s), round(stamp_s * 1e9), 3.0)

    assert after(BatteryMemory(), -0.5, 1.0)[0].has_discharged
    assert not after(BatteryMemory(), 0.0, 1.0)[0].has_discharged
    charging, stop = after(BatteryMemory(has_discharged=True), 0.5, 1.0)
    assert stop is None
    assert charging.charging_since_ns == 1_000_000_000
    assert after(charging, 0.5, 11.0)[1] is not None
