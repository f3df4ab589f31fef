"""Rows of the log: its process killed, its disk full, slow or gone. Control goes on, or stops where it is told to."""

from __future__ import annotations

import os
import resource
import shutil
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from proof.faults.attempts import Check, row, time_damping
from proof.faults.rows import NS_PER_MS, Finding, Row
from proof.faulty import FaultyHal, raise_as_fault
from proof.rig import Drive, Rig
from spot_log import LogError
from spot_log.write.run_writer import active_path

STOP_WITH_IT: Final = {"stop_on_failure": True}


def kill(rig: Rig, _: FaultyHal | None) -> None:
    """End the log's process, with no chance to say a word."""
    os.kill(rig.loggers[-1].process_id, signal.SIGKILL)


def hold(rig: Rig, hal: FaultyHal) -> None:
    """Let the log's process stand still for 1.5 s, as on a disk that does not answer."""
    process_id = rig.loggers[-1].process_id
    os.kill(process_id, signal.SIGSTOP)
    hal.plan(1.5, lambda: os.kill(process_id, signal.SIGCONT))


def fill_disk(rig: Rig, _: FaultyHal) -> None:
    """Let the file grow no more from now on."""
    logger = rig.loggers[-1]
    size = active_path(logger.path).stat().st_size
    resource.prlimit(logger.process_id, resource.RLIMIT_FSIZE, (size, size))


def says(_: Rig, drive: Drive, finding: Finding) -> None:
    """Check that the run says what is wrong with its log, and that its summary or its log counts what was lost."""
    summary = drive.summary
    finding.demand(bool(summary.log_problem), "the run does not say what is wrong with its log")
    finding.demand(summary.log_dropped + summary.log_unwritten > 0, "nothing counts what was lost")


def counts_states(_: Rig, drive: Drive, finding: Finding) -> None:
    """Check that the log was closed, and that as many states are missing as were counted."""
    finding.demand(drive.log.footer is not None, "the log was not closed")
    lost = int((np.diff(drive.log.states.sequence) - 1).sum())
    finding.reaction = f"completed, {lost} states lost"
    dropped = drive.log.footer.dropped.get("state", 0) if drive.log.footer is not None else 0
    finding.demand(dropped == lost, f"{lost} states are missing, {dropped} were counted")


def next_log_opens(rig: Rig, _: Drive, finding: Finding) -> None:
    """Check that the next run's log is whole, where there is room again."""
    drive = rig.drive(seconds=0.5)
    finding.demand(drive.summary.outcome == "completed", f"the next run ended {drive.summary.sentence}")
    finding.demand(drive.opened[0] is not None, "the next log does not open")


def kill_then_quit(rig: Rig, hal: FaultyHal) -> None:
    """End the log's process, and press the operator's e-stop soon after."""
    kill(rig, hal)
    hal.plan(0.2, lambda: raise_as_fault(signal.SIGQUIT))


def incident_shows_damping(_: Rig, drive: Drive, finding: Finding) -> None:
    """Time the damping from the incident file: the log is not in the e-stop's way."""
    incident = drive.incident
    finding.demand(incident is not None, "there is no incident file")
    if incident is not None:
        finding.reaction += " → damping"
        time_damping(incident, drive.happened_ns + 200 * NS_PER_MS, finding)


def loses_log(name: str, lose: Callable[[Path], object], outcome: str, is_well: Callable[[Rig, Path], str]) -> Row:
    """Make a row in which somebody does something to the log's file: the run goes on, and its end says what is left."""

    def attempt(rig: Rig) -> Finding:
        path = rig.new_log_path().with_suffix("") / "run.mcap"
        path.parent.mkdir()
        summary = (drive := rig.drive(lambda _: lose(path), log_path=path)).summary
        finding = Finding(summary.outcome, truth=drive.hal.truth)
        finding.demand(summary.outcome == outcome, f"ended {summary.sentence}")
        finding.demand(not summary.skipped_ticks, f"{summary.skipped_ticks} ticks were missed")
        problem = is_well(rig, path)
        finding.demand(not problem, problem)
        return finding

    return Row(name, 0.0, attempt)


def says_gone(rig: Rig, _: Path) -> str:
    """Return what is wrong unless the log's end says that no log is left."""
    problem = rig.loggers[-1].health().problem
    return "" if "the log c" in problem else f"nobody says that the log is gone: {problem!r}"


def kept_both(_: Rig, path: Path) -> str:
    """Return what is wrong unless neither the file nor the log was overwritten."""
    is_kept = path.read_text(encoding="utf-8") == "precious" and active_path(path).exists()
    return "" if is_kept else "a file was overwritten"


def no_log(name: str, make: Callable[[Path], Path]) -> Row:
    """Make a row of a log that cannot be begun: the run is refused before anything is sent to the robot."""

    def attempt(rig: Rig) -> Finding:
        path = make(rig.new_log_path())
        calls, finding = rig.status().commands_received, Finding("refused to begin")
        try:
            rig.drive(log_path=path, seconds=0.5)
        except (LogError, OSError) as error:
            finding.demand(path.name in str(error) or str(path.parent) in str(error), f"it does not say which: {error}")
        else:
            finding.problems.append("it ran without a log")
        finding.demand(rig.status().commands_received == calls, "the robot was commanded")
        return finding

    return Row(f"no log: {name}", 0.0, attempt)


def _in_a_file(path: Path) -> Path:
    path.write_text("precious", encoding="utf-8")
    return path / "run.mcap"


def _a_pipe(path: Path) -> Path:
    os.mkfifo(path)
    return path


SAYS: Final[tuple[Check, ...]] = (says,)
ON: Final[dict[str, Any]] = {"missed": 0, "is_real_time": True, "seconds": 3.0}
OFF: Final[dict[str, Any]] = {"is_real_time": True, "seconds": 60.0, "log": STOP_WITH_IT}

ROWS = (
    row("logger killed", 0.0, kill, "completed", checks=SAYS, **ON),
    row("logger killed, told to stop then", 0.0, kill, "log_failed", checks=SAYS, **OFF),
    row("disk full", 0.0, fill_disk, "completed", checks=SAYS, **ON),
    row("disk full, told to stop then", 0.0, fill_disk, "log_failed", checks=SAYS, **OFF),
    row("disk slow", 0.0, hold, "completed", checks=(counts_states,), **ON),
    loses_log("log folder removed", lambda path: shutil.rmtree(path.parent), "log_failed", says_gone),
    loses_log("log name taken", lambda path: path.write_text("precious", encoding="utf-8"), "completed", kept_both),
    no_log("its folder is a file", _in_a_file),
    no_log("its name is a pipe", _a_pipe),
    no_log("a file system without room", lambda _: Path("/proc/spot-rl.mcap")),
    row("disk full, then another run", 0.0, fill_disk, "completed", missed=0, checks=(next_log_opens,)),
    row("e-stop while the logger is dead", 40.0, kill_then_quit, "operator_estop", checks=(incident_shows_damping,)),
)
