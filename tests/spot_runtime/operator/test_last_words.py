"""The last words of a control process: they are waited for, whatever the system says of the process meanwhile."""

from __future__ import annotations

import contextlib
import fcntl
import os
import resource
import signal
import socket
import subprocess
import sys
import threading
from typing import cast

import pytest

from spot_log.format.records import EventRecord, Severity
from spot_model.process.child_process import ChildProcess
from spot_protos import operator_pb2, run_link_pb2
from spot_runtime.operator.run.link import RunLink, receive
from spot_runtime.operator.server import run_process
from spot_runtime.operator.server.armed_run import ArmedRun
from spot_runtime.operator.server.run_process import RunProcess

from .conftest import wait_until

SAYS = """
import socket, sys, time
from spot_protos import operator_pb2, run_link_pb2
link = socket.socket(fileno=int(sys.argv[1]))
for number in range(60):
    link.send(run_link_pb2.FromRun(state=f"state {number}").SerializeToString())
link.send(run_link_pb2.FromRun(ended=operator_pb2.Outcome(outcome="said", exit_code=83)).SerializeToString())
sys.exit(int(sys.argv[2]))
"""


def talker(code: int) -> tuple[subprocess.Popen[bytes], socket.socket, socket.socket]:
    """A process that says much and ends with this code, our end of its link, and its own."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    words = [sys.executable, "-c", SAYS, str(theirs.fileno()), str(code)]
    return subprocess.Popen(words, pass_fds=(theirs.fileno(),)), ours, theirs


def all_told(run: RunProcess) -> list[str]:
    told: list[str] = []

    def is_over() -> bool:
        told.extend(message.WhichOneof("what") or "" for message in run.read(0.05))
        return run.exit_code() is not None

    wait_until(is_over, "the process ends")
    return told


def test_the_verdict_waits_for_the_last_words_of_a_process_that_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_process, "MAX_READ", 7)
    process, ours, theirs = talker(83)
    theirs.close()
    process.wait()  # its reader comes late
    run = RunProcess(ChildProcess(process), ours)
    assert run.exit_code() is None
    assert all_told(run) == ["state"] * 60 + ["ended"]
    assert run.exit_code() == 83
    run.close()


def test_a_process_that_runs_has_not_ended_whatever_popen_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """Popen reads a child that it cannot wait for as ended with 0, and sends it no signal."""
    monkeypatch.setattr(run_process, "LAST_WORDS_S", 0.0)
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    words = [sys.executable, "-c", f"input(); {SAYS}", str(theirs.fileno()), "83"]
    process = subprocess.Popen(words, pass_fds=(theirs.fileno(),), stdin=subprocess.PIPE)
    theirs.close()
    run = RunProcess(ChildProcess(process), ours)
    process.returncode = 0
    for _ in range(3):
        assert run.read(0.01) == ()
        assert run.exit_code() is None
    assert process.stdin is not None
    process.stdin.write(b"\n")
    process.stdin.flush()
    assert all_told(run)[-1] == "ended"
    run.close()
    process.returncode = None
    assert process.wait() == 83


def test_signals_reach_a_process_that_popen_takes_for_ended() -> None:
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    child = ChildProcess(process)
    process.returncode = 0
    assert child.exit_code is None
    assert child.wait(0.0) is None
    child.end(0.0)
    process.returncode = None
    assert process.wait() == -signal.SIGKILL


def test_a_link_may_have_any_number() -> None:
    """A process with many files has descriptors beyond the 1,023 that select takes."""
    process, ours, theirs = talker(5)
    theirs.close()
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    try:
        high = socket.socket(fileno=fcntl.fcntl(ours.fileno(), fcntl.F_DUPFD_CLOEXEC, 2000))
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    ours.close()
    run = RunProcess(ChildProcess(process), high)
    assert all_told(run)[-1] == "ended"
    run.close()


def test_a_link_that_a_grandchild_holds_does_not_keep_the_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_process, "LAST_WORDS_S", 0.0)
    process, ours, held = talker(5)
    with held:
        process.wait()
        run = RunProcess(ChildProcess(process), ours)
        wait_until(lambda: run.exit_code() is not None, "the verdict is there")
        assert run.exit_code() == 5
        run.close()


def test_the_word_of_the_end_waits_for_room_and_is_cut_to_fit() -> None:
    ours, peer = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    link, event = RunLink(ours), EventRecord(1, 2, Severity.WARNING, "mode", "x" * 200)
    for _ in range(100_000):
        if link.untold:
            break
        link.event(event)
    untold = link.untold
    peer.settimeout(30.0)
    reader = threading.Timer(0.2, lambda: [peer.recv(65536) for _ in range(100)])
    reader.start()
    paths = [f"/logs/{number}/{'x' * 200}.mcap" for number in range(200)]
    link.ended(operator_pb2.Outcome(outcome="tilt", exit_code=31, sentence="y" * 30_000, log_paths=paths))
    reader.join()
    assert link.untold == untold
    peer.setblocking(False)
    told = []
    with contextlib.suppress(BlockingIOError):
        while True:
            told.append(run_link_pb2.FromRun.FromString(peer.recv(65536)))
    assert told[-1].ended.outcome == "tilt"
    assert told[-1].ended.sentence.endswith("y … (cut; see the journal)")
    assert list(told[-1].ended.log_paths) == paths[-10:]
    link.close()
    peer.close()


def test_the_last_word_is_read_though_the_other_end_closed_before_it_had_read_ours() -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.setblocking(False)
    with ours:
        ours.send(run_link_pb2.ToRun(attend=operator_pb2.AttendRequest()).SerializeToString())
        link = RunLink(theirs)
        link.ended(operator_pb2.Outcome(outcome="no_credentials", exit_code=69))
        link.close()
        received = receive(ours, run_link_pb2.FromRun, 10)
    assert [message.ended.outcome for message in received.messages] == ["no_credentials"]
    assert received.is_end


@pytest.mark.parametrize(("code", "expected"), [(0, 70), (10, 70), (83, 70), (-9, -9)])
def test_without_a_last_word_no_end_counts_as_good(code: int, expected: int) -> None:
    run = ArmedRun(cast("RunProcess", None))
    outcome = run.outcome(code)
    assert (outcome.outcome, outcome.exit_code) == ("control_process_died", expected)
    run.take(run_link_pb2.FromRun(ended=operator_pb2.Outcome(outcome="said", exit_code=10)))
    assert run.outcome(code).exit_code == 10


def test_a_control_process_that_was_never_heard_touched_no_robot_and_the_verdict_says_so() -> None:
    run = ArmedRun(cast("RunProcess", None))
    assert "touched no robot" in run.outcome(-15).sentence
    run.take(run_link_pb2.FromRun(state="arming"))
    assert "said nothing more; the robot's own time-outs ended the motion" in run.outcome(-15).sentence


def test_a_word_that_the_system_has_no_memory_for_is_lost_and_the_link_is_not() -> None:
    ours, peer = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)  # the least that there is, some kilobytes
    link = RunLink(ours)
    link.event(EventRecord(1, 2, Severity.WARNING, "mode", "x" * 12_000))
    assert (link.untold, link.is_lost) == (1, False)
    link.ended(operator_pb2.Outcome(outcome="tilt", exit_code=31))
    assert run_link_pb2.FromRun.FromString(peer.recv(65536)).ended.outcome == "tilt"
    link.close()
    peer.close()


def test_the_last_word_is_one() -> None:
    ours, peer = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    link = RunLink(ours)
    for outcome in ("tilt", "broken off"):
        link.ended(operator_pb2.Outcome(outcome=outcome))
    assert run_link_pb2.FromRun.FromString(peer.recv(65536)).ended.outcome == "tilt"
    link.close()
    assert peer.recv(65536) == b""
    peer.close()


SWALLOWED = """
import os, signal, sys, weakref
from spot_runtime.operator.run import run_child
class Thing: pass
def begin(link, first=run_child.RunLink.begin):
    first(link)
    thing = Thing()
    watched = weakref.ref(thing, lambda _: os.kill(os.getpid(), signal.SIGTERM) or sum(range(10)))
    del thing
run_child.RunLink.begin = begin
run_child.main()
"""


def begun(told: int, *program: str) -> tuple[ChildProcess, RunProcess]:
    """A control process whose spec comes through this descriptor, once it has said its first word."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    program = program or ("-m", "spot_runtime.operator.run.run_child")
    words = [sys.executable, *program, str(theirs.fileno())]
    process = ChildProcess(subprocess.Popen(words, pass_fds=(theirs.fileno(),), stdin=told))
    theirs.close()
    run = RunProcess(process, ours)
    wait_until(lambda: [message.state for message in run.read(0.05)] == ["arming"], "it has begun")
    return process, run


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_control_process_that_is_ended_while_it_still_starts_has_a_last_word(number: signal.Signals) -> None:
    """A computer that is busy may need minutes to start it, and its time to arm may be over by then."""
    reading, writing = os.pipe()  # the spec does not come
    process, run = begun(reading)
    process.send(number)
    told: list[run_link_pb2.FromRun] = []

    def is_over() -> bool:
        told.extend(run.read(0.05))
        return run.exit_code() is not None

    wait_until(is_over, "it ends")
    assert (told[-1].ended.outcome, told[-1].ended.exit_code, run.exit_code()) == ("BrokenOffError", 10, 10)
    assert f"{number.name} came before the robot was touched" in told[-1].ended.sentence
    run.close()
    os.close(reading)
    os.close(writing)


def test_a_signal_that_python_swallows_ends_the_start_too(capfd: pytest.CaptureFixture[str]) -> None:
    reading, writing = os.pipe()  # the spec does not come
    _, run = begun(reading, "-c", SWALLOWED)
    wait_until(lambda: not run.read(0.05) and run.exit_code() is not None, "it ends")
    assert run.exit_code() == 10
    assert "Exception ignored" in capfd.readouterr().err
    run.close()
    os.close(reading)
    os.close(writing)


def test_a_control_process_that_cannot_be_heard_goes_no_further(capfd: pytest.CaptureFixture[str]) -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.close()
    reading, writing = os.pipe()  # nothing is ever read from it
    words = [sys.executable, "-m", "spot_runtime.operator.run.run_child", str(theirs.fileno())]
    with theirs, subprocess.Popen(words, pass_fds=(theirs.fileno(),), stdin=reading) as process:
        assert process.wait() == 14
    assert capfd.readouterr().err == ""
    os.close(reading)
    os.close(writing)
