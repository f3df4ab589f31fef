"""The parts of the operator's interface, each by itself."""

from __future__ import annotations

import contextlib
import math
import select
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import grpc
import numpy as np
import pytest

from spot_log.format.records import EventRecord, Severity
from spot_model.errors import BadInputError
from spot_protos import operator_pb2, run_link_pb2
from spot_runtime.config import RunConfig, ServiceConfig
from spot_runtime.control.modes import Mode
from spot_runtime.operator.door.access import Buckets, Gate, Lane, Refusal
from spot_runtime.operator.door.callers import Caller, Role
from spot_runtime.operator.listening import SocketFile, default_address, is_loopback, server_tls
from spot_runtime.operator.run.link import MAX_TAKEN, RunLink
from spot_runtime.operator.run.requests import BackgroundTask
from spot_runtime.operator.run.run_status import STANDING_BY
from spot_runtime.operator.run.steering import Attendance, OperatorSource
from spot_runtime.operator.server import service as rules
from spot_runtime.operator.server.policy_folder import PolicyFolder
from spot_runtime.operator.server.service_state import KEPT, EventHistory, State
from spot_runtime.stops import StopReason
from spot_tools import ctl
from spot_tools.watch import _body

from .conftest import POLICIES, wait_until

S = 1_000_000_000
EVENT = EventRecord(1, 2, Severity.WARNING, "mode", "x" * 200, {"age_s": 0.5})


# The link -------------------------------------------------------------------------------------------------------------


def pair() -> tuple[RunLink, socket.socket]:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    return RunLink(ours), theirs


def test_a_full_link_drops_and_counts() -> None:
    link, peer = pair()
    for _ in range(20_000):
        link.event(EVENT)
    assert link.untold > 0
    read = 0
    while select.select([peer], [], [], 0.0)[0]:
        read += len(peer.recv(65536)) > 0
    assert read + link.untold == 20_000
    link.event(EVENT)
    assert peer.recv(65536)
    link.close()
    peer.close()


def test_a_flood_is_taken_a_few_at_a_time_and_what_is_malformed_is_passed_over() -> None:
    link, peer = pair()
    for i in range(10):
        peer.send(run_link_pb2.ToRun(request_id=i + 1, attend=operator_pb2.AttendRequest()).SerializeToString())
    peer.send(b"\xff\xff\xff")
    assert [m.request_id for m in link.take()] == list(range(1, MAX_TAKEN + 1))
    assert [m.request_id for m in link.take()] == [9, 10]
    assert not link.take()
    assert not link.is_lost
    peer.close()
    assert not link.take()
    assert link.is_lost
    link.event(EVENT)  # nobody is there, and nothing happens
    link.close()


def test_only_what_was_asked_with_a_number_is_answered() -> None:
    link, peer = pair()
    link.answer(0, is_done=True, text="nobody waits")
    link.answer(7, is_done=False, text="no")
    told = run_link_pb2.FromRun.FromString(peer.recv(65536))
    assert (told.answer.request_id, told.answer.is_done, told.answer.text) == (7, False, "no")
    link.close()
    peer.close()


# Steering -------------------------------------------------------------------------------------------------------------


def test_the_dead_man_by_hand() -> None:
    """2 m/s² up to 0.5 m/s takes 0.25 s; 0.25 s after the last word it falls to zero within 0.25 s."""
    source = OperatorSource(RunConfig())
    speeds = {}
    for step in range(101):
        now_ns = step * S // 100
        if now_ns <= 0.4 * S:
            source.steer(np.array([0.5, 0.0, 0.0]), now_ns)
        speeds[step] = source.sample(0.0, now_ns).command[0]
    assert speeds[10] == pytest.approx(0.2)
    assert speeds[25] == pytest.approx(0.5)
    assert speeds[65] == pytest.approx(0.5)  # silent for exactly 0.25 s
    assert speeds[66] == pytest.approx(0.5)  # the fade begins
    assert speeds[78] == pytest.approx(0.5 * (1 - 0.12 / 0.25))
    assert all(speeds[step] == 0.0 for step in range(91, 101))


def test_letting_go_fades_at_once() -> None:
    source = OperatorSource(RunConfig())
    for step in range(30):
        source.steer(np.array([0.5, 0.0, 0.0]), step * S // 100)
        source.sample(0.0, step * S // 100)
    source.let_go()
    source.sample(0.0, 30 * S // 100)
    assert source.sample(0.0, 56 * S // 100).command[0] == 0.0


def test_attendance_by_hand() -> None:
    attendance = Attendance(RunConfig(), 0)
    assert attendance.check(10 * S) is None
    stop = attendance.check(10 * S + 1)
    assert stop is not None
    assert stop.reason is StopReason.OPERATOR_GONE
    attendance.seen(12 * S)
    attendance.seen(3 * S)  # a clock that runs backwards takes nobody's presence away
    assert attendance.check(22 * S) is None


# Rules and rights -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("check", "words"),
    [
        (lambda: rules.checked_labels({"a b": "c"}), "label 'a b' = 'c' is not valid"),
        (lambda: rules.checked_labels({"a": "x" * 257}), "printable values of at most 256"),
        (lambda: rules.checked_labels({"a": "two\nlines"}), "printable values of at most 256"),
        (lambda: rules.checked_labels({f"k{i}": "" for i in range(33)}), "33 labels are given; allowed: at most 32"),
        (lambda: rules.checked_labels({}, at_least=1), "no label is given"),
        (lambda: rules.checked_operator("x" * 65), "at most 64 characters"),
        (lambda: rules.checked_sha256("abc"), "64 hexadecimal digits"),
        (lambda: rules.checked_rate_hz(math.nan), "rate_hz = nan; allowed: 0.1 to 10"),
        (lambda: rules.checked_rate_hz(11.0), "rate_hz = 11.0"),
        (lambda: velocity(math.nan), "v_x_m_s = nan is no number"),
        (lambda: velocity(math.inf), "v_x_m_s = inf is no number"),
        (lambda: velocity(1.6), "v_x_m_s = 1.6; this policy takes -1 to 1.5"),
    ],
)
def test_requests_that_are_refused_at_the_edge(check, words: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(Refusal) as refused:
        check()
    assert words in refused.value.text
    assert refused.value.code is grpc.StatusCode.INVALID_ARGUMENT


def velocity(v_x: float) -> tuple[float, float, float]:
    request = operator_pb2.SetVelocityRequest(v_x_m_s=v_x)
    return rules.checked_velocity(request, (-1.0, -0.5, -1.0), (1.5, 0.5, 1.0))


def test_requests_that_pass() -> None:
    assert rules.checked_labels({"surface": "wet grass"}) == {"surface": "wet grass"}
    assert velocity(1.5) == (1.5, 0.0, 0.0)
    assert rules.checked_rate_hz(0.0) == 2.0
    assert rules.checked_sha256("A" * 64) == "a" * 64


def test_a_bucket_by_hand() -> None:
    now = [0.0]
    buckets = Buckets(2.0, now_s=lambda: now[0])
    assert [buckets.take("a") for _ in range(3)] == [True, True, False]
    assert buckets.take("b")
    now[0] = 0.5
    assert [buckets.take("a") for _ in range(2)] == [True, False]
    now[0] = 100.0
    assert [buckets.take("a") for _ in range(3)] == [True, True, False]
    for i in range(1000):
        buckets.take(f"client {i}")
    assert len(buckets._buckets) == 256


ANNA, OTTO, MALLORY = (
    Caller("certificate 1", "anna", Role.OPERATE),
    Caller("certificate 2", "otto", Role.OBSERVE),
    Caller("certificate 3", "mallory", None),
)


def test_roles_decide_before_anything_else() -> None:
    gate = Gate(requests_per_s=50.0, steering_per_s=50.0)
    gate.check_role("start", ANNA, Role.OPERATE)
    gate.check_role("status", OTTO, Role.OBSERVE)
    for caller, words in ((OTTO, "needs the role operate"), (MALLORY, "names no role")):
        with pytest.raises(Refusal, match=words):
            gate.check_role("start", caller, Role.OPERATE)


def test_rates_are_a_connections_and_a_callers_and_a_stop_has_none() -> None:
    gate = Gate(requests_per_s=2.0, steering_per_s=5.0)

    def taken(connection: str, lane: Lane, *, tries: int = 20) -> int:
        count = 0
        for _ in range(tries):
            with contextlib.suppress(Refusal):
                gate.check_rate("x", ANNA, connection, lane)
                count += 1
        return count

    assert [taken(f"connection {i}", Lane.ORDINARY) for i in range(6)] == [2, 2, 2, 2, 0, 0]
    assert taken("connection 1", Lane.STEER) == 5
    for lane in (Lane.STOP, Lane.DAMP, Lane.ATTEND):
        assert taken("connection 1", lane) == 20


def test_too_many_streams_are_refused() -> None:
    gate = Gate(requests_per_s=50.0, steering_per_s=50.0)
    for _ in range(8):
        gate.open_stream("watch", ANNA)
    with pytest.raises(Refusal, match="8 streams are open"):
        gate.open_stream("watch", ANNA)
    gate.open_stream("watch", OTTO)
    gate.close_stream(ANNA)
    gate.open_stream("watch", ANNA)


# Policies, events, background tasks -----------------------------------------------------------------------------------


def test_policies_are_found_by_name_alone(tmp_path: Path) -> None:
    (tmp_path / "outside.onnx").write_bytes(b"secret")
    folder = tmp_path / "policies"
    folder.mkdir()
    (folder / "walk.onnx").write_bytes(b"one")
    (folder / "link.onnx").symlink_to(tmp_path / "outside.onnx")
    (folder / "odd name.onnx").write_bytes(b"two")
    shelf = PolicyFolder(ServiceConfig(policies=folder))
    assert [p.name for p in shelf.list()] == ["walk"]
    found = shelf.find("walk", "")
    assert found.is_allowed
    assert shelf.find("walk", found.sha256.upper()) == found
    for name, sha256, words in (
        ("../outside", "", "no path"),
        ("", "", "is not valid"),
        ("link", "", "there is no policy 'link'.*there are: walk"),
        ("walk", "0" * 64, "copy the right file"),
    ):
        with pytest.raises(Refusal, match=words):
            shelf.find(name, sha256)


def test_a_folder_of_policies_here_comes_before_the_built_in_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert "fast" in {p.name for p in PolicyFolder(ServiceConfig()).list()}
    (tmp_path / "policies").mkdir()
    (tmp_path / "policies" / "walk.onnx").write_bytes(b"mine")
    mine = PolicyFolder(ServiceConfig())
    assert [p.name for p in mine.list()] == ["walk"]
    assert mine.find("walk", "").size_bytes == 4


def test_only_allowed_digests_may_be_armed(tmp_path: Path) -> None:
    (tmp_path / "walk.onnx").write_bytes(b"one")
    digest = PolicyFolder(ServiceConfig(policies=tmp_path)).find("walk", "").sha256
    assert PolicyFolder(ServiceConfig(policies=tmp_path, policy_sha256=(digest,))).find("walk", "").is_allowed
    other = PolicyFolder(ServiceConfig(policies=tmp_path, policy_sha256=("0" * 64,)))
    assert not other.list()[0].is_allowed
    with pytest.raises(Refusal, match=r"service\.policy_sha256") as refused:
        other.find("walk", "")
    assert refused.value.code is grpc.StatusCode.PERMISSION_DENIED
    with pytest.raises(ValueError, match="is no SHA-256"):
        RunConfig.model_validate({"service": {"policy_sha256": ["abc"]}})


def test_the_event_history_keeps_the_newest_and_numbers_all() -> None:
    book = EventHistory()
    for i in range(KEPT + 10):
        book.add(EventRecord(0, 0, Severity.INFO, str(i), ""))
    kept = book.after(0)
    assert (len(kept), kept[0].number, kept[-1].number) == (KEPT, 11, KEPT + 10)
    assert not book.after(KEPT + 10)


def test_background_tasks() -> None:
    got: list[object] = []
    sync = BackgroundTask(is_sync=True)
    sync.run(lambda: 3, lambda value, error: got.append((value, error)))
    assert got == [(3, None)]
    beside = BackgroundTask(is_sync=False)
    beside.run(lambda: 1 / 0, lambda _, error: got.append(type(error)))
    assert beside.is_busy
    with pytest.raises(RuntimeError):
        beside.run(lambda: 1, lambda *_: None)

    def is_finished() -> bool:
        beside.finish()
        return not beside.is_busy

    wait_until(is_finished, "the task ends")
    assert got[-1] is ZeroDivisionError
    beside.run(lambda: 4, lambda value, _: got.append(value))
    beside.wait()
    assert (got[-1], beside.is_busy) == (4, False)
    beside.wait()


def test_tables_are_whole() -> None:
    assert all(mode.meaning for mode in Mode)
    for state in State:
        assert state.meaning
        assert state.allows


# Listening ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("address", "expected"),
    [
        ("unix:/run/x.sock", True),
        ("127.0.0.1:50", True),
        ("127.9.9.9:50", True),
        ("[::1]:50", True),
        ("localhost:50", True),
        ("0.0.0.0:50", False),
        ("192.168.1.2:50", False),
        ("[::]:50", False),
        ("robot:50", False),
    ],
)
def test_what_is_loopback(address: str, expected: bool) -> None:
    assert is_loopback(address) is expected


@pytest.mark.parametrize("address", ["", "robot", ":50", "host:port"])
def test_what_is_no_address(address: str) -> None:
    with pytest.raises(BadInputError, match="is not valid"):
        is_loopback(address)


def test_the_network_needs_all_three_files(tmp_path: Path) -> None:
    config = RunConfig().service
    with pytest.raises(BadInputError, match="needs mutual TLS"):
        server_tls(config, "0.0.0.0:50")
    assert server_tls(config, "127.0.0.1:50") is None
    some = config.model_copy(update={"tls_key": tmp_path / "key"})
    with pytest.raises(BadInputError, match="name all three"):
        server_tls(some, "127.0.0.1:50")
    key = tmp_path / "key"
    key.write_text("-----BEGIN")
    key.chmod(0o644)
    whole = config.model_copy(update=dict.fromkeys(("tls_key", "tls_certificate", "tls_client_ca"), key))
    with pytest.raises(BadInputError, match=f"chmod 600 {key}"):
        server_tls(whole, "0.0.0.0:50")
    key.chmod(0o600)
    key.write_text("nothing")
    with pytest.raises(BadInputError, match="holds no PEM"):
        server_tls(whole, "0.0.0.0:50")


def test_the_socket_of_the_unit_and_of_a_user() -> None:
    assert default_address({"RUNTIME_DIRECTORY": "/run/spot-rl"}) == "unix:/run/spot-rl/operator.sock"
    assert default_address({"XDG_RUNTIME_DIR": "/run/user/7"}) == "unix:/run/user/7/spot-rl/operator.sock"


def test_a_second_service_on_one_socket_is_refused(tmp_path: Path) -> None:
    first = SocketFile(tmp_path / "s.sock")
    with pytest.raises(Exception, match="another service listens"):
        SocketFile(tmp_path / "s.sock")
    first.close()
    SocketFile(tmp_path / "s.sock").close()
    SocketFile(tmp_path / "made" / "s.sock").close()
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(BadInputError, match="allowed: 100"):
        SocketFile(tmp_path / ("x" * 100))


def test_the_committed_policies_can_be_listed() -> None:
    assert {"walk", "fast", "baseline"} <= {p.name for p in PolicyFolder(ServiceConfig(policies=POLICIES)).list()}


@pytest.mark.parametrize("provider", ["cuda", "tensorrt"])
def test_a_provider_that_is_not_there_is_refused_not_replaced(provider: str) -> None:
    import onnxruntime

    from spot_model.policy.contract import PolicyError
    from spot_model.policy.onnx_session import PROVIDERS
    from spot_model.policy.policy import load_policy

    if PROVIDERS[provider] in onnxruntime.get_available_providers():
        pytest.skip(f"this ONNX Runtime has {provider}")
    with pytest.raises(PolicyError, match=rf"control.inference = '{provider}' needs .* or set 'cpu'"):
        load_policy(POLICIES / "walk.onnx", provider=provider)
    assert RunConfig.model_validate({"control": {"inference": provider}}).control.inference == provider


def test_an_operators_command_starts_without_heavy_libraries() -> None:
    heavy = ("numpy", "pydantic", "rich", "bosdyn.client", "onnxruntime")
    words = f"import spot_tools.ctl, sys; print([m for m in {heavy} if m in sys.modules])"
    told = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "[]"


# ctl ------------------------------------------------------------------------------------------------------------------


class Telling:
    """A service that tells one mode after the other."""

    def __init__(self, *modes: str) -> None:
        self.modes, self.attended = list(modes), 0

    def call(self, name: str, request: Any, timeout_s: float = 0.0) -> Any:
        del request, timeout_s
        if name == "Attend":
            self.attended += 1
            return None
        return operator_pb2.Status(state="running", run=operator_pb2.RunStatus(mode=self.modes.pop(0)))


def test_steering_waits_until_the_policy_is_in_full_control(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also while the last word of a run that has just started is that it stands by."""
    monkeypatch.setattr(ctl.time, "sleep", lambda _: None)
    before = [mode.value for mode in (Mode.READY, Mode.ACTIVATING, Mode.RAMPING_IN)]
    assert set(ctl.BEFORE_CONTROL) == {"", STANDING_BY, *before}
    service = Telling(*ctl.BEFORE_CONTROL, "active", "never asked")
    ctl._wait_until_active(service)  # type: ignore[arg-type]
    assert service.modes == ["never asked"]
    assert service.attended == len(ctl.BEFORE_CONTROL)


@pytest.mark.parametrize(
    ("percent", "words", "style"),
    [
        (64.4, "64 %", "green"),
        (15.0, "15 %", "yellow"),
        (5.0, "5 %", "bold red"),
        (math.nan, "not reported", "bold red"),
    ],
)
def test_the_screen_shows_a_charge_that_is_not_reported_as_a_bad_one(percent: float, words: str, style: str) -> None:
    table = _body(operator_pb2.RunStatus(battery_charge_percent=percent, battery_voltage_v=52.0))
    cell = next(iter(table.columns[1].cells))
    assert (str(cell), cell.style) == (f"{words}  52.0 V", style)  # type: ignore[union-attr]
