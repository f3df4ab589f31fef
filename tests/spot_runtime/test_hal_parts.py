"""The parts of the vendor adapter that need no robot."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, Literal

import grpc
import numpy as np
import pytest
from bosdyn.api import estop_pb2, lease_pb2, power_pb2, robot_command_pb2, robot_state_pb2
from bosdyn.client import exceptions as sdk
from bosdyn.client.auth import TemporarilyLockedOutError
from bosdyn.client.channel import translate_exception
from bosdyn.client.lease import InvalidResourceError, ResourceAlreadyClaimedError
from bosdyn.client.power import KeepaliveMotorsOffError, ShorePowerConnectedError
from bosdyn.client.robot import UnregisteredServiceNameError
from bosdyn.client.robot_command import DockedError

from spot_log.format.vendor_state import StateMessageError, robot_state_from_wire
from spot_log.write.sink import MemorySink
from spot_model.robot import facts
from spot_model.robot.facts import NS_PER_S
from spot_model.robot.state import Gains, JointCommand
from spot_runtime.config import RobotConfig, RunConfig
from spot_runtime.control.safety.battery import BatteryMemory, check_slow_state
from spot_runtime.hal.address import parse_address
from spot_runtime.hal.errors import (
    CredentialsError,
    EstopError,
    FaultError,
    HalError,
    LeaseHeldError,
    MotionError,
    NoRobotError,
    NoServiceError,
)
from spot_runtime.hal.spot.adapter import BosdynHal
from spot_runtime.hal.spot.calls import RETRY_PAUSES_S, Calls, patiently
from spot_runtime.hal.spot.command_stream import CommandEncoder, LatestSlot
from spot_runtime.hal.spot.estop import needs_own_endpoint
from spot_runtime.hal.spot.keepalive import watch_for_silence
from spot_runtime.hal.spot.pace import Jobs, RealTime
from spot_runtime.hal.spot.session import RobotCalls
from spot_runtime.hal.spot.slow_state import charge_percent, slow_state_from_message
from spot_runtime.hal.spot.state_receiver import StateReceiver
from spot_runtime.hal.spot.vendor_errors import enum_word, translate
from spot_runtime.host.clock import ClockSample, HostClock, RobotClockEstimate
from spot_runtime.stops import StopReason

LIMITS = RunConfig().safety
STAMP_NS = 1_700_000_000_123_456_789


def decoded(wire: bytes) -> robot_command_pb2.JointControlStreamRequest:
    return robot_command_pb2.JointControlStreamRequest.FromString(wire)


def numbered(key: int) -> JointCommand:
    """A command in which every number is different, so that swapped fields show."""
    values = np.arange(12.0)
    gains = Gains(values + 400.0, values + 500.0)
    return JointCommand(key, values + 100.0, values + 200.0, values + 300.0, gains, STAMP_NS + 50_000_000)


# Commands on the wire ------------------------------------------------------------------------------------------------


def test_every_field_of_a_command_reaches_its_place() -> None:
    message = decoded(CommandEncoder("me", 35.0).encode(numbered(7), STAMP_NS))
    joint = message.joint_command
    assert message.header.client_name == "me"
    assert (message.header.request_timestamp.seconds, message.header.request_timestamp.nanos) == (
        1_700_000_000,
        123_456_789,
    )
    assert (joint.end_time.seconds, joint.end_time.nanos) == (1_700_000_000, 173_456_789)
    assert list(joint.position) == list(range(100, 112))
    assert list(joint.velocity) == list(range(200, 212))
    assert list(joint.load) == list(range(300, 312))
    assert list(joint.gains.k_q_p) == list(range(400, 412))
    assert list(joint.gains.k_qd_p) == list(range(500, 512))
    assert joint.user_command_key == 7
    assert joint.velocity_safety_limit.value == 35.0


def test_arrays_that_stay_the_same_stay_in_the_message() -> None:
    encoder = CommandEncoder("me", 35.0)
    first = numbered(7)
    encoder.encode(first, STAMP_NS)
    for key, changed in enumerate(("position_rad", "velocity_rad_s", "load_nm"), start=8):
        command = replace(first, **{"key": key, changed: getattr(first, changed) + 1.0})
        alone = CommandEncoder("me", 35.0).encode(command, STAMP_NS)
        assert encoder.encode(command, STAMP_NS) == alone


def test_a_reused_message_keeps_nothing_of_the_one_before() -> None:
    encoder = CommandEncoder("me", 35.0)
    encoder.encode(numbered(7), STAMP_NS)
    second = JointCommand(8, np.zeros(12), np.zeros(12), np.zeros(12), Gains.policy(), STAMP_NS)
    again = decoded(encoder.encode(second, STAMP_NS))
    assert again == decoded(CommandEncoder("me", 35.0).encode(second, STAMP_NS))
    assert len(again.joint_command.position) == 12


# The slot ------------------------------------------------------------------------------------------------------------


def test_the_newest_value_replaces_one_that_nobody_took() -> None:
    slot: LatestSlot[int] = LatestSlot()
    for value in (1, 2, 3):
        slot.put(value)
    assert slot.take() == 3
    assert slot.replaced == 2


def test_a_closed_slot_wakes_its_reader_and_gives_nothing_more() -> None:
    slot: LatestSlot[int] = LatestSlot()
    taken: list[int | None] = []
    reader = threading.Thread(target=lambda: taken.append(slot.take()))
    reader.start()
    slot.close()
    reader.join(timeout=10.0)
    slot.put(1)
    assert taken == [None]
    assert slot.take() is None


def test_a_slot_between_two_threads_gives_rising_values_and_always_the_last() -> None:
    slot: LatestSlot[int] = LatestSlot()
    taken: list[int] = []

    def take_all() -> None:
        while (value := slot.take()) is not None:
            taken.append(value)
            if value == 5000:
                return

    reader = threading.Thread(target=take_all)
    reader.start()
    for value in range(1, 5001):
        slot.put(value)
    reader.join(timeout=60.0)
    assert taken[-1] == 5000
    assert all(a < b for a, b in pairwise(taken))
    assert len(taken) + slot.replaced >= 5000


# Chores --------------------------------------------------------------------------------------------------------------


def test_chores_run_when_they_are_due_and_one_that_fails_stays() -> None:
    ran: list[str] = []
    failed: list[str] = []

    def fail() -> None:
        raise HalError("no answer")

    jobs = Jobs(lambda name, error: failed.append(f"{name}: {error}"))
    jobs.add("lease", 2.0, lambda: ran.append("lease"), now_s=0.0)
    jobs.add("poll", 0.5, fail, now_s=0.0)
    waits = [jobs.run_due(now_s) for now_s in (0.0, 0.5, 0.75, 1.0, 2.0)]
    assert ran == ["lease"]
    assert failed == ["poll: no answer"] * 3
    assert waits == [0.5, 0.5, 0.25, 0.5, 0.5]
    jobs.remove("poll")
    jobs.remove("poll")
    assert [job.name for job in jobs._jobs] == ["lease"]


def test_a_chore_that_waits_for_its_answer_holds_up_no_other() -> None:
    polled, may_end = threading.Event(), threading.Event()
    polls: list[int] = []
    jobs, pace = Jobs(lambda *_: None), RealTime(HostClock(), RobotClockEstimate())

    def check_in() -> None:
        may_end.wait(60.0)

    def poll() -> None:
        polls.append(1)
        if len(polls) == 3:
            polled.set()

    pace.start(jobs)
    jobs.add("estop", 0.001, check_in, now_s=pace.chore_now_s())
    jobs.add("slow_state", 0.001, poll, now_s=pace.chore_now_s())
    assert polled.wait(30.0)
    assert not may_end.is_set()
    may_end.set()
    pace.stop()
    assert not any(thread.name in ("estop", "slow_state") for thread in threading.enumerate())


# Slow state ----------------------------------------------------------------------------------------------------------


def test_the_slow_state_takes_every_value_from_its_place() -> None:
    message = robot_state_pb2.RobotState()
    message.power_state.motor_power_state = robot_state_pb2.PowerState.MOTOR_POWER_STATE_ON
    message.power_state.timestamp.seconds = 12
    battery = message.battery_states.add()
    battery.charge_percentage.value, battery.voltage.value, battery.current.value = 71.0, 55.5, -6.5
    battery.temperatures.extend([30.0, 31.0])
    message.estop_states.add(state=robot_state_pb2.EStopState.STATE_NOT_ESTOPPED)
    message.system_state.motor_temperatures.add(name="fl.kn", temperature=44.0)
    faults = message.system_fault_state.faults
    faults.add(name="battery", error_message="cell", severity=robot_state_pb2.SystemFault.SEVERITY_CRITICAL)
    faults.add(name="camera", severity=robot_state_pb2.SystemFault.SEVERITY_WARN)
    message.behavior_fault_state.faults.add(behavior_fault_id=3, cause=robot_state_pb2.BehaviorFault.CAUSE_FALL)
    slow = slow_state_from_message(message, STAMP_NS)
    assert (slow.robot_stamp_ns, slow.host_stamp_ns) == (12_000_000_000, STAMP_NS)
    assert slow.motors_powered
    assert not slow.estopped
    assert (slow.battery_charge_percent, slow.battery_voltage_v, slow.battery_current_a) == (71.0, 55.5, -6.5)
    assert slow.battery_temperature_c == (30.0, 31.0)
    assert slow.motor_temperature_c == {"fl_kn": 44.0}
    assert slow.system_faults == ("critical: battery (cell)", "camera")
    assert slow.behavior_faults == ("fall (3)",)


def test_words_of_a_robot_whose_software_is_newer_than_ours() -> None:
    message = robot_state_pb2.RobotState()
    message.behavior_fault_state.faults.add(behavior_fault_id=12, cause=9)
    message.system_fault_state.faults.add(name="novel", severity=7)
    message.estop_states.add(name="curtain", type=5, state=6)
    slow = slow_state_from_message(message, STAMP_NS)
    assert slow.behavior_faults == ("value 9 of newer software (12)",)
    assert slow.system_faults == ("novel",)
    assert not slow.estopped
    with pytest.raises(EstopError, match=r"pressed: tablet \(value 9 of newer software\)"):
        needs_own_endpoint(estop_status(CUT, ("tablet", 9, 1.0)), "auto", "spot-rl")
    status = robot_command_pb2.JointControlStreamResponse.Status
    assert enum_word(status, 77) == "value 77 of newer software"
    assert enum_word(status, 3) == "STATUS_INACTIVE"


def test_the_charge_is_the_summary_of_the_robot_else_that_of_the_emptiest_battery_that_reports_one() -> None:
    message = robot_state_pb2.RobotState()
    assert np.isnan(charge_percent(message))
    message.battery_states.add(identifier="bay", status=robot_state_pb2.BatteryState.STATUS_MISSING)
    assert np.isnan(charge_percent(message))
    for percent, voltage in ((64.0, 52.0), (58.0, 51.0)):
        battery = message.battery_states.add()
        battery.charge_percentage.value, battery.voltage.value = percent, voltage
    message.battery_states.add(status=robot_state_pb2.BatteryState.STATUS_BOOTING)
    slow = slow_state_from_message(message, STAMP_NS)
    assert (slow.battery_charge_percent, slow.battery_voltage_v) == (58.0, 51.0)
    message.power_state.locomotion_charge_percentage.value = 61.0
    assert slow_state_from_message(message, STAMP_NS).battery_charge_percent == 61.0
    message.ClearField("battery_states")
    assert slow_state_from_message(message, STAMP_NS).battery_charge_percent == 61.0


def test_a_robot_whose_arm_is_out_is_refused_before_anything_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = HostClock()
    session = RobotCalls(parse_address("127.0.0.1:1"), RobotConfig(), clock, RobotClockEstimate(), clock.now_ns)
    state = robot_state_pb2.RobotState()
    state.battery_states.add().charge_percentage.value = 80.0
    for name in ("fl.hx", "hr.kn"):
        state.kinematic_state.joint_states.add(name=name)
    monkeypatch.setattr(session, "_state", lambda: state)
    assert session.check_faults(LIMITS, lambda _: None).battery_charge_percent == 80.0
    shoulder = state.kinematic_state.joint_states.add(name="arm0.sh1")
    shoulder.position.value = -3.12
    assert session.check_faults(LIMITS, lambda _: None).battery_charge_percent == 80.0
    shoulder.position.value = -2.5
    with pytest.raises(HalError, match=r"arm0_sh1 at -2.50 rad \(allowed: -3.3 to -2.8\); stow it"):
        session.check_faults(LIMITS, lambda _: None)


def test_a_charge_that_is_not_reported_is_not_known_and_starts_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, state = HostClock(), robot_state_pb2.RobotState()
    session = RobotCalls(parse_address("127.0.0.1:1"), RobotConfig(), clock, RobotClockEstimate(), clock.now_ns)
    monkeypatch.setattr(session, "_state", lambda: state)
    for _ in range(2):  # no battery; one that tells its voltage alone
        slow = slow_state_from_message(state, STAMP_NS)
        assert np.isnan(slow.battery_charge_percent)
        never_known = BatteryMemory(since_ns=STAMP_NS - 2 * NS_PER_S)
        _, stop = check_slow_state(never_known, replace(slow, motors_powered=True), STAMP_NS, LIMITS)
        assert stop is not None
        assert (stop.reason.label, stop.detail) == ("battery_unknown", "charge")
        with pytest.raises(FaultError, match="does not report its battery's charge"):
            session.check_faults(LIMITS, lambda _: None)
        state.battery_states.add().voltage.value = 52.0
    state.battery_states[0].charge_percentage.value = 0.0
    with pytest.raises(FaultError, match="holds 0 %"):
        session.check_faults(LIMITS, lambda _: None)


def test_a_charge_that_is_missing_for_a_moment_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, state = HostClock(), robot_state_pb2.RobotState()
    session = RobotCalls(parse_address("127.0.0.1:1"), RobotConfig(), clock, RobotClockEstimate(), clock.now_ns)
    monkeypatch.setattr(session, "_state", lambda: state)
    waited_s: list[float] = []

    def pause(duration_s: float) -> None:
        waited_s.append(duration_s)
        if len(waited_s) == 4:
            state.battery_states.add().charge_percentage.value = 80.0

    assert session.check_faults(LIMITS, pause).battery_charge_percent == 80.0
    assert len(waited_s) == 4
    del state.battery_states[:]
    with pytest.raises(FaultError, match="does not report its battery's charge"):
        session.check_faults(LIMITS, waited_s.append)
    assert sum(waited_s[4:]) == pytest.approx(LIMITS.slow_state_age_s, abs=0.06)


def test_an_answer_that_does_not_tell_of_the_power_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, state = HostClock(), robot_state_pb2.RobotState()
    session = RobotCalls(parse_address("127.0.0.1:1"), RobotConfig(), clock, RobotClockEstimate(), clock.now_ns)
    monkeypatch.setattr(session, "_state", lambda: state)
    with pytest.raises(HalError, match="does not say whether its motors have power"):
        session.poll()
    state.power_state.motor_power_state = robot_state_pb2.PowerState.MOTOR_POWER_STATE_OFF
    assert not session.poll().motors_powered


def test_one_pressed_estop_is_enough() -> None:
    message = robot_state_pb2.RobotState()
    message.estop_states.add(state=robot_state_pb2.EStopState.STATE_NOT_ESTOPPED)
    message.estop_states.add(state=robot_state_pb2.EStopState.STATE_ESTOPPED)
    assert slow_state_from_message(message, STAMP_NS).estopped


# E-stop --------------------------------------------------------------------------------------------------------------


def estop_status(level: int, *endpoints: tuple[str, int, float]) -> estop_pb2.EstopSystemStatus:
    status = estop_pb2.EstopSystemStatus(stop_level=level)
    for name, own_level, silent_s in endpoints:
        endpoint = status.endpoints.add(stop_level=own_level)
        endpoint.endpoint.name = name
        endpoint.endpoint.timeout.seconds = 9
        endpoint.time_since_valid_response.FromMilliseconds(round(silent_s * 1000))
    return status


CUT, NONE = estop_pb2.ESTOP_LEVEL_CUT, estop_pb2.ESTOP_LEVEL_NONE


def test_a_released_estop_of_somebody_else_is_relied_on_unless_told_otherwise() -> None:
    status = estop_status(NONE, ("tablet", NONE, 1.0))
    assert not needs_own_endpoint(status, "auto", "spot-rl")
    assert not needs_own_endpoint(status, "external", "spot-rl")
    assert needs_own_endpoint(status, "own", "spot-rl")


def test_a_robot_without_any_living_endpoint_gets_our_own() -> None:
    assert needs_own_endpoint(estop_status(CUT), "auto", "spot-rl")
    assert needs_own_endpoint(estop_status(CUT, ("tablet", NONE, 20.0)), "auto", "spot-rl")
    with pytest.raises(EstopError, match="no e-stop endpoint answers"):
        needs_own_endpoint(estop_status(CUT), "external", "spot-rl")


def test_what_an_earlier_run_of_ours_has_left_is_not_relied_on() -> None:
    status = estop_status(NONE, ("spot-rl", NONE, 4.0))
    assert needs_own_endpoint(status, "auto", "spot-rl")
    with pytest.raises(EstopError, match="no e-stop endpoint answers"):
        needs_own_endpoint(status, "external", "spot-rl")
    assert needs_own_endpoint(estop_status(CUT, ("spot-rl", CUT, 4.0)), "auto", "spot-rl")  # taken back
    settle = estop_pb2.ESTOP_LEVEL_SETTLE_THEN_CUT
    with pytest.raises(EstopError, match=r"run pressed the e-stop: spot-rl \(settle_then_cut\); .* again in 5 s"):
        needs_own_endpoint(estop_status(settle, ("spot-rl", settle, 4.0)), "auto", "spot-rl")


@pytest.mark.parametrize("policy", ["auto", "own", "external"])
def test_a_pressed_estop_is_never_overruled(policy: Literal["auto", "own", "external"]) -> None:
    with pytest.raises(EstopError, match=r"pressed: tablet \(cut\)"):
        needs_own_endpoint(estop_status(CUT, ("tablet", CUT, 1.0)), policy, "spot-rl")
    # All endpoints are released, and still the robot is stopped: by a button that none of them is.
    with pytest.raises(EstopError, match="an e-stop is pressed that no endpoint holds"):
        needs_own_endpoint(estop_status(CUT, ("tablet", NONE, 1.0)), policy, "spot-rl")


# Errors --------------------------------------------------------------------------------------------------------------


class _FailedCall(grpc.RpcError):
    """What a failed call raises, written by hand."""

    def __init__(
        self,
        details: str = "failed to connect\nto all addresses",
        code: grpc.StatusCode = grpc.StatusCode.UNAVAILABLE,
    ) -> None:
        self._details, self._code = details, code

    def code(self) -> grpc.StatusCode:
        return self._code

    def details(self) -> str:
        return self._details

    def debug_error_string(self) -> str:
        return self._details


_UNAUTHENTICATED = sdk.UnauthenticatedError(_FailedCall("token expired", grpc.StatusCode.UNAUTHENTICATED), "doc")


def test_no_connection_is_explained_where_that_is_asked() -> None:
    error = sdk.UnableToConnectToRobotError(_FailedCall(), "doc")
    told = translate(error, "logging in", lambda reason: NoRobotError(f"because {reason}"))
    assert isinstance(told, NoRobotError)
    assert str(told) == "because UNAVAILABLE: failed to connect to all addresses"
    told = translate(error, "polling")
    assert type(told) is HalError
    assert "polling: the robot did not answer" in str(told)
    told = translate(sdk.UnimplementedError(_FailedCall(), "doc"), "setting up the e-stop")
    assert "setting up the e-stop: the robot has no such call" in str(told)
    told = translate(UnregisteredServiceNameError("robot-command-streaming"), "finding robot-command-streaming")
    assert isinstance(told, NoServiceError)
    assert "the robot does not offer it" in str(told)
    keeps_off = power_pb2.PowerCommandResponse(status=power_pb2.STATUS_KEEPALIVE_MOTORS_OFF)
    told = translate(KeepaliveMotorsOffError(keeps_off, "off"), "powering on")
    assert "have the program that set this keepalive policy check in" in str(told)


@pytest.mark.parametrize(
    ("error", "kind", "advice"),
    [
        (TemporarilyLockedOutError, CredentialsError, "wait some minutes, then try again"),
        (InvalidResourceError, NoServiceError, "the robot does not offer it"),
        (ShorePowerConnectedError, FaultError, "unplug it or have it leave its dock"),
        (DockedError, MotionError, "have it leave its dock"),
    ],
)
def test_a_refusal_tells_the_next_step(error: type[sdk.ResponseError], kind: type[HalError], advice: str) -> None:
    told = translate(error(robot_command_pb2.RobotCommandResponse()), "doing it")
    assert type(told) is kind
    assert advice in str(told)
    assert ".;" not in str(told)


def test_who_has_taken_the_lease_is_named() -> None:
    use = lease_pb2.LeaseUseResult(status=lease_pb2.LeaseUseResult.STATUS_OLDER)
    use.owner.client_name = "tablet-7"
    told = translate(sdk.LeaseUseError(lease_pb2.RetainLeaseResponse(), use), "keeping the lease")
    assert type(told) is LeaseHeldError
    assert "(held by tablet-7); see who holds the lease" in str(told)


def test_two_calls_that_one_expired_token_refuses_are_both_served_by_one_login() -> None:
    logins: list[int] = []
    calls = Calls(object(), lambda: logins.append(1))

    def refused_until_login() -> str:
        if not logins:
            raise _UNAUTHENTICATED
        return "answer"

    def overtaken() -> str:
        """Refused, too, but by the time its refusal arrives another thread's call has logged in."""
        if logins:
            return "answer"
        assert calls.make("keeping the lease", refused_until_login) == "answer"
        raise _UNAUTHENTICATED

    assert calls.make("polling", overtaken) == "answer"
    assert len(logins) == 1


@pytest.mark.parametrize("code", [grpc.StatusCode.UNAVAILABLE, grpc.StatusCode.RESOURCE_EXHAUSTED])
@pytest.mark.parametrize("wrap", [lambda e: e, lambda e: sdk.TooManyRequestsError(e, "doc")])
def test_a_call_that_is_turned_away_is_made_again_after_a_pause(code: grpc.StatusCode, wrap: Any) -> None:
    for failures in range(4):
        made, pauses = [], []

        def call(failures: int = failures, made: list[int] = made) -> str:
            made.append(1)
            if len(made) <= failures:
                raise wrap(_FailedCall("connection termination", code))
            return "answer"

        if failures == 3:
            with pytest.raises((sdk.TooManyRequestsError, _FailedCall)):
                patiently(call, pauses.append)
        else:
            assert patiently(call, pauses.append) == "answer"
        assert len(made) == min(failures + 1, 3)
        assert pauses == list(RETRY_PAUSES_S)[:failures]


def test_whatever_else_a_call_ends_with_is_an_answer() -> None:
    """A time-out says nothing of whether the call was carried out, and a refusal stays one."""
    held = SimpleNamespace(
        lease_owner=SimpleNamespace(client_name="tablet", user_name=""), header=SimpleNamespace(error=None)
    )
    answers = [_FailedCall(code=grpc.StatusCode.DEADLINE_EXCEEDED), _UNAUTHENTICATED]
    for answer in (*answers, ResourceAlreadyClaimedError(held, "doc")):
        made: list[int] = []

        def call(answer: Exception = answer, made: list[int] = made) -> None:
            made.append(1)
            raise answer

        with pytest.raises(type(answer)):
            patiently(call, lambda _: pytest.fail("there is nothing to wait for"))
        assert len(made) == 1


class _Stream(list[bytes]):
    """What one call of the state stream brings, written by hand."""

    def __init__(self, messages: int = 0, error: Exception | None = None) -> None:
        super().__init__([_state_wire()] * messages)
        self._error = error
        self.is_cancelled = False

    def __iter__(self) -> Iterator[bytes]:
        yield from super().__iter__()
        if self._error is not None:
            raise self._error

    def cancel(self) -> None:
        self.is_cancelled = True


def _state_wire(contacts: int = 4) -> bytes:
    message = robot_state_pb2.RobotStateStreamResponse(contact_states=[1] * contacts)
    for name in ("position", "velocity", "load"):
        getattr(message.joint_states, name).extend([0.0] * 12)
    return bytes(message.SerializeToString())


def received(streams: list[_Stream], lives_s: float) -> tuple[int, list[str]]:
    """How many states such streams bring, each of which lives so long, and with which words they end."""
    opened, ends, rest = [0], [], list(streams)

    def open_stream(_request: object) -> _Stream:
        opened[0] += 1
        return rest.pop(0)

    def now_ns() -> int:
        now_ns.calls += 1  # type: ignore[attr-defined]
        return int(now_ns.calls * lives_s * 1e9)  # type: ignore[attr-defined]

    now_ns.calls = 0  # type: ignore[attr-defined]
    channel: Any = SimpleNamespace(unary_stream=lambda *_, **__: open_stream)
    request = robot_state_pb2.RobotStateStreamRequest()
    receiver = StateReceiver(
        channel,
        request,
        now_ns=now_ns,
        on_wire=lambda *_: None,
        on_end=ends.append,
        on_reopen=lambda lived_s: ends.append(f"open for {lived_s:.1f} s"),
    )
    states = list(iter(receiver.states.get, None))
    receiver.stop()
    return len(states), ends


def test_a_state_stream_that_the_robot_closes_is_opened_again() -> None:
    lost = _FailedCall("gone")
    count, told = received([_Stream(4), _Stream(2), _Stream(1, lost)], lives_s=1.1)
    assert count == 7
    # Each look at the clock is 1.1 s after the one before; a message takes one.
    assert told == ["open for 5.5 s", "open for 3.3 s", "UNAVAILABLE: gone"]


def test_a_state_stream_that_lives_for_a_moment_or_breaks_is_not_opened_again() -> None:
    assert received([_Stream(0)], lives_s=0.9) == (0, ["the robot closed the state stream"])
    assert received([_Stream(3, _FailedCall("gone"))], lives_s=1.1) == (3, ["UNAVAILABLE: gone"])


def test_a_state_stream_that_was_opened_again_is_an_event_in_the_log(monkeypatch: pytest.MonkeyPatch) -> None:
    sink, rest = MemorySink(), [_Stream(4), _Stream(1, _FailedCall("gone"))]
    hal = BosdynHal(parse_address("127.0.0.1:1"), RunConfig(), sink)
    hal._estimate.add(ClockSample(0, 0, 0, 0))
    now_ns = iter(range(STAMP_NS, STAMP_NS + 100_000_000_000, 500_000_000))
    monkeypatch.setattr(hal._pace, "host_now_ns", lambda: next(now_ns))
    channel = SimpleNamespace(unary_stream=lambda *_, **__: lambda _request: rest.pop(0))
    monkeypatch.setattr(hal._session, "streaming_channel", lambda _: channel)
    hal._open_states()
    states: Any = hal._states
    assert len(list(iter(states.states.get, None))) == 5
    states.stop()
    assert sink.events == [], "another thread writes the run's events"
    hal.receive(0, 0.0)
    assert [(event.name, event.text) for event in sink.events] == [("states_reopened", "it had been open for 2.5 s")]
    assert [stop.reason for stop in hal.problems()] == [StopReason.STATE_LOST]


def test_a_robot_may_report_four_contacts_or_none() -> None:
    assert robot_state_from_wire(_state_wire(4), 0).foot_contact.all()
    assert robot_state_from_wire(_state_wire(0), 0).foot_contact.tolist() == [False] * 4
    with pytest.raises(StateMessageError, match="3 contact states; Spot sends 4, or none"):
        robot_state_from_wire(_state_wire(3), 0)


def test_a_robot_that_refuses_a_fresh_token_is_not_asked_again_and_again() -> None:
    logins: list[int] = []
    calls = Calls(object(), lambda: logins.append(1))

    def refused() -> None:
        raise _UNAUTHENTICATED

    for _ in range(3):
        with pytest.raises(CredentialsError, match="denies access"):
            calls.make("polling", refused)
    assert len(logins) == 1


def test_the_digits_of_a_port_do_not_decide_what_an_error_is() -> None:
    error = translate_exception(_FailedCall("failed to connect to ipv4:127.0.0.1:42909"))
    assert isinstance(error, sdk.TooManyRequestsError), "the SDK took the 429 of the port for a status"
    assert isinstance(translate(error, "logging in", NoRobotError), NoRobotError)


def test_denied_access_is_about_credentials() -> None:
    assert isinstance(translate(_UNAUTHENTICATED, "polling"), CredentialsError)


def test_our_own_errors_pass_untouched() -> None:
    error = EstopError("pressed")
    assert translate(error, "anything") is error


def test_the_holder_of_the_lease_is_named() -> None:
    owner = SimpleNamespace(client_name="tablet-7", user_name="anna")
    told = translate(ResourceAlreadyClaimedError(SimpleNamespace(lease_owner=owner), ""), "taking the lease")
    assert "held by tablet-7 / anna" in str(told)
    assert told.exit_code == 84


def test_every_error_has_a_label_and_an_exit_code_of_its_own() -> None:
    kinds = [HalError, *HalError.__subclasses__()]
    assert len({kind.exit_code for kind in kinds}) == len(kinds)
    assert len({kind.label for kind in kinds}) == len(kinds)


def test_the_default_pose_is_sent_in_the_sdks_order() -> None:
    command = JointCommand(
        1, facts.DEFAULT_POSITION_RAD, np.zeros(12), np.zeros(12), Gains.stand(), STAMP_NS + 50_000_000
    )
    joint = decoded(CommandEncoder("me", 35.0).encode(command, STAMP_NS)).joint_command
    assert list(joint.gains.k_q_p)[:3] == [624.0, 936.0, 286.0]
    assert np.allclose(joint.position[:3], [0.1, 0.9, -1.5])


@pytest.mark.parametrize("at", ["client", "make"])
def test_a_robot_that_watches_for_nobodys_silence_is_used_all_the_same(at: str) -> None:
    class Refusing:
        def client(self, kind: Any) -> Any:
            if at == "client":
                raise NoServiceError("the robot has no keepalive service")
            return kind

        def make(self, doing: str, _call: Any) -> Any:
            raise HalError(f"{doing}: refused")

    jobs = Jobs(lambda _name, _error: None)
    lease = lease_pb2.Lease(resource="body", epoch="a", sequence=[1])
    why = watch_for_silence(Refusing(), lease, RunConfig().robot, jobs, 0.0)  # type: ignore[arg-type]
    assert why == ("the robot has no keepalive service" if at == "client" else "adding a keepalive policy: refused")
    assert jobs.run_due(1e9) == 1.0  # nothing checks in
