"""Loads as answers to set-points, worked out by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from spot_model.robot import facts
from spot_model.robot.state import Gains, JointCommand
from spot_runtime.control.safety.signals import answer, bounds, check
from spot_runtime.control.safety.signals.answer import AnswerMemory, _apart, _is_anothers, _is_wrong, after_window
from spot_runtime.control.safety.signals.readers import Signal
from spot_runtime.stops import StopReason
from tests.spot_runtime.test_signal_memories import window
from tests.spot_runtime.walking_robot import WalkingRobot

ZERO = np.zeros(12)
ALL = np.ones(12, dtype=np.bool_)
IDLE, DRIVEN = check.Situation(), check.Situation(is_driven=True)
GAINS = Gains(np.tile([10.0, 20.0, 40.0], 4), np.full(12, 2.0))


def legs(*values: float) -> np.ndarray:
    """The same value for the three joints of each leg."""
    return np.repeat(values, 3)


def command(key: int = 1, position_rad: np.ndarray = ZERO, load_nm: np.ndarray = ZERO) -> JointCommand:
    return JointCommand(key, position_rad, ZERO, load_nm, GAINS, 1)


def test_what_a_command_asks_is_the_servos_law() -> None:
    asked = answer.torque_nm(command(1, np.full(12, 0.5), np.full(12, 3.0)), np.full(12, 0.1), np.full(12, 0.25))
    np.testing.assert_allclose(asked, np.tile([4.0, 8.0, 16.0], 4) + 3.0 - 0.5)


def test_what_legs_would_have_been_asked_with_the_set_points_of_others() -> None:
    apart = _apart(command(1, legs(0.1, 0.2, 0.4, 0.8), legs(1.0, 2.0, 4.0, 8.0)))
    for own in range(4):
        for other in range(4):
            step = 0.1 * (2.0**other - 2.0**own)
            np.testing.assert_allclose(apart[own, other], step * np.array([10.0, 20.0, 40.0]) + 10.0 * step)


def test_sums_fade_and_add_up() -> None:
    before = AnswerMemory(
        0.3, *(np.full(12, n) for n in (1.0, 2.0, 3.0, 0.5, 6.0)), *(np.full((4, 4), n) for n in (4.0, 5.0))
    )
    before = before._replace(wrong_windows=np.full(12, 3), anothers_windows=np.full(4, 2))
    seen = window(load_nm=np.full(12, 5.0), velocity_rad_s=np.full(12, -1.0))
    after = after_window(before, seen, command(1, legs(0.1, 0.2, 0.2, 0.2)), ALL)
    fade, time = 1.0 - 0.018 / 0.5, 0.018
    assert after.felt_s == pytest.approx(0.3 * fade + time)
    asked = np.array([1.0, 2.0, 4.0, *(2.0, 4.0, 8.0) * 3]) + 2.0
    np.testing.assert_allclose(after.asked_asked, 1.0 * fade + asked**2 * time)
    np.testing.assert_allclose(after.asked_load, 2.0 * fade + asked * 5.0 * time)
    np.testing.assert_allclose(after.load_load, 3.0 * fade + 25.0 * time)
    np.testing.assert_allclose(after.unasked, 0.5 * fade + (5.0 - asked) * time)
    np.testing.assert_allclose(after.given_given, 6.0 * fade + asked**2 * time)
    # Between the first leg and any other lie 1, 2 and 4 N·m: 21 N²·m² together; between the others, nothing.
    squares = np.zeros((4, 4))
    squares[0, 1:] = squares[1:, 0] = 21.0
    np.testing.assert_allclose(after.apart, 4.0 * fade + squares * time, atol=1e-12)
    # With its own set-points the first leg is asked 3, 4 and 6 N·m, with those of another 4, 6 and 10, and gives 5.
    missed = np.array([[4 + 1 + 1, *(1 + 1 + 25,) * 3], *([6, 27, 27, 27],) * 3], dtype=float)
    np.testing.assert_allclose(after.missed, 5.0 * fade + missed * time)
    assert not after.wrong_windows.any()
    assert not after.anothers_windows.any()
    forgotten = after_window(before, seen._replace(duration_s=3.0), command(), ALL)
    assert forgotten.felt_s == pytest.approx(3.0)
    np.testing.assert_allclose(forgotten.load_load, 75.0)


@pytest.mark.parametrize(
    ("asked_nm", "share", "is_wrong"),
    [
        (15.0, 1.0, False),
        (15.0, 0.0, False),
        (15.0, -1e-6, True),
        (15.0, -1.0, True),
        (14.999, -1.0, False),
        (15.0, 2.0, False),
        (15.0, 2.001, True),
        (14.999, 9.0, False),
    ],
)
def test_a_load_may_lie_between_nothing_and_twice_what_is_asked(asked_nm: float, share: float, is_wrong: bool) -> None:
    for felt_s in (0.25, 0.5):
        square = asked_nm**2 * felt_s
        found = _is_wrong(AnswerMemory(felt_s, np.full(12, square), legs(1.0, share, 1.0, 1.0) * square))
        assert found.tolist() == [False] * 3 + [is_wrong] * 3 + [False] * 6


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("asked_nm", [0.0, 20.0, 200.0])
def test_a_mean_load_may_lie_beside_what_is_asked_by_ten_and_two_fifths_of_it(asked_nm: float, side: float) -> None:
    felt_s, square = 0.4, asked_nm**2 * 0.4
    allowed = (10.0 + 0.4 * asked_nm) * felt_s
    for share, is_wrong in ((1.0 - 1e-9, False), (1.0 + 1e-9, True)):
        unasked = side * share * allowed * legs(0.0, 1.0, 0.0, 0.0)
        sums = AnswerMemory(felt_s, np.full(12, 9.0 * square), np.full(12, 9.0 * square))
        found = _is_wrong(sums._replace(unasked=unasked, given_given=np.full(12, square)))
        assert found.tolist() == [False] * 3 + [is_wrong] * 3 + [False] * 6


def test_a_load_that_is_not_measured_is_taken_for_the_one_that_the_motor_could_give() -> None:
    measured = np.arange(12) % 6 < 3
    asked = np.tile([20.0, 40.0, 80.0], 4)
    most = answer.motor_torque_nm(ZERO)
    assert most[2] < 80.0
    after = after_window(AnswerMemory(), window(load_nm=np.full(12, -70.0)), command(1, np.full(12, 2.0)), measured)
    given = np.minimum(asked, most)
    load_nm = np.where(measured, -70.0, given)
    np.testing.assert_allclose(after.asked_load, asked * load_nm * 0.018)
    np.testing.assert_allclose(after.unasked, (load_nm - given) * 0.018)
    np.testing.assert_allclose(after.given_given, given**2 * 0.018)
    np.testing.assert_allclose(after.load_load, load_nm**2 * 0.018)
    np.testing.assert_allclose(after.missed[1, 0], ((load_nm - asked)[3:6] ** 2).sum() * 0.018)
    back = after_window(AnswerMemory(), window(load_nm=-most), command(1, np.full(12, -20.0)), ALL)
    np.testing.assert_allclose(back.unasked, 0.0, atol=1e-12)


def test_a_motor_gives_what_its_kind_can_and_a_knee_what_its_lever_lets_it() -> None:
    position = np.tile([0.0, 0.0, -2.0], 4)
    most = answer.motor_torque_nm(position).reshape(4, 3)
    assert set(most[:, :2].ravel()) == {facts.HIP_TORQUE_LIMIT_NM}
    bent, straight = (answer.motor_torque_nm(np.full(12, angle_rad))[2] for angle_rad in (-1.6, -2.7))
    assert bent > 1.5 * straight


@pytest.mark.parametrize("name", ["low", "high"])
def test_a_joint_within_its_bound_of_a_stop_may_lie_on_it(name: str) -> None:
    stops = facts.POSITION_LOW_RAD if name == "low" else facts.POSITION_HIGH_RAD
    inside = 1.0 if name == "low" else -1.0
    assert answer.at_stop(stops + inside * 0.999 * bounds.STOP_RAD).all()
    assert not answer.at_stop(stops + inside * bounds.STOP_RAD).any()
    only = np.array(facts.DEFAULT_POSITION_RAD)
    only[4] = stops[4]
    assert answer.at_stop(only).tolist() == [joint == 4 for joint in range(12)]


@pytest.mark.parametrize(
    ("apart_nm", "missed", "is_anothers"),
    [(15.0, 11.999, True), (15.0, 12.0, False), (14.999, 0.0, False), (15.0, 0.0, True)],
)
def test_another_legs_set_points_must_explain_more_than_any_factor_of_the_own(
    apart_nm: float, missed: float, is_anothers: bool
) -> None:
    """Squares of 5, 5 and 5, of which 1 each is explained: (asked · load)² / asked² = 0.5² / 0.25; 12 are left."""
    sums = AnswerMemory(0.5, np.full(12, 0.25), np.full(12, 0.5), np.full(12, 5.0), missed=np.full((4, 4), 99.0))
    sums.missed[2, 1] = missed
    apart = np.full((4, 4), 3.0 * apart_nm**2 * 0.5)
    assert _is_anothers(sums._replace(apart=apart)).tolist() == [False, False, is_anothers, False]
    assert not _is_anothers(sums._replace(apart=0.0 * apart)).any()
    nothing_asked = sums._replace(apart=apart, asked_asked=ZERO, asked_load=ZERO)
    assert _is_anothers(nothing_asked)[2] == (missed < 15.0 and apart_nm == 15.0)


def answered(windows: int, sizes: np.ndarray, *, as_leg: int | None = None) -> AnswerMemory:
    """After windows in which the second leg's set-point is now on one side, now on the other, and the others' stay."""
    memory = AnswerMemory()
    for number in range(windows):
        asked = np.tile([10.0, 20.0, 40.0], 4) * legs(1.0, (-1.0) ** number, 1.0, 1.0)
        load_nm = asked * sizes
        if as_leg is not None:
            load_nm[3 * as_leg : 3 * as_leg + 3] = load_nm[3:6]
        position_rad = legs(1.0, (-1.0) ** number, 1.0, 1.0)
        memory = after_window(memory, window(load_nm=load_nm), command(1, position_rad), ALL)
    return memory


def test_windows_in_a_row_count_once_enough_is_felt() -> None:
    """18 ms each, of which some fades: after n windows (1 - 0.964^n) · 0.5 s, so 0.25 s after 19 of them."""
    knee = np.where(np.arange(12) == 5, -1.0, 1.0)
    for windows, counted in ((18, 0), (19, 1), (23, 5)):
        turned = answered(windows, knee)
        assert turned.wrong_windows.tolist() == [0] * 5 + [counted] + [0] * 6
        assert not turned.anothers_windows.any()
        assert not answered(windows, np.ones(12)).wrong_windows.any()
        assert answered(windows, np.ones(12), as_leg=3).anothers_windows.tolist() == [0, 0, 0, counted]
    # The knee's products are -448 N²·m²·s by now, of squares of 448; 120 · 250 · 0.018 = 540 more turn their sign.
    once = np.tile([30.0, 60.0, 120.0], 4)
    once[5] = 250.0
    after = after_window(turned, window(load_nm=once), command(1, legs(3.0, 3.0, 3.0, 3.0)), ALL)
    assert not after.wrong_windows.any()


def test_nothing_counts_before_enough_is_felt_and_counts_are_whole_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    nothing = AnswerMemory()
    assert nothing.wrong_windows.dtype == nothing.anothers_windows.dtype == np.int64
    turned, stands = window(load_nm=np.full(12, -50.0)), command(1, np.full(12, 2.0))
    felt_s = after_window(nothing, turned, stands, ALL).felt_s
    for least_s, counted in ((felt_s, 1), (np.nextafter(felt_s, 1.0), 0)):
        monkeypatch.setattr(bounds, "ANSWER_LEAST_S", least_s)
        assert set(after_window(nothing, turned, stands, ALL).wrong_windows) == {counted}


def told_after(count: int, **counts: Any) -> list[str]:
    answer = AnswerMemory(**{name: which * count for name, which in counts.items()})
    doubts = list(check._doubts(check.SignalMemory(answer=answer)))
    assert all(doubt.suspects == {Signal.LOAD, Signal.POSITION} for doubt in doubts)
    assert all(doubt.stop.reason is StopReason.SIGNALS_CONTRADICT for doubt in doubts)
    return [doubt.stop.detail for doubt in doubts]


def test_so_many_windows_in_a_row_are_a_doubt_and_one_less_is_none() -> None:
    knee, hind = (np.arange(12) == 5).astype(int), (np.arange(4) >= 2).astype(int)
    assert told_after(bounds.LOAD_WINDOWS - 1, wrong_windows=knee, anothers_windows=hind) == []
    words = "position of fr_kn and load, which does not answer what is asked"
    assert told_after(bounds.LOAD_WINDOWS, wrong_windows=knee) == [words]
    words = "set-points of hl, hr and loads, which answer another leg's"
    assert told_after(bounds.LOAD_WINDOWS, anothers_windows=hind) == [words]


def test_the_newest_command_that_was_confirmed_is_answered_while_it_drives_the_joints() -> None:
    memory = check.SignalMemory(answer=AnswerMemory(felt_s=0.1))
    for key in (3, 5, 7):
        memory = check.asked(memory, command(key, np.full(12, 0.1 * key)))
    states = [replace(WalkingRobot(noise=0.0).state(i), position_rad=ZERO, velocity_rad_s=ZERO) for i in range(7)]

    def after(key: int, situation: check.Situation = DRIVEN, **changes: Any) -> AnswerMemory:
        given = [replace(state, last_command_key=key, **changes) for state in states]
        return check.check_signals(memory, given, situation)[0].answer

    for key, position_rad in ((3, 0.3), (4, 0.3), (5, 0.5), (9, 0.7)):
        assert after(key).asked_asked[0] == pytest.approx((10.0 * position_rad) ** 2 * 0.018)
        assert after(key).felt_s == pytest.approx(0.1 * (1.0 - 0.018 / 0.5) + 0.018)
    for nothing in (after(2), after(7, IDLE), after(7, load_nm=ZERO)):
        assert nothing.felt_s == 0.0


def walked(change: Any) -> str | None:
    """What is told first of a robot whose loads answer what is asked, and whose states then change like this."""
    robot, memory, gains = WalkingRobot(), check.SignalMemory(), Gains.policy()
    for index in range(300):
        state = robot.state(index, key=index)
        if index % 7 == 0:
            wanted = state.position_rad + 0.5 * np.sin(0.04 * index + 1.7 * np.arange(12))
            memory = check.asked(memory, JointCommand(index, wanted, ZERO, ZERO, gains, 1))
        load_nm = answer.torque_nm(memory.commands[-1], state.position_rad, state.velocity_rad_s)
        state = change(replace(state, load_nm=load_nm))
        memory, _ = check.check_signals(memory, [state], DRIVEN)
        for doubt in check._doubts(check.SignalMemory(answer=memory.answer)):
            return doubt.stop.detail
    return None


@pytest.mark.parametrize("pair", [(0, 1), (2, 3), (0, 2), (1, 3), (0, 3), (1, 2)])
def test_legs_taken_for_each_other_answer_each_others_set_points(pair: tuple[int, int]) -> None:
    order = np.arange(12).reshape(facts.N_LEGS, 3)
    order[list(pair)] = order[list(pair[::-1])]
    which, names = order.ravel(), ("position_rad", "velocity_rad_s", "load_nm")
    words = walked(lambda s: replace(s, **{name: getattr(s, name)[which] for name in names}))
    assert words is not None
    assert all(facts.LEG_NAMES[leg] in words for leg in pair)


@pytest.mark.parametrize(("factor", "is_wrong"), [(1.0, False), (0.65, False), (-1.0, True), (4.0, True)])
def test_loads_of_another_size_are_not_taken_for_those_of_another_leg(factor: float, is_wrong: bool) -> None:
    words = walked(lambda s: replace(s, load_nm=factor * s.load_nm))
    assert (words is not None) == is_wrong
    assert words is None or "which does not answer what is asked" in words
