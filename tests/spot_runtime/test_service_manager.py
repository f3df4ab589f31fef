"""The notify protocol and the journal, against sockets of the test's own."""

from __future__ import annotations

import contextlib
import io
import os
import select
import socket
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from spot_log.format.records import EventRecord, Severity
from spot_log.write.sink import MemorySink
from spot_model.io.velocity_sequence import standing_sequence
from spot_model.policy.policy import Policy
from spot_runtime.config import RunConfig
from spot_runtime.host.journal import Console, Journal, entry_of, goes_to_journal, tell_by
from spot_runtime.host.service_manager import ServiceManager
from spot_runtime.session.run import RunRequest, run_once
from spot_tools.sources import ScriptedSource


class Listener:
    """The manager's end of the socket."""

    def __init__(self, address: str | bytes) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(address)

    def messages(self) -> list[bytes]:
        found = []
        while select.select([self.socket], [], [], 0.0)[0]:
            found.append(self.socket.recv(65536))
        return found


@pytest.fixture
def listener(tmp_path: Path) -> Iterator[Listener]:
    listener = Listener(str(tmp_path / "notify"))
    yield listener
    listener.socket.close()


@pytest.fixture
def address(tmp_path: Path) -> str:
    return str(tmp_path / "notify")


@pytest.fixture
def make_manager() -> Iterator[Callable[..., ServiceManager]]:
    """Makes managers that are closed when the test ends, however it does."""
    with contextlib.ExitStack() as stack:

        def make(*arguments: Any, **keywords: Any) -> ServiceManager:
            manager = ServiceManager(*arguments, **keywords)
            stack.callback(manager.close)
            return manager

        yield make


MakeManager = Callable[..., ServiceManager]


def test_messages_of_a_life(listener: Listener, address: str, make_manager: MakeManager) -> None:
    manager = make_manager(address)
    manager.status("two\nlines")
    for _ in range(2):
        manager.ready()
    for _ in range(2):
        manager.stopping()
    manager.close()
    manager.status("nobody hears this")
    assert listener.messages() == [b"STATUS=two lines", b"READY=1", b"STOPPING=1"]
    assert manager.lost == 0


def test_an_abstract_socket(make_manager: MakeManager) -> None:
    name = f"spot-rl-test-{os.getpid()}"
    listener = Listener(b"\0" + name.encode())
    manager = make_manager(f"@{name}")
    manager.ready()
    assert listener.messages() == [b"READY=1"]
    listener.socket.close()


def test_the_watchdog_is_fed_by_progress_four_times_a_period(
    listener: Listener, address: str, make_manager: MakeManager
) -> None:
    now_ns = 0
    manager = make_manager(address, 2_000_000_000, monotonic_ns=lambda: now_ns)
    for _ in range(1000):  # a cycle each 4 ms, for 4 s
        manager.progressed()
        now_ns += 4_000_000
    assert listener.messages() == [b"WATCHDOG=1"] * 8
    now_ns += 60_000_000_000  # the loop hangs: whatever else is told, the watchdog is not fed
    manager.status("still alive")
    manager.ready()
    assert b"WATCHDOG=1" not in listener.messages()
    manager.stopping()
    manager.progressed()  # systemd goes on watching a service that is stopping
    assert listener.messages() == [b"STOPPING=1", b"WATCHDOG=1"]


def test_what_the_environment_says(listener: Listener, address: str) -> None:
    def feeds(**environment: str) -> bool:
        manager = ServiceManager.from_environment({"NOTIFY_SOCKET": address, **environment})
        manager.progressed()
        manager.close()
        return listener.messages() == [b"WATCHDOG=1"]

    assert feeds(WATCHDOG_USEC="2000000")
    assert feeds(WATCHDOG_USEC="2000000", WATCHDOG_PID=str(os.getpid()))
    assert not feeds(WATCHDOG_USEC="2000000", WATCHDOG_PID=str(os.getpid() + 1))
    assert not feeds()
    assert not feeds(WATCHDOG_USEC="soon")


def test_without_a_manager_nothing_happens() -> None:
    for environment in ({}, {"NOTIFY_SOCKET": "relative"}, {"NOTIFY_SOCKET": ""}):
        manager = ServiceManager.from_environment({**environment, "WATCHDOG_USEC": "1000"})
        assert not manager.is_listening
        manager.ready()
        manager.progressed()
        manager.stopping()
        assert manager.lost == 0


def test_a_manager_that_is_gone_or_does_not_read_costs_nothing_but_a_count(
    tmp_path: Path, address: str, make_manager: MakeManager
) -> None:
    gone = make_manager(str(tmp_path / "nobody"))
    gone.ready()
    assert gone.lost == 1
    deaf = Listener(address)
    manager = make_manager(address)
    for _ in range(20_000):
        manager.status("x" * 100)  # never blocks
    assert 0 < manager.lost < 20_000
    deaf.socket.close()


def a_run(robot: Any, policy: Policy, manager: ServiceManager, **keywords: Any) -> tuple[int, str]:
    text = io.StringIO()
    console = Console(text, period_s=600.0)
    real_time = {"fifo_priority": 0, "lock_memory": False, "freeze_garbage_collection": False}
    config = RunConfig.model_validate({"real_time": real_time, "handover": {"ramp_in_s": 0.2, "ramp_out_s": 0.2}})
    source = ScriptedSource(standing_sequence(), duration_s=0.5)
    request = RunRequest("by hand", policy, source, config, Path("unused.mcap"))
    try:
        summary = run_once(request, lambda _: robot, lambda *_: MemorySink(), console, manager=manager, **keywords)
    finally:
        console.close()
    return summary.exit_code, text.getvalue()


def test_a_run_is_ready_when_the_loop_begins_and_stopping_when_it_ends(
    listener: Listener, address: str, make_manager: MakeManager, robot: Any, zero_policy: Policy
) -> None:
    # Robot time is the clock, so that few messages wait in the socket: it holds about ten.
    manager = make_manager(address, 4_000_000_000, monotonic_ns=lambda: robot.now_ns)
    assert a_run(robot, zero_policy, manager)[0] == 0
    assert manager.lost == 0
    told = listener.messages()
    assert told[0].startswith(b"STATUS=policy test states no gait")
    assert told[1:5] == [
        "STATUS=connecting to by hand …".encode(),
        "STATUS=powering on and standing …".encode(),
        b"READY=1",
        b"WATCHDOG=1",
    ]
    assert told[-2:] == [b"STOPPING=1", "STATUS=sitting and powering off …".encode()]
    assert set(told[4:-2]) == {b"WATCHDOG=1"}


def test_a_run_that_never_stands_is_never_ready(
    listener: Listener,
    address: str,
    make_manager: MakeManager,
    robot: Any,
    zero_policy: Policy,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from spot_runtime.hal.errors import MotionError

    def fall_over() -> None:
        raise MotionError("the robot did not stand")

    monkeypatch.setattr(robot, "stand", fall_over)
    manager = make_manager(address, 1000)
    assert a_run(robot, zero_policy, manager)[0] == 89
    told = listener.messages()
    assert b"READY=1" not in told
    assert b"WATCHDOG=1" not in told
    assert told[-2:] == [b"STOPPING=1", "STATUS=sitting and powering off …".encode()]


def test_events_go_where_they_are_taken(robot: Any, zero_policy: Policy) -> None:
    taken: list[str] = []
    _, text = a_run(robot, zero_policy, ServiceManager(), tell=lambda record: taken.append(record.name))
    assert "run_started" in taken
    assert "run_started" not in text


def test_what_the_journal_does_not_take_goes_to_the_console(tmp_path: Path) -> None:
    heard, record = io.StringIO(), EventRecord(5, 7, Severity.WARNING, "lost", "lost: no reader")
    console, journal = Console(heard), Journal(tmp_path / "journal")
    tell_by(journal, console)(record)
    listener = Listener(str(tmp_path / "journal"))
    tell_by(journal, console)(record)
    assert len(listener.messages()) == 1
    listener.socket.close()
    journal.close()
    console.close()
    assert heard.getvalue() == "warning: lost: no reader\n"


def test_an_entry_of_the_journal(tmp_path: Path) -> None:
    listener = Listener(str(tmp_path / "journal"))
    journal = Journal(tmp_path / "journal")
    record = EventRecord(5, 7, Severity.ERROR, "stop", "tilt: the body tilts too far", {"tilt_rad": 0.8125})
    assert journal.event(record)
    (entry,) = listener.messages()
    assert entry.decode().splitlines() == [
        "MESSAGE=stop: tilt: the body tilts too far",
        "PRIORITY=3",
        "SYSLOG_IDENTIFIER=spot-rl",
        "SPOT_RL_EVENT=stop",
        "SPOT_RL_HOST_STAMP_NS=5",
        "SPOT_RL_ROBOT_STAMP_NS=7",
        "SPOT_RL_TILT_RAD=0.8125",
    ]
    listener.socket.close()
    assert not journal.event(record)
    journal.close()


def test_a_value_of_several_lines_has_its_length_before_it() -> None:
    # By hand: name, newline, 3 as 64-bit little endian, "a\nb", newline.
    assert entry_of({"A": "a\nb", "C": "d=e"}) == b"A\n" + struct.pack("<Q", 3) + b"a\nb\nC=d=e\n"


def test_a_stream_goes_to_the_journal_only_if_it_is_the_named_one(tmp_path: Path) -> None:
    with (tmp_path / "stream").open("w") as stream:
        status = os.fstat(stream.fileno())
        name = f"{status.st_dev}:{status.st_ino}"
        assert goes_to_journal(stream, {"JOURNAL_STREAM": name})
        assert not goes_to_journal(stream, {"JOURNAL_STREAM": "1:2"})
        assert not goes_to_journal(stream, {})
    assert not goes_to_journal(io.StringIO(), {"JOURNAL_STREAM": name})
