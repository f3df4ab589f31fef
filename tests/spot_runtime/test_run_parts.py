"""The parts around the loop: signals, real-time rights, console, summary, lock, tables, command line."""

from __future__ import annotations

import fcntl
import gc
import io
import json
import os
import re
import signal
import subprocess
import sys
import threading
from datetime import datetime, timezone
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from spot_log.errors import LogError
from spot_log.write.run_writer import make_log_folder
from spot_model.console.command_line import main
from spot_model.errors import BadInputError
from spot_model.policy.policy import Policy
from spot_runtime.config import RealTimeConfig, RunConfig, for_lock_step
from spot_runtime.control.loop_stats import PENDING_MAX, LoopStats, RecentValues
from spot_runtime.host import realtime
from spot_runtime.host.instance_lock import AlreadyRunningError, InstanceLock, open_locked
from spot_runtime.host.journal import Console
from spot_runtime.session.run import log_file_name
from spot_runtime.session.signals import OperatorInterrupt, StopSignals
from spot_runtime.session.summary import RunSummary, figures, resident_mb
from spot_runtime.stops import StopReason
from spot_tools.run import make_source, summary_text
from spot_tools.sources import PygamePad

ROOT = Path(__file__).parents[2]
MS = 1_000_000


# Signals -------------------------------------------------------------------------------------------------------------


def test_the_first_signal_asks_for_a_stop_and_the_second_for_damping() -> None:
    with StopSignals() as signals:
        assert signals.take() is None
        os.kill(os.getpid(), signal.SIGTERM)
        first = signals.take()
        os.kill(os.getpid(), signal.SIGINT)
        second = signals.take()
        assert signals.take() is None
    assert first is not None
    assert (first.reason, first.detail) == (StopReason.OPERATOR_STOP, "SIGTERM")
    assert second is not None
    assert (second.reason, second.detail) == (StopReason.OPERATOR_DAMP, "SIGINT")


def test_a_stop_says_who_sent_its_signal_where_that_is_not_the_operator() -> None:
    with StopSignals(" of the service") as signals:
        os.kill(os.getpid(), signal.SIGTERM)
        asked = signals.take()
    assert asked is not None
    assert asked.detail == "SIGTERM of the service"


def test_a_signal_interrupts_a_call_that_waits_and_the_old_handlers_come_back() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with StopSignals() as signals:
        signals.interrupts = True
        with pytest.raises(OperatorInterrupt) as caught:
            os.kill(os.getpid(), signal.SIGTERM)
    assert caught.value.stop.reason is StopReason.OPERATOR_STOP
    assert signal.getsignal(signal.SIGTERM) is before


# Real time -----------------------------------------------------------------------------------------------------------


def test_what_is_refused_is_said_once_with_what_to_grant(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    before = sys.getswitchinterval()
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(os, "sched_setaffinity", refuse)
    try:
        refusals = realtime.apply_real_time(RealTimeConfig(fifo_priority=40, cpu_affinity=(1,), lock_memory=False))
    finally:
        sys.setswitchinterval(before)
    assert len(refusals) == 2
    assert "SCHED_FIFO 40 was refused" in refusals[0]
    assert "LimitRTPRIO=40" in refusals[0]
    assert "CPUs [1] were refused" in refusals[1]


def test_threads_that_there_are_get_the_priority_too(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[int, tuple[int, int]] = {}

    def grant(thread: int, policy: int, parameters: os.sched_param) -> None:
        asked[thread] = (policy, parameters.sched_priority)
        if thread != threading.get_native_id():
            raise ProcessLookupError(3, "No such process")  # as for one that has just ended

    is_over = threading.Event()
    other = threading.Thread(target=is_over.wait)
    other.start()
    before = sys.getswitchinterval()
    monkeypatch.setattr(os, "sched_setscheduler", grant)
    try:
        assert realtime.apply_real_time(RealTimeConfig(fifo_priority=40, lock_memory=False)) == []
    finally:
        sys.setswitchinterval(before)
        is_over.set()
        other.join()
    assert asked[threading.get_native_id()] == asked[other.native_id or 0] == (os.SCHED_FIFO, 40)


def test_nothing_is_asked_for_where_nothing_is_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[object] = []
    monkeypatch.setattr(os, "sched_setscheduler", lambda *words: asked.append(words))
    before = sys.getswitchinterval()
    try:
        assert realtime.apply_real_time(RealTimeConfig(fifo_priority=0, lock_memory=False)) == []
    finally:
        sys.setswitchinterval(before)
    assert asked == []


def test_garbage_collection_is_frozen_only_where_asked() -> None:
    realtime.freeze_garbage_collection(RealTimeConfig(freeze_garbage_collection=False))
    assert gc.isenabled()
    try:
        realtime.freeze_garbage_collection(RealTimeConfig())
        assert not gc.isenabled()
        assert gc.get_freeze_count() > 0
    finally:
        gc.enable()
        gc.unfreeze()


def test_lock_step_asks_for_no_real_time_and_changes_nothing_else() -> None:
    config = for_lock_step(RunConfig())
    assert config.real_time.fifo_priority == 0
    assert not config.real_time.lock_memory
    assert not config.control.warm_up
    untouched = {"control": RunConfig().control, "real_time": RunConfig().real_time}
    assert config.model_copy(update=untouched) == RunConfig()


# Console and summary -------------------------------------------------------------------------------------------------


def test_the_console_prints_lines_in_order_and_progress_between_them() -> None:
    stream = io.StringIO()
    console = Console(stream, period_s=0.001)
    shown = threading.Event()

    def progress() -> str:
        shown.set()
        return "going on"

    console.say("a line")
    console.say("another")
    console.show(progress)
    assert shown.wait(30.0)
    console.close()
    lines = stream.getvalue().splitlines()
    assert [line for line in lines if line != "going on"] == ["a line", "another"]
    assert "going on" in lines


def test_a_terminal_that_is_gone_ends_nothing() -> None:
    stream = io.StringIO()
    stream.close()
    console = Console(stream)
    console.say("nobody reads this")
    console.close()


def summary(**changes: Any) -> RunSummary:
    stats = LoopStats()
    fields: dict[str, Any] = {
        "outcome": "completed",
        "exit_code": 0,
        "sentence": "done",
        "log_path": "run.mcap",
        "log_dropped": 0,
        "rss_mb": 100.0,
        "rss_growth_mb": 0.0,
        **figures(stats),
        **changes,
    }
    return RunSummary(**fields)


def test_figures_that_were_not_measured_are_null_and_take_no_line() -> None:
    assert json.loads(summary().to_json())["tick_compute_p50_us"] is None
    assert summary_text(summary()).splitlines() == [
        "outcome            completed: done",
        "log                run.mcap (0 messages lost)",
    ]


def test_the_summary_shows_what_was_measured() -> None:
    stats = LoopStats()
    for i in range(101):
        stats.ticked(i * 20 * MS, 200e-6, 1e-4, 2e-3, 0)
        stats.sent(i, i * 20 * MS)
        stats.departures([(i, i * 20 * MS + 400_000)])
    text = summary_text(summary(**figures(stats)))
    assert "policy ticks       101 at 50.000 Hz of robot time, 0 skipped" in text
    assert "tick compute       p50 200 µs, p99 200 µs" in text
    assert "state to command   p50 0.40 ms, p99 0.40 ms" in text
    assert "state age, robot   p50 2.00 ms" in text


def test_commands_that_never_leave_do_not_pile_up() -> None:
    stats = LoopStats()
    for key in range(1000):
        stats.sent(key, 0)
    assert len(stats._pending) <= PENDING_MAX
    assert np.isnan(stats.state_to_command_s.percentile(50))


def test_a_ring_of_samples_keeps_the_newest() -> None:
    samples = RecentValues(10)
    for i in range(25):
        samples.add(i)
    assert samples.count == 25
    assert (samples.percentile(0), samples.percentile(100)) == (15.0, 24.0)


def test_resident_memory_is_a_plausible_figure() -> None:
    assert 10.0 < resident_mb() < 10_000.0


def test_the_logs_name_sorts_by_time_and_holds_no_strange_character() -> None:
    name = log_file_name("walk v2/x", "forward", 3, datetime(2026, 1, 2, 3, 4, 5, tzinfo=timezone.utc))
    assert name == "20260102-030405-walk_v2_x-forward-r3.mcap"


# One instance --------------------------------------------------------------------------------------------------------


def test_a_second_holder_is_refused_and_a_later_one_is_not(tmp_path: Path) -> None:
    with InstanceLock("robot-a", tmp_path):
        with pytest.raises(AlreadyRunningError, match=f"process {os.getpid()} already drives robot-a"):
            InstanceLock("robot-a", tmp_path).__enter__()
        with InstanceLock("robot-b", tmp_path):
            pass
    with InstanceLock("robot-a", tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_lock_that_its_holder_removes_meanwhile_is_made_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, lock = tmp_path / "lock", fcntl.flock
    taken: list[int] = []

    def overtaken(descriptor: int, how: int) -> None:
        if not taken:
            path.unlink()
        taken.append(descriptor)
        lock(descriptor, how)

    monkeypatch.setattr(fcntl, "flock", overtaken)
    descriptor = open_locked(path)
    assert len(taken) == 2
    with pytest.raises(BlockingIOError):
        open_locked(path)
    os.close(descriptor)


def test_the_lock_of_a_dead_process_is_free(tmp_path: Path) -> None:
    code = (
        "import os, sys; from pathlib import Path; from spot_runtime.host.instance_lock import InstanceLock\n"
        f"InstanceLock('robot', Path({str(tmp_path)!r})).__enter__(); os.kill(os.getpid(), 9)"
    )
    assert subprocess.run([sys.executable, "-c", code]).returncode == -signal.SIGKILL
    with InstanceLock("robot", tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


# The command line and the documentation ------------------------------------------------------------------------------


def source(policy: Policy, **changes: Any) -> Any:
    words: dict[str, Any] = {"sequence": None, "is_keyboard": False, "is_gamepad": False, "duration_s": None, **changes}
    console = Console(io.StringIO())
    try:
        return make_source(RunConfig(), policy, console, **words)
    finally:
        console.close()


def test_one_source_of_commands_at_a_time(zero_policy: Policy) -> None:
    assert source(zero_policy).name == "standing"
    assert source(zero_policy, sequence="six_directions").name == "six_directions"
    with pytest.raises(BadInputError, match="exclude each other"):
        source(zero_policy, sequence="forward", is_keyboard=True)
    with pytest.raises(BadInputError, match="--duration is -1"):
        source(zero_policy, duration_s=-1.0)


def test_a_sequence_is_cut_to_the_policys_range(zero_policy: Policy) -> None:
    forward = source(zero_policy, sequence="forward")
    assert forward.sample(12.0, 0).command.tolist() == [1.5, 0.0, 0.0]


def test_a_keyboard_needs_a_terminal(zero_policy: Policy, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    with pytest.raises(BadInputError, match="needs a terminal"):
        source(zero_policy, is_keyboard=True)


def test_a_gamepad_needs_pygame(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(BadInputError, match=re.escape("pip install 'spot-rl[gamepad]'")):
        PygamePad(0)


def test_a_system_without_gamepads_is_told_of_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    class PygameError(RuntimeError): ...

    def init() -> None:
        raise PygameError("x11 not available")

    ended: list[bool] = []
    parts = SimpleNamespace(init=init)
    pygame = SimpleNamespace(error=PygameError, display=parts, joystick=parts, quit=lambda: ended.append(True))
    monkeypatch.setitem(sys.modules, "pygame", pygame)
    with pytest.raises(BadInputError, match="x11 not available; without a screen set SDL_VIDEODRIVER=dummy"):
        PygamePad(0)
    assert ended == [True]


def test_a_log_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(LogError, match=r"folder .*file/logs for logs cannot be made: Not a directory; name another"):
        make_log_folder(tmp_path / "file" / "logs")


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["--robot", "h:x", "--policy", "walk"], 2, "robot address 'h:x' is not valid"),
        (["--robot", "h", "--policy", "none.onnx"], 3, "policy 'none.onnx' does not exist"),
        (["--robot", "h", "--policy", "{cut}"], 3, "no readable ONNX model"),
        (["--robot", "h", "--policy", "walk", "--config", "none.yaml"], 2, "configuration none.yaml cannot be read"),
    ],
)
def test_bad_words_on_the_command_line(
    tmp_path: Path,
    make_policy_bytes: Any,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    words: list[str],
    code: int,
    said: str,
) -> None:
    cut = tmp_path / "cut.onnx"
    cut.write_bytes(make_policy_bytes()[:400])
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["spot-rl", "run", *(word.format(cut=cut) for word in words)])
    with pytest.raises(SystemExit) as left:
        main()
    told = capfd.readouterr().err
    assert left.value.code == code, told
    assert said in told
    assert len(told.strip().splitlines()) == 1
