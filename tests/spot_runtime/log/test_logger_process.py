"""The log's process: it takes what it is given, counts what is lost, and harms nobody when it dies."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from spot_log import read_run
from spot_log.errors import LogError, LogExistsError
from spot_log.format.records import WireState
from spot_log.write import logger_child
from spot_log.write.logger_process import LoggerProcess
from spot_log.write.run_writer import RunWriter, active_path
from spot_log.write.sink import TOPICS, LogSink, MemorySink, NullSink
from spot_runtime.session.signals import HANDLED

PARENT = """
import os, sys, time
from pathlib import Path
from spot_log.write.logger_process import LoggerProcess
from spot_log.format.records import RunHeader, WireState
sink = LoggerProcess.start(Path(sys.argv[1]), RunHeader(run_id="parent", started_host_stamp_ns=1))
wire = bytes.fromhex(sys.stdin.readline())
for i in range(200):
    sink.put(WireState(wire, 1_000 + i))
print("fed", flush=True)
time.sleep(600)
"""


def wait_until(condition, what: str) -> None:
    """Poll for something that another process does; the bound only ends a hang."""
    for _ in range(3000):
        if condition():
            return
        time.sleep(0.01)
    pytest.fail(f"never: {what}")


@pytest.fixture
def sink(synthetic_run, tmp_path):
    process = LoggerProcess.start(tmp_path / "run.mcap", synthetic_run().header)
    yield process
    process.close("test ended")


def test_every_sink_follows_the_protocol(synthetic_run, tmp_path, sink):
    sinks: list[LogSink] = [NullSink(), MemorySink(), sink]
    for one in sinks:
        fed = synthetic_run(duration_s=0.3).feed(one)
        assert set(one.dropped) == set(TOPICS)
        assert one.health().is_alive
        one.close("completed")
        one.close("again")
    assert fed["state"] == 100
    assert len(sinks[1].states) == 100
    assert sinks[1].outcome == "completed"


def test_a_run_through_the_process_is_whole(synthetic_run, tmp_path, sink):
    fed = synthetic_run().feed(sink)
    assert active_path(sink.path).exists()
    sink.close("completed")
    assert not active_path(sink.path).exists()
    run = read_run(sink.path)
    assert run.footer is not None
    assert run.footer.messages == fed
    assert dict(run.footer.dropped) == dict.fromkeys(TOPICS, 0)
    assert run.outcome == "completed"
    assert run.damage == ()
    assert run.header == synthetic_run().header
    assert sink.health().problem == ""


def test_a_flood_drops_without_waiting_and_every_drop_is_counted(synthetic_run, sink):
    """A stopped process reads nothing, so the socket fills; what it then gets and the drops add up exactly."""
    wire = synthetic_run().message(0).SerializeToString()
    os.kill(sink._child.pid, signal.SIGSTOP)
    for i in range(30_000):
        sink.put(WireState(wire, i))
    dropped = sink.dropped["state"]
    assert 0 < dropped < 30_000
    assert "does not keep up" in sink.health().problem
    os.kill(sink._child.pid, signal.SIGCONT)
    sink.close("completed")
    run = read_run(sink.path)
    assert run.footer is not None
    assert run.footer.dropped["state"] == dropped
    assert len(run.states) == run.footer.messages["state"] == 30_000 - dropped
    assert dict(run.footer.dropped) == dict(sink.dropped)


def test_drops_are_counted_by_gaps_where_the_parent_cannot_tell(tmp_path, synthetic_run):
    """The child sees numbers 0, 1, 4: two are missing."""
    import socket

    from spot_log.format import codec
    from spot_log.write import hand_off

    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, theirs:
        child = logger_child.LoggerChild(theirs, tmp_path / "run.mcap", codec.header_to_proto(synthetic_run().header))
        wire = synthetic_run().message(0).SerializeToString()
        for number in (0, 1, 4):
            ours.send(hand_off.pack(number, WireState(wire, 9)))
        ours.send(b"\x63nonsense")
        ours.send(hand_off.pack(5, WireState(b"\xff\xff\xff", 9)))
        ours.send(hand_off.pack(6, WireState(wire, 9)))
        ours.shutdown(socket.SHUT_WR)
        child.run()
    run = read_run(tmp_path / "run.mcap")
    assert run.footer is not None
    assert run.states.sequence.tolist() == [0, 1, 4, 6]
    assert run.footer.dropped["state"] == 2 + 1
    assert run.footer.dropped["unknown"] == 1
    assert run.outcome == logger_child.PARENT_LOST


def test_a_dead_logger_harms_nobody_and_leaves_a_readable_log(synthetic_run, sink):
    made_up = synthetic_run()
    made_up.feed(sink)
    wait_until(lambda: len(read_run(active_path(sink.path)).states) == made_up.n_states, "everything flushed")
    sink._child.kill()
    sink._child.wait(60.0)
    before = sink.dropped["state"]
    for i in range(50):
        sink.put(WireState(made_up.message(0).SerializeToString(), i))
    sink.put(made_up.command(0, 0))
    assert sink.dropped["state"] == before + 50
    assert sink.dropped["command"] == 1
    health = sink.health()
    assert not health.is_alive
    assert "killed by signal SIGKILL" in health.problem
    assert "run.mcap.active" in health.problem
    sink.close("completed")
    assert sink.health().path == str(active_path(sink.path))
    run = read_run(active_path(sink.path))
    assert len(run.states) == made_up.n_states
    assert run.truncated
    assert "no footer" in run.damage[-1]


def test_a_killed_parent_leaves_a_whole_log_that_says_so(synthetic_run, tmp_path):
    path = tmp_path / "run.mcap"
    with subprocess.Popen(
        [sys.executable, "-c", PARENT, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdin is not None
        assert parent.stdout is not None
        parent.stdin.write(synthetic_run().message(3).SerializeToString().hex() + "\n")
        parent.stdin.flush()
        assert parent.stdout.readline() == "fed\n"
        parent.kill()
    wait_until(path.exists, "the log closed")
    run = read_run(path)
    assert len(run.states) == 200
    assert run.outcome.startswith("interrupted: the process that drove the robot ended")
    assert not run.truncated


def test_the_process_outlives_the_signals_that_end_the_loop(synthetic_run, sink):
    for number in HANDLED:
        sink._child.send(number)
    fed = synthetic_run(duration_s=0.3).feed(sink)
    sink.close("stopped by SIGINT")
    run = read_run(sink.path)
    assert run.outcome == "stopped by SIGINT"
    assert len(run.states) == fed["state"]


def test_a_record_that_cannot_be_packed_is_counted_and_named(synthetic_run, sink):
    good = synthetic_run().command(0, 0)
    sink.put(good._replace(requested_position_rad=good.requested_position_rad[:11]))
    assert sink.dropped["command"] == 1
    assert "a command record could not be handed to the log" in sink.health().problem


def test_refusals_come_in_words_before_anything_moves(synthetic_run, tmp_path):
    header = synthetic_run().header
    taken = tmp_path / "taken.mcap"
    taken.write_text("precious")
    with pytest.raises(LogExistsError, match="logs are never overwritten"):
        LoggerProcess.start(taken, header)
    with pytest.raises(LogError, match=r"there is no directory .*nowhere to log to; make it first"):
        LoggerProcess.start(tmp_path / "nowhere" / "run.mcap", header)
    assert sorted(p.name for p in Path(tmp_path).iterdir()) == ["taken.mcap"]


def test_a_full_disk_is_reported_and_the_log_stays_readable(synthetic_run, tmp_path, monkeypatch):
    """The disk fills after the first flush, and has room again before the end."""
    from spot_log.errors import DiskSpaceError
    from spot_log.write import run_writer

    made_up = synthetic_run()
    writer = run_writer.RunWriter(tmp_path / "run.mcap", made_up.header)
    from spot_log.write import hand_off

    def add(first: int, last: int) -> None:
        for i in range(first, last):
            wire = made_up.message(i).SerializeToString()
            writer.add(hand_off.unpack(hand_off.pack(i, WireState(wire, made_up.received_ns(i)))).message, i)

    add(0, 50)
    writer.flush()
    size = active_path(writer.path).stat().st_size
    add(50, 80)
    monkeypatch.setattr(run_writer.McapFile, "free_bytes", 1000)
    with pytest.raises(DiskSpaceError, match="make room"):
        writer.flush()
    assert active_path(writer.path).stat().st_size == size
    monkeypatch.undo()
    add(80, 100)
    writer.close({"state": 30}, "completed")
    run = read_run(writer.path)
    assert run.states.sequence.tolist() == [*range(50), *range(80, 100)]
    assert run.footer is not None
    assert run.footer.dropped == {"state": 30}


def test_a_log_that_has_no_room_for_its_head_leaves_nothing(synthetic_run, tmp_path, monkeypatch):
    """As over a disk quota, of which the free space of the disk says nothing."""
    real_write, left = os.write, []

    def over_quota(fd: int, data: memoryview) -> int:
        if not left.pop():
            raise OSError(errno.EDQUOT, os.strerror(errno.EDQUOT))
        return real_write(fd, data)

    monkeypatch.setattr(os, "write", over_quota)
    for room_for in ([], [True], [True, True]):
        left[:] = [False, *room_for]
        with pytest.raises(OSError, match="Disk quota exceeded"):
            RunWriter(tmp_path / "run.mcap", synthetic_run().header)
        assert list(tmp_path.iterdir()) == []


def test_a_write_that_fails_half_way_is_taken_back(synthetic_run, tmp_path, monkeypatch):
    made_up = synthetic_run()
    path = made_up.write(tmp_path / "whole.mcap")
    whole = path.read_bytes()
    from spot_log.format.codec import ALL_TOPICS, STATE
    from spot_log.write.mcap_file import McapFile

    file = McapFile(tmp_path / "half.mcap", ALL_TOPICS)
    file.add(STATE.channel_id, whole[:5000], log_ns=1, publish_ns=1, sequence=0)
    size = (tmp_path / "half.mcap").stat().st_size
    real_write = os.write

    def half(fd: int, data: memoryview) -> int:
        if len(data) > 1000:
            return real_write(fd, data[:1000])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "write", half)
    with pytest.raises(OSError, match="No space left"):
        file.flush()
    monkeypatch.undo()
    assert (tmp_path / "half.mcap").stat().st_size == size
    file.add(STATE.channel_id, b"", log_ns=2, publish_ns=2, sequence=1)
    file.finish()
    assert file.written_counts == {STATE.channel_id: 1}


def test_inherited_real_time_settings_are_shed(monkeypatch):
    asked = {}
    monkeypatch.setattr(os, "sched_setscheduler", lambda _pid, policy, _param: asked.update(policy=policy))
    monkeypatch.setattr(os, "sched_setaffinity", lambda _pid, cpus: asked.update(cpus=list(cpus)))
    monkeypatch.setattr(signal, "signal", lambda number, action: asked.update({number: action}))
    logger_child.shed_inherited_settings()
    assert asked["policy"] == os.SCHED_OTHER
    assert asked["cpus"] == list(range(os.cpu_count()))
    assert asked[signal.SIGINT] == asked[signal.SIGTERM] == signal.SIG_IGN


def test_a_folder_that_is_moved_takes_the_log_along(synthetic_run, tmp_path):
    folder, elsewhere = tmp_path / "logs", tmp_path / "elsewhere"
    folder.mkdir()
    sink = LoggerProcess.start(folder / "run.mcap", synthetic_run().header)
    synthetic_run(duration_s=0.3).feed(sink)
    folder.rename(elsewhere)
    folder.mkdir()  # by somebody who wants the name
    sink.close("completed")
    health = sink.health()
    assert health.path == str(elsewhere / "run.mcap")
    assert health.problem == f"the log's folder was moved while it was being written; the log is in {elsewhere}"
    assert not any([*health.unwritten.values(), *health.dropped.values()])
    assert read_run(elsewhere / "run.mcap").outcome == "completed"
    assert [path.name for path in elsewhere.iterdir()] == ["run.mcap"]


def test_what_takes_the_place_of_a_log_does_not_become_the_log(synthetic_run, tmp_path, sink):
    synthetic_run(duration_s=0.3).feed(sink)
    active, target = active_path(sink.path), tmp_path / "target"
    target.write_text("theirs")
    wait_until(lambda: active.stat().st_size > 1000, "something is written")
    active.rename(tmp_path / "aside")
    active.symlink_to(target)
    sink.close("completed")
    health = sink.health()
    assert (health.path, health.problem) == (str(sink.path), "")
    assert not any(health.unwritten.values())
    assert not sink.path.is_symlink()
    assert read_run(sink.path).outcome == "completed"
    assert (active.is_symlink(), target.read_text()) == (True, "theirs")


def test_a_log_without_a_name_is_lost_as_a_whole_and_counted_once(synthetic_run, sink):
    made_up = synthetic_run(duration_s=0.3)
    fed = made_up.feed(sink)
    wait_until(lambda: active_path(sink.path).stat().st_size > 10_000, "it is written")
    active_path(sink.path).unlink()
    fed = {topic: 2 * n for topic, n in fed.items()}
    made_up.feed(sink)
    wait_until(lambda: sink.health().unwritten["state"] > 0, "a flush has failed")
    sink.close("completed")
    assert not sink.path.exists()
    health = sink.health()
    assert health.path == ""
    assert "its file was deleted, or its disk unmounted" in health.problem
    assert {topic: n for topic, n in health.unwritten.items() if n} == {topic: n for topic, n in fed.items() if n}
