"""What control relies on, and what becomes of a doubt about each signal."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from spot_model.policy.observation import OBSERVATION_LAYOUT
from spot_model.policy.policy import Policy
from spot_runtime.config import RunConfig
from spot_runtime.control.loop import ControlLoop
from spot_runtime.control.modes import Mode
from spot_runtime.control.safety.signals import readers
from spot_runtime.control.safety.signals.readers import READ_FOR_OBSERVATION, Doubt, Signal, relied_on
from spot_runtime.stops import Stop, StopReason
from tests.spot_runtime.test_loop import drive_until, make_loop, modes_of

CORE = {Signal.POSITION, Signal.VELOCITY, Signal.ATTITUDE}
UNREAD = (Signal.CONTACTS, Signal.INERTIAL_UNIT)


def test_every_field_that_a_policy_can_observe_is_made_of_known_signals() -> None:
    assert set(READ_FOR_OBSERVATION) == {name for name, _ in OBSERVATION_LAYOUT}


@pytest.mark.parametrize(
    ("field", "signals"),
    [
        ("linear_vel_of_body_in_body_m_s", {Signal.BODY_VELOCITY, Signal.ATTITUDE}),
        ("angular_vel_of_body_in_body_rad_s", {Signal.TURN_RATE, Signal.ATTITUDE}),
        ("projected_gravity_in_body", {Signal.ATTITUDE}),
        ("velocity_command", set()),
        ("joint_position_offset_rad", {Signal.POSITION}),
        ("joint_velocity_rad_s", {Signal.VELOCITY}),
        ("last_action", set()),
    ],
)
def test_a_policy_relies_on_what_it_observes_and_the_core_on_its_own(field: str, signals: set[Signal]) -> None:
    assert READ_FOR_OBSERVATION[field] == signals
    assert relied_on([field], Mode.ACTIVE) == signals | CORE
    assert relied_on([], Mode.ACTIVE) == CORE == readers.READ_BY_CORE


@pytest.mark.parametrize("mode", Mode)
def test_loads_are_relied_on_until_joint_control_has_taken_hold(mode: Mode) -> None:
    assert (Signal.LOAD in relied_on(READ_FOR_OBSERVATION, mode)) == (mode in (Mode.READY, Mode.ACTIVATING))
    assert relied_on(READ_FOR_OBSERVATION, mode).isdisjoint(UNREAD)


def doubted(loop: ControlLoop, *signals: Signal) -> None:
    """As if the checks had doubted these after the last step."""
    stop = Stop(StopReason.SIGNALS_CONTRADICT, " and ".join(signal.value for signal in signals), {"apart_s": 1.5})
    loop.memory = loop.memory._replace(found=(Doubt(frozenset(signals), stop),))


ENDS = {
    Mode.READY: frozenset(Signal) - frozenset(UNREAD),
    Mode.ACTIVATING: frozenset(Signal) - frozenset(UNREAD),
    Mode.ACTIVE: frozenset(Signal) - frozenset(UNREAD) - {Signal.LOAD},
}


@pytest.mark.parametrize("mode", ENDS)
@pytest.mark.parametrize("signal", Signal)
def test_a_doubt_ends_a_run_only_where_control_relies_on_the_signal(
    robot: Any, zero_policy: Policy, signal: Signal, mode: Mode
) -> None:
    loop, sink = make_loop(robot, zero_policy)
    drive_until(loop, mode)
    for _ in range(1 if signal in ENDS[mode] else 3):
        doubted(loop, signal)
        loop.cycle()
    told = [event for event in sink.events if event.name == "signal_doubted"]
    if signal in ENDS[mode]:
        assert loop.stop is not None
        assert loop.stop.reason is StopReason.SIGNALS_CONTRADICT
        assert modes_of(sink)[-1] == ("released" if mode is Mode.READY else "damping")
        assert told == []
        return
    assert loop.stop is None
    assert loop.mode is mode
    (event,) = told
    assert event.text.endswith("; nothing in control relies on it")
    assert signal.value in event.text
    assert event.values == {"apart_s": 1.5}


def test_a_doubt_of_which_any_suspect_is_relied_on_ends_a_run(robot: Any, zero_policy: Policy) -> None:
    loop, _ = make_loop(robot, zero_policy)
    drive_until(loop, Mode.ACTIVE)
    doubted(loop, Signal.CONTACTS, Signal.BODY_VELOCITY)
    loop.cycle()
    assert loop.stop is not None


def test_doubts_about_different_signals_are_each_told_once(robot: Any, zero_policy: Policy) -> None:
    loop, sink = make_loop(robot, zero_policy)
    drive_until(loop, Mode.ACTIVE)
    for signals in ([Signal.CONTACTS], [Signal.LOAD], [Signal.CONTACTS], [Signal.CONTACTS, Signal.LOAD]):
        doubted(loop, *signals)
        loop.cycle()
    told = [event.text for event in sink.events if event.name == "signal_doubted"]
    assert len(told) == 3


def test_a_configuration_may_ask_for_warnings_alone(robot: Any, make_policy: Callable[..., Policy]) -> None:
    config = RunConfig.model_validate({"safety": {"signals": "warn"}})
    loop, sink = make_loop(robot, make_policy(), config=config)
    drive_until(loop, Mode.ACTIVE)
    doubted(loop, Signal.POSITION)
    loop.cycle()
    assert loop.stop is None
    (event,) = [event for event in sink.events if event.name == "signal_doubted"]
    assert event.text.endswith("; the configuration only warns")
