"""Joint control takes hold of robots whose joints are where they are reported, and of some whose joints are not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.state import Gains, JointCommand, RobotState
from spot_runtime.control.modes import TAKE_HOLD_S
from spot_runtime.control.safety.signals import answer, bounds, check
from spot_runtime.control.safety.signals.answer import HoldMemory, after_hold_window, hold_words
from spot_runtime.control.safety.signals.readers import Signal
from spot_runtime.control.set_point import hold_setpoint, taking_hold
from spot_runtime.stops import Stop, StopReason
from tests.spot_runtime.resting_robot import Stand, drawn_stand
from tests.spot_runtime.test_loop import drive, make_loop, modes_of
from tests.spot_runtime.walking_robot import WalkingRobot

ZERO = np.zeros(12)
ALL = np.ones(12, dtype=np.bool_)
GAINS = Gains(np.tile([10.0, 20.0, 40.0], 4), np.full(12, 2.0))
HELD = check.Situation(is_held=True)
Lie = Callable[[Array], Array]

# Robots --------------------------------------------------------------------------------------------------------------


def state_of(index: int, **changes: object) -> RobotState:
    return replace(WalkingRobot(is_walking=False, noise=0.0).state(index), **changes)  # type: ignore[arg-type]


def taken_hold_of(
    stand: Stand, lie: Lie, rng: np.random.Generator, situation: check.Situation = HELD
) -> tuple[float, Stop] | None:
    """What is doubted first, and when, s after the robot confirmed joint control.

    Motors err by 15 % in their gains, gears hold back by 4 N·m, sensors are off by 4 N·m, and all of it has noise. The
    ground and the other legs hold each joint like a spring.
    """
    gain, held_back_nm, offset_nm = rng.uniform(0.85, 1.15, 12), rng.uniform(-4, 4, 12), rng.uniform(-4, 4, 12)
    spring_nm_per_rad = rng.uniform(100.0, 2000.0, 12)
    setpoint = hold_setpoint(lie(stand.position_rad), stand.load_nm + offset_nm)
    memory, command, before_rad = check.SignalMemory(), None, lie(stand.position_rad)
    for index in range(round(TAKE_HOLD_S / 0.003) + 30):
        if index % 7 == 0:
            soft = taking_hold(setpoint, 0.003 * index)
            command = JointCommand(index + 1, soft.position_rad, ZERO, soft.load_nm, soft.gains, 1)
            memory = check.asked(memory, command)
        assert command is not None
        kp = gain * command.gains.kp_nm_per_rad
        at_rest_nm = kp * (command.position_rad - stand.position_rad) + gain * command.load_nm
        moved_rad = (at_rest_nm + held_back_nm - stand.load_nm) / (spring_nm_per_rad + kp)
        said_rad = lie(stand.position_rad + moved_rad)
        state = state_of(
            index,
            position_rad=said_rad + 3e-4 * rng.standard_normal(12),
            velocity_rad_s=(said_rad - before_rad) / 0.003 + 0.03 * rng.standard_normal(12),
            load_nm=at_rest_nm - kp * moved_rad + offset_nm + 0.4 * rng.standard_normal(12),
            last_command_key=index,
        )
        before_rad = said_rad
        memory, doubts = check.check_signals(memory, [state], situation)
        for doubt in doubts:
            assert doubt.suspects == {Signal.LOAD, Signal.POSITION}
            return 0.003 * index, doubt.stop
    return None


@pytest.mark.parametrize("seed", range(12))
def test_a_robot_whose_joints_are_where_they_are_reported_is_taken_hold_of(seed: int) -> None:
    rng = np.random.default_rng(seed)
    stand = drawn_stand(rng, payload_kg=rng.uniform(0.0, 14.0), slope_rad=rng.uniform(0.0, 0.2))
    assert taken_hold_of(stand, lambda position: position, rng) is None


def offset(joint: int, by_rad: float) -> Lie:
    return lambda position: position + np.where(np.arange(12) == joint, by_rad, 0.0)


def mirrored(*joints: int) -> Lie:
    return lambda position: np.where(np.isin(np.arange(12), joints), -position, position)


def exchanged(a: int, b: int) -> Lie:
    order = np.arange(12)
    order[[a, b]] = b, a
    return lambda position: position[order]


LIES: dict[str, tuple[Lie, tuple[int, ...], str]] = {
    "a knee off by 0.3": (offset(5, 0.3), (5,), ""),
    "a knee off by -0.3": (offset(11, -0.3), (11,), ""),
    "all knees off by 0.3": (lambda q: q + np.tile([0.0, 0.0, 0.3], 4), (2, 5, 8, 11), ""),
    "a hip off by 0.2": (offset(7, 0.2), (7,), ""),
    "a hip's side mirrored": (mirrored(0), (0,), ""),
    "a hip mirrored": (mirrored(4), (4,), "as if mirrored"),
    "all hips mirrored": (mirrored(1, 4, 7, 10), (1, 4, 7, 10), "as if mirrored"),
    "the front hips' sides exchanged": (exchanged(0, 3), (0, 3), ""),
    "hip and knee exchanged": (exchanged(1, 2), (1, 2), "as if exchanged with"),
    "a hip's side and a knee exchanged": (exchanged(6, 8), (6, 8), "as if exchanged with"),
}


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("name", LIES)
def test_joints_that_are_not_where_they_are_reported_are_refused_by_name(name: str, seed: int) -> None:
    lie, joints, looks_like = LIES[name]
    rng = np.random.default_rng(seed)
    stand = drawn_stand(rng, spread_m=0.1)  # so that a side that is mirrored is another angle
    found = taken_hold_of(stand, lie, rng)
    assert found is not None
    after_s, stop = found
    assert stop.reason is StopReason.POSITION_REFUSED
    # A joint that is said to lie beyond its stop is not judged here, and its neighbour is once it is held more stiffly.
    assert after_s < (0.45 if "knee exchanged" in name else 0.3)
    told = [facts.JOINT_NAMES.index(part.split(" ", 1)[0]) for part in stop.detail.split("; ")]
    assert told
    assert set(told) <= set(joints), stop.detail
    # What an exchange looks like is known once both joints have answered.
    assert looks_like in stop.detail or ("exchanged" in looks_like and len(told) == 1)


def test_a_robot_with_such_a_joint_is_handed_back_before_the_policy_has_it(robot: Any, zero_policy: Policy) -> None:
    """Its knee is 0.3 rad from where it is reported, and its servo knows."""

    def answering(state: RobotState) -> list[RobotState]:
        if not robot.sent:
            return [state]
        sent = robot.sent[-1]
        apart_rad = sent.position_rad - state.position_rad - np.where(np.arange(12) == 5, 0.3, 0.0)
        return [replace(state, load_nm=sent.gains.kp_nm_per_rad * apart_rad + sent.load_nm)]

    robot.mutate = answering
    loop, sink = make_loop(robot, zero_policy)
    drive(loop)
    assert loop.stop is not None
    assert loop.stop.reason is StopReason.POSITION_REFUSED
    assert loop.stop.detail.startswith("fr_kn reports -1.50 rad")
    assert modes_of(sink) == ["activating", "standing"]
    assert max(command.gains.kp_nm_per_rad[5] for command in robot.sent) < 0.5 * Gains.stand().kp_nm_per_rad[5]


def test_only_while_joint_control_takes_hold_is_a_held_pose_judged() -> None:
    rng = np.random.default_rng(3)
    stand = drawn_stand(rng)
    assert taken_hold_of(stand, offset(5, 0.3), rng, check.Situation()) is None


# By hand -------------------------------------------------------------------------------------------------------------


def command(load_nm: float = 0.0) -> JointCommand:
    return JointCommand(1, ZERO, ZERO, np.full(12, load_nm), GAINS, 1)


@pytest.mark.parametrize("load_nm", [0.0, 20.0, -20.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_load_beside_what_is_asked_by_ten_and_two_fifths_of_it_counts(load_nm: float, side: float) -> None:
    allowed_nm = 10.0 + 0.4 * abs(load_nm)
    before = HoldMemory(windows=np.full(12, 4))
    for beside_nm, count in ((allowed_nm - 1e-9, 0), (allowed_nm + 1e-9, 5)):
        load = np.full(12, load_nm + side * beside_nm)
        states = [state_of(i, position_rad=ZERO, velocity_rad_s=ZERO, load_nm=load) for i in range(7)]
        after = after_hold_window(before, states, command(load_nm), ALL)
        assert set(after.windows) == {count}
        np.testing.assert_allclose(after.answers_rad, -side * beside_nm / GAINS.kp_nm_per_rad)


def test_states_of_a_window_are_averaged_and_positions_are_told_by_the_servos_law() -> None:
    states = [
        state_of(
            i,
            position_rad=np.full(12, 0.1 * i),
            velocity_rad_s=np.full(12, 1.0 * i),
            load_nm=np.full(12, -30.0 - 10.0 * i),
        )
        for i in range(3)
    ]
    after = after_hold_window(HoldMemory(), states, command(), ALL)
    # Asked at 0.1 rad and 1 rad/s: -kp · 0.1 - 2; the mean load is -40.
    unasked = -40.0 + 0.1 * GAINS.kp_nm_per_rad + 2.0
    np.testing.assert_allclose(after.said_rad, 0.1)
    np.testing.assert_allclose(after.answers_rad, 0.1 - unasked / GAINS.kp_nm_per_rad)
    assert set(after.windows) == {1}


def test_a_load_that_is_not_measured_is_not_judged() -> None:
    states = [state_of(i, position_rad=ZERO, velocity_rad_s=ZERO, load_nm=np.full(12, 99.0)) for i in range(7)]
    after = after_hold_window(HoldMemory(windows=np.full(12, 1)), states, command(), np.arange(12) != 3)
    assert after.windows.tolist() == [2, 2, 2, 0, *[2] * 8]


def test_a_joint_is_wrong_after_two_windows_in_a_row() -> None:
    memory = HoldMemory(windows=np.arange(12))
    assert bounds.HELD_WINDOWS == 2
    assert memory.is_wrong.tolist() == [False, False, *[True] * 10]
    assert list(check._doubts(check.SignalMemory(hold=HoldMemory(windows=np.full(12, 1))))) == []
    (doubt,) = check._doubts(check.SignalMemory(hold=memory._replace(windows=2 * (np.arange(12) == 5))))
    assert doubt.suspects == {Signal.LOAD, Signal.POSITION}
    assert doubt.stop == Stop(StopReason.POSITION_REFUSED, "fr_kn reports +0.00 rad and answers as at about +0.00")


@pytest.mark.parametrize(
    ("said", "answers", "told"),
    [
        ({1: 0.9}, {1: 1.2}, "fl_hy reports +0.90 rad and answers as at about +1.20"),
        ({1: 0.9}, {1: -0.9}, "fl_hy reports +0.90 rad and answers as at about -0.90, as if mirrored"),
        ({1: 0.9}, {1: -0.46}, "fl_hy reports +0.90 rad and answers as at about -0.46, as if mirrored"),
        ({1: 0.9}, {1: -0.44}, "fl_hy reports +0.90 rad and answers as at about -0.44"),
        (
            {1: 0.9, 2: -1.5},
            {1: -1.4, 2: 0.8},
            (
                "fl_hy reports +0.90 rad and answers as at about -1.40, as if exchanged with fl_kn; "
                "fl_kn reports -1.50 rad and answers as at about +0.80, as if exchanged with fl_hy"
            ),
        ),
    ],
)
def test_the_words_say_where_a_joint_answers_and_what_that_looks_like(
    said: dict[int, float], answers: dict[int, float], told: str
) -> None:
    values = (np.array([given.get(joint, 0.0) for joint in range(12)]) for given in (said, answers))
    assert hold_words(HoldMemory(np.where(np.isin(np.arange(12), list(said)), 2, 0), *values)) == told


def test_an_error_of_just_a_third_is_not_alike() -> None:
    """0.9 said, -0.45 answered: 0.45 from its mirror image, a third of the error of 1.35."""
    assert answer._ALIKE == 1.0 / 3.0
    assert "mirrored" not in hold_words(HoldMemory(2 * (np.arange(12) == 1), np.full(12, 0.75), np.full(12, -0.375)))


def test_a_command_that_is_not_confirmed_yet_is_not_held_against_the_loads() -> None:
    wrong = [state_of(i, load_nm=np.full(12, 99.0), last_command_key=3) for i in range(7)]
    memory = check.SignalMemory(has_loads=True)
    for key, windows in ((4, 0), (3, 1)):
        asked = check.asked(memory, replace(command(), key=key))
        after, _ = check.check_signals(asked, wrong, HELD)
        assert set(after.hold.windows) == {windows if key == 3 else 0}
        assert after.answer.felt_s == 0.0


def test_what_a_hold_has_shown_is_forgotten_when_it_is_over() -> None:
    wrong = [state_of(i, last_command_key=3) for i in range(7)]
    memory = check.asked(check.SignalMemory(hold=HoldMemory(windows=np.full(12, 2))), replace(command(), key=3))
    after, _ = check.check_signals(memory, wrong, check.Situation(is_driven=True))
    assert not after.hold.windows.any()
