"""One run against the fake robot, and what is known of it afterwards."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from spot_log import LogReadError, Run, read_run
from spot_log.write.flight_recorder import flight_record_path
from spot_log.write.run_writer import active_path
from spot_runtime.session.summary import RunSummary


@dataclass
class Drive:
    """What one run was, and what is known of it."""

    summary: RunSummary
    log: Run | None
    log_path: Path
    happened_ns: int
    """Robot clock when it happened; 0 if it never did."""
    released_power_ns: int
    """Robot clock when sitting down and powering off was asked for; 0 if it never was."""
    log_error: str = ""
    truth: Any = None
    """The body's extremes from the start of joint control to its end; None where it never began."""
    was_off: bool = False
    """Whether the motors had no power any more when sitting down was asked for."""

    @property
    def incident(self) -> Run | None:
        """The incident file; None where there is none."""
        path = flight_record_path(self.log_path)
        return read_run(path) if path.exists() else None

    def event_ns(self, text: str) -> int | None:
        """Robot stamp of the first event after it happened whose name or text ends like this."""
        for event in () if self.log is None else self.log.events:
            is_it = event.name == text or event.text.endswith(f"→ {text}")
            if is_it and event.robot_stamp_ns >= self.happened_ns:
                return event.robot_stamp_ns
        return None


def read_log(path: Path) -> tuple[Run | None, str]:
    """The log, whole or as a crash left it, and why it does not open."""
    for candidate in (path, active_path(path)):
        if candidate.exists():
            try:
                return read_run(candidate), ""
            except (LogReadError, OSError) as error:
                return None, str(error)
    return None, f"there is no {path}"
