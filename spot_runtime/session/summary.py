"""How a run ended, for programs."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path

from spot_runtime.control.loop_stats import LoopStats


@dataclass(frozen=True)
class RunSummary:
    """The end of a run."""

    outcome: str
    """``completed``, or the reason of the stop."""
    exit_code: int
    sentence: str
    log_path: str
    """Where the log is; empty where no name leads to it."""
    ticks: int
    rate_hz: float
    skipped_ticks: int
    tick_compute_p50_us: float
    tick_compute_p99_us: float
    state_to_command_p50_ms: float
    state_to_command_p99_ms: float
    state_age_p50_ms: float
    state_age_p99_ms: float
    """Receipt of a state to the tick that uses it."""
    acquisition_age_p50_ms: float
    acquisition_age_p99_ms: float
    """Sampling of the joints to the tick, by the estimated robot clock."""
    log_dropped: int
    rss_mb: float
    rss_growth_mb: float
    """Resident memory at the end less that at the start of control."""
    control_robot_s: float = 0.0
    """Robot time from the start of control to its end."""
    control_wall_s: float = 0.0
    """The same in host time; shorter in lock-step."""
    log_unwritten: int = 0
    """Records that reached the log's process but not the disk."""
    log_problem: str = ""
    """What went wrong with the log; empty where nothing did."""
    states_missed: int = 0
    """States that never came."""
    real_time_refusals: tuple[str, ...] = ()

    def to_json(self) -> str:
        """One JSON object; figures that were not measured are null."""
        values = {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in asdict(self).items()}
        return json.dumps(values)


def figures(stats: LoopStats) -> dict[str, float | int]:
    """The loop's own figures, by the summary's names."""
    return {
        "ticks": stats.ticks,
        "rate_hz": stats.rate_hz,
        "skipped_ticks": stats.skipped_ticks,
        "tick_compute_p50_us": stats.compute_s.percentile(50) * 1e6,
        "tick_compute_p99_us": stats.compute_s.percentile(99) * 1e6,
        "state_to_command_p50_ms": stats.state_to_command_s.percentile(50) * 1e3,
        "state_to_command_p99_ms": stats.state_to_command_s.percentile(99) * 1e3,
        "state_age_p50_ms": stats.state_age_s.percentile(50) * 1e3,
        "state_age_p99_ms": stats.state_age_s.percentile(99) * 1e3,
        "acquisition_age_p50_ms": stats.acquisition_age_s.percentile(50) * 1e3,
        "acquisition_age_p99_ms": stats.acquisition_age_s.percentile(99) * 1e3,
    }


def resident_mb() -> float:
    """Resident memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * 4096 / 1e6
