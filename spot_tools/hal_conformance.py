"""What every adapter must do, as checks that any test suite can run.

    @pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
    def test_my_adapter(check):
        check(make_my_adapter())

Each check is given an adapter that was not connected yet, and closes it. The robot behind it stands, follows commands
for a fifth of a second at the pose in which it stands, and powers off.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from spot_model.robot import facts
from spot_model.robot.facts import NS_PER_S
from spot_model.robot.state import Gains, JointCommand, RobotState
from spot_runtime.hal.base import Hal, JointControl

STATES: Final = 100
COMMANDS: Final = 50
END_AHEAD_NS: Final = NS_PER_S // 20


class ConformanceError(AssertionError):
    """An adapter does not keep the protocol; the text says which promise."""


def reports_who_answered(hal: Hal) -> None:
    """``connect`` names the adapter and the robot, and joint control is off."""
    with _closed(hal):
        info = hal.connect()
        _demand(bool(info.adapter and info.robot_id), "connect() names neither adapter nor robot")
        _demand(hal.joint_control is JointControl.OFF, "joint control is not off before it was asked for")


def brings_states_in_order(hal: Hal) -> None:
    """States come once each, oldest first, complete, and not from the future."""
    with _closed(hal):
        hal.connect()
        hal.stand()
        states = _receive(hal, STATES)
        stamps = np.array([state.robot_stamp_ns for state in states])
        _demand(bool((np.diff(stamps) > 0).all()), "robot stamps do not rise")
        for state in states:
            shapes = {values.shape for values in (state.position_rad, state.velocity_rad_s, state.load_nm)}
            _demand(shapes == {(facts.N_JOINTS,)}, f"joint values have the shapes {shapes}; needed: (12,)")
            norm = float(np.linalg.norm(state.odom_from_body_wxyz))
            _demand(math.isclose(norm, 1.0, abs_tol=1e-3), f"a quaternion has the length {norm:g}")
        _demand(hal.robot_now_ns() >= stamps[-1], "the robot's clock is behind a state that has come")


def has_a_host_clock_that_never_goes_back(hal: Hal) -> None:
    """The host's clock rises, whatever is done meanwhile."""
    with _closed(hal):
        hal.connect()
        hal.stand()
        stamps = [hal.host_now_ns()]
        for _ in range(20):
            _receive(hal, 1)
            stamps.append(hal.host_now_ns())
        _demand(stamps == sorted(stamps), "the host's clock goes back")


def takes_commands_and_hands_back(hal: Hal) -> None:
    """Joint control becomes active, takes commands, reports no problem, and ends when it is told to."""
    with _closed(hal):
        hal.connect()
        hal.stand()
        commands = _commands(hal, _receive(hal, 1)[-1])
        hal.begin_joint_control(next(commands))
        for _ in range(COMMANDS):
            _receive(hal, 1)
            hal.send(next(commands))
        _demand(hal.joint_control is JointControl.ACTIVE, f"joint control is {hal.joint_control.value}, not active")
        problems = "; ".join(stop.sentence() for stop in hal.problems())
        _demand(not problems, f"problems while all is well: {problems}")
        hal.end_joint_control()
        for _ in range(COMMANDS):
            if hal.joint_control is JointControl.OFF:
                break
            _receive(hal, 1)
            hal.send(next(commands))
        _demand(hal.joint_control is JointControl.OFF, "the robot's own controller did not take the joints back")
        hal.send(next(commands))  # ignored without an error


def ends_from_any_state(hal: Hal) -> None:
    """``release``, ``power_off`` and ``close`` work at any time, and twice."""
    hal.release()
    with _closed(hal):
        hal.connect()
        hal.stand()
        hal.begin_joint_control(next(_commands(hal, _receive(hal, 1)[-1])))
        hal.release()
        hal.release()
        _demand(hal.joint_control is JointControl.OFF, "joint control is not off after release()")
        hal.power_off()


def may_be_closed_unused(hal: Hal) -> None:
    """An adapter that was never connected can be closed."""
    hal.close()
    hal.close()


CHECKS: Final[tuple[Callable[[Hal], None], ...]] = (
    reports_who_answered,
    brings_states_in_order,
    has_a_host_clock_that_never_goes_back,
    takes_commands_and_hands_back,
    ends_from_any_state,
    may_be_closed_unused,
)


class _closed:  # noqa: N801 - reads as a word after `with`
    """Powers off and closes, twice, whatever happened."""

    def __init__(self, hal: Hal) -> None:
        self._hal = hal

    def __enter__(self) -> None: ...

    def __exit__(self, *_: object) -> None:
        self._hal.release()
        self._hal.power_off()
        self._hal.close()
        self._hal.close()


def _receive(hal: Hal, count: int) -> list[RobotState]:
    states: list[RobotState] = []
    for _ in range(20 * count):
        if len(states) >= count:
            return states
        states += hal.receive(hal.robot_now_ns() + facts.STATE_PERIOD_NS, 0.1)
    raise ConformanceError(f"only {len(states)} of {count} states came within {2 * count:g} s")


def _commands(hal: Hal, state: RobotState) -> Iterator[JointCommand]:
    still, position = np.zeros(facts.N_JOINTS), state.position_rad
    for key in itertools.count(1):
        yield JointCommand(key, position, still, state.load_nm, Gains.stand(), hal.robot_now_ns() + END_AHEAD_NS)


def _demand(holds: bool, words: str) -> None:
    if not holds:
        raise ConformanceError(words)
