"""Rows of the log: its process killed, its disk full, slow or gone. Control goes on, or stops where it is told to."""

from __future__ import annotations

import os
import resource
import shutil
import signal
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from proof.bench_signals import raise_as_fault
from proof.faults.drive import Drive, read_log
from proof.faults.faulty_hal import FaultyHal
from proof.faults.rig import Rig
from proof.faults.rows import NS_PER_MS, Finding, Row, judge, tried_with, went_on
from proof.faults.rows_robot import first_damping_ns
from spot_log import LogError
from spot_log.format.records import RunHeader
from spot_log.write.logger_process import LoggerProcess
from spot_log.write.run_writer import active_path
from spot_log.write.sink import LogSink

SECONDS = 3.0


@dataclass
class Logger:
    """Starts the log's process, and does things to it."""

    started: list[LoggerProcess] = field(default_factory=list)

    def start(self, path: Path, header: RunHeader) -> LogSink:
        """As a run starts it."""
        sink = LoggerProcess.start(path, header)
        self.started.append(sink)
        return sink

    @property
    def process_id(self) -> int:
        """The number of the log's process."""
        return self.started[-1].process_id

    @property
    def path(self) -> Path:
        """The log's name."""
        return self.started[-1].path

    def kill(self) -> None:
        """End it, with no chance to say a word."""
        os.kill(self.process_id, signal.SIGKILL)

    def hold(self) -> None:
        """Let it stand still, as on a disk that does not answer."""
        os.kill(self.process_id, signal.SIGSTOP)

    def go_on(self) -> None:
        """Let it go on."""
        os.kill(self.process_id, signal.SIGCONT)

    def fill_disk(self) -> None:
        """From now on the file cannot grow."""
        size = active_path(self.path).stat().st_size
        resource.prlimit(self.process_id, resource.RLIMIT_FSIZE, (size, size))

    def remove_folder(self) -> None:
        """Somebody deletes the folder of the logs."""
        shutil.rmtree(self.path.parent)


def says(drive: Drive, finding: Finding) -> Finding:
    """The run's own summary or the log counts what was lost, and the run says so."""
    counted = drive.summary.log_dropped + drive.summary.log_unwritten
    finding.demand(bool(drive.summary.log_problem), "the run does not say what is wrong with its log")
    finding.demand(counted > 0, "nothing counts what was lost")
    return finding


@tried_with
def lost(rig: Rig, lose: Callable[[Logger], None]) -> Finding:
    """The log is lost, and the run goes on without it."""
    logger = Logger()
    drive = rig.drive(lambda _: lose(logger), make_sink=logger.start, seconds=SECONDS)
    return says(drive, went_on(drive, judge(drive, "completed")))


@tried_with
def lost_and_told_to_stop(rig: Rig, lose: Callable[[Logger], None]) -> Finding:
    """The log is lost, and the run is to end with it."""
    logger, config = Logger(), {"stop_on_failure": True}
    drive = rig.drive(lambda _: lose(logger), make_sink=logger.start, seconds=60.0, log=config)
    return says(drive, judge(drive, "log_failed"))


def slow(rig: Rig) -> Finding:
    """The disk does not answer for a while."""
    logger = Logger()

    def act(hal: FaultyHal) -> None:
        logger.hold()
        hal.later(1.5, logger.go_on)

    drive = rig.drive(act, make_sink=logger.start, seconds=SECONDS)
    finding = went_on(drive, judge(drive, "completed"))
    if drive.log is None or drive.log.footer is None:
        finding.problems.append("the log was not closed")
        return finding
    lost = int((np.diff(drive.log.states.sequence) - 1).sum())
    finding.reaction = f"completed, {lost} states lost"
    dropped = drive.log.footer.dropped.get("state", 0)
    finding.demand(dropped == lost, f"{lost} states are missing, {dropped} were counted")
    return finding


def removed(rig: Rig) -> Finding:
    """The folder is deleted: the run goes on to its end, which says that no log is left."""
    logger = Logger()

    def make_sink(path: Path, header: RunHeader) -> LogSink:
        folder = path.parent / "to-be-removed"
        folder.mkdir(exist_ok=True)
        return logger.start(folder / path.name, header)

    drive = rig.drive(lambda _: logger.remove_folder(), make_sink=make_sink, seconds=2.0)
    finding = Finding(drive.summary.outcome, truth=drive.truth)
    finding.demand(drive.summary.outcome == "log_failed", f"ended {drive.summary.sentence}")
    problem = logger.started[-1].health().problem
    finding.demand("the log c" in problem, f"nobody says that the log is gone: {problem!r}")
    return went_on(drive, finding)


def taken_name(rig: Rig) -> Finding:
    """While it runs, another file takes the log's final name: neither is overwritten."""
    logger = Logger()

    def take_name() -> None:
        logger.path.write_text("precious", encoding="utf-8")

    drive = rig.drive(lambda _: take_name(), make_sink=logger.start, seconds=2.0)
    finding = Finding(drive.summary.outcome, truth=drive.truth)
    finding.demand(drive.summary.outcome == "completed", f"ended {drive.summary.sentence}")
    finding.demand(logger.path.read_text(encoding="utf-8") == "precious", "the file was overwritten")
    finding.log_ok = active_path(logger.path).exists()
    return went_on(drive, finding)


def _row(fault: str, attempt: Callable[[Rig], Finding], *, real: bool = True) -> Row:
    return Row(fault, 0.0, attempt, is_real_time=real)


@tried_with
def no_log(rig: Rig, name: Callable[[Rig], Path]) -> Finding:
    """A log that cannot be begun: refused before anything is sent to the robot."""
    path = name(rig)
    calls, finding = rig.status().commands_received, Finding("refused to begin")

    def make_sink(_: Path, header: RunHeader) -> LogSink:
        return LoggerProcess.start(path, header)

    try:
        rig.drive(make_sink=make_sink, seconds=0.5)
    except (LogError, OSError) as error:
        finding.demand(path.name in str(error) or str(path.parent) in str(error), f"it does not say which: {error}")
    else:
        finding.problems.append("it ran without a log")
    finding.demand(rig.status().commands_received == calls, "the robot was commanded")
    return finding


def _in_a_file(rig: Rig) -> Path:
    taken = rig.folder / "a-file"
    taken.write_text("precious", encoding="utf-8")
    return taken / "run.mcap"


def _a_pipe(rig: Rig) -> Path:
    path = rig.folder / "pipe.mcap"
    if not path.exists():
        os.mkfifo(path)
    return path


def full_when_restarted(rig: Rig) -> Finding:
    """The disk fills up, and the next run's log is whole where there is room again."""
    logger = Logger()
    first = rig.drive(lambda _: logger.fill_disk(), make_sink=logger.start, seconds=2.0)
    finding = went_on(first, judge(first, "completed"))
    second = rig.drive(seconds=0.5)
    finding.demand(second.summary.outcome == "completed", f"the next run ended {second.summary.sentence}")
    finding.demand(read_log(second.log_path)[0] is not None, "the next log does not open")
    return finding


def estop_without_logger(rig: Rig) -> Finding:
    """The operator's e-stop after the log's process has died: the log is not in its way."""
    logger = Logger()

    def act(hal: FaultyHal) -> None:
        logger.kill()
        hal.later(0.2, lambda: raise_as_fault(signal.SIGQUIT))

    drive = rig.drive(act, make_sink=logger.start)
    finding = judge(drive, "operator_estop")
    return _damped_by_incident(drive, finding, since_ns=drive.happened_ns + 200 * NS_PER_MS)


def _damped_by_incident(drive: Drive, finding: Finding, since_ns: int) -> Finding:
    """When damping began, from the incident file: it does not depend on the log."""
    kept = drive.incident
    finding.demand(kept is not None, "there is no incident file")
    if kept is None:
        return finding
    soft_ns = first_damping_ns(replace(drive, log=kept))
    finding.reaction = f"{finding.reaction} → damping"
    finding.reaction_ms = (soft_ns - since_ns) / NS_PER_MS
    finding.demand(finding.reaction_ms >= 0.0, "nothing was damped")
    return finding


ROWS = (
    _row("logger killed", lost(Logger.kill)),
    _row("logger killed, told to stop then", lost_and_told_to_stop(Logger.kill)),
    _row("disk full", lost(Logger.fill_disk)),
    _row("disk full, told to stop then", lost_and_told_to_stop(Logger.fill_disk)),
    _row("disk slow", slow),
    _row("log folder removed", removed, real=False),
    _row("log name taken", taken_name, real=False),
    Row("no log: its folder is a file", 0.0, no_log(_in_a_file)),
    Row("no log: its name is a pipe", 0.0, no_log(_a_pipe)),
    Row("no log: a file system without room", 0.0, no_log(lambda _: Path("/proc/spot-rl.mcap"))),
    Row("disk full, then another run", 0.0, full_when_restarted),
    Row("e-stop while the logger is dead", 40.0, estop_without_logger),
)
