"""What a diagnosis says about the log: its cause, and the stretches of time that carry the gap."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from compare.tracks import STEP_S, CompareError, Track
from diagnosis.document import Verdict, load_verdict
from diagnosis.report.words import joints_in_short
from spot_log.read.run import Run


@dataclass(frozen=True)
class Cause:
    """A stretch of the compared time in which a diagnosis sees the cause at work."""

    start_s: float
    end_s: float
    text: str


def read_verdict(path: Path) -> Verdict:
    """Read a ``verdict.json``, or the one in a folder that ``spot-rl diagnose`` wrote.

    Raises:
        CompareError: There is none, or it does not follow its schema.
    """
    file = path / "verdict.json" if path.is_dir() else path
    try:
        return load_verdict(file)
    except OSError as error:
        raise CompareError(
            f"verdict {file} cannot be read: {error.strerror}; give a folder of 'spot-rl diagnose'"
        ) from error
    except ValidationError as error:
        raise CompareError(f"{file} is no verdict of 'spot-rl diagnose'") from error


def check_verdict(verdict: Verdict, path: Path, run: Run) -> None:
    """Refuse a diagnosis of other logs.

    Raises:
        CompareError: The run is none of the logs that were diagnosed, by run and by file name.
    """
    is_timed = any(stretch.log == run.header.run_id for stretch in verdict.timeline)
    if not is_timed and run.path.name not in {Path(log).name for log in verdict.logs}:
        more = f" and {len(verdict.logs) - 1} more" if len(verdict.logs) > 1 else ""
        known = f"{Path(verdict.logs[0]).name}{more}" if verdict.logs else "none that it names"
        raise CompareError(f"the diagnosis {path} is of other logs ({known}) than {run.path}; give one of this log")


def cause_in_words(verdict: Verdict) -> str:
    """The cause in one phrase; empty where the diagnosis names none."""
    if verdict.status == "unknown_effect":
        joints = joints_in_short(verdict.unknown.joints) if verdict.unknown else ""
        return f"an effect outside the library{f' at {joints}' if joints else ''}"
    if verdict.status not in ("explained", "partly_explained"):
        return ""
    return " and ".join(f"{e.title or e.name} at {joints_in_short(e.joints)}" for e in verdict.differences)


def causes(verdict: Verdict, run: Run, track: Track) -> list[Cause]:
    """Stretches of the log that carry the gap, on the time of the aligned track."""
    words = cause_in_words(verdict) or "gap"
    end_s = len(track) * STEP_S
    # The diagnosis counts time from the log's first state.
    begin_s = (track.start_ns - int(run.states.robot_stamp_ns[0])) * 1e-9
    found = []
    for stretch in verdict.timeline:
        if stretch.log == run.header.run_id and stretch.kind == "gap":
            start, end = max(0.0, stretch.start_s - begin_s), min(end_s, stretch.end_s - begin_s)
            if end > start:
                found.append(Cause(start, end, f"{words}: {stretch.reason}"))
    return found
