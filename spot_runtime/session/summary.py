"""How a run ended: the first thing that went wrong stays the outcome, unless the robot fell; and its figures."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from spot_runtime.control.loop_stats import LoopStats
from spot_runtime.hal.errors import HalError
from spot_runtime.stops import Stop, StopReason


@dataclass(frozen=True)
class Outcome:
    """What the summary, the log and the exit code say about the end."""

    label: str = ""
    """Name of the reason; empty while the run goes on."""
    exit_code: int = 0
    sentence: str = ""
    is_fault: bool = False
    """Whether something went wrong; neither what the operator asked for nor the end of a sequence is a fault."""

    def after_stop(self, stop: Stop) -> Outcome:
        """The outcome after this stop."""
        reason = stop.reason
        return self._after(Outcome(reason.label, reason.exit_code, stop.sentence(), is_fault=reason.is_fault))

    def after_fall(self, lean_rad: float) -> Outcome:
        """The outcome once the robot is seen to lie on its side or back."""
        words = f"the robot fell and lies at {math.degrees(lean_rad):.0f}°; see to it"
        tilt = StopReason.TILT
        return Outcome(
            tilt.label, tilt.exit_code, f"{self.sentence}; then {words}" if self.sentence else words, is_fault=True
        )

    def after_error(self, error: HalError) -> Outcome:
        """The outcome once the robot could not be used."""
        return self._after(Outcome(error.label, error.exit_code, str(error), is_fault=True))

    def after_power_failure(self, error: HalError) -> Outcome:
        """The outcome after powering off failed, which its sentence always names."""
        words = f"powering off failed: {error}; see to the robot"
        if self.is_fault or self.exit_code == StopReason.OPERATOR_ESTOP.exit_code:
            return replace(self, sentence=f"{self.sentence}; then {words}")
        return Outcome("power_off_failed", error.exit_code, f"{self.sentence}; then {words}", is_fault=True)

    def after_loss_of_log(self, problem: str) -> Outcome:
        """The outcome of a run that has left no log; what went wrong before stays, and so does an e-stop."""
        lost = Stop(StopReason.LOG_FAILED, problem)
        words = f"{self.sentence}; then {lost.sentence()}"
        if self.is_fault or self.exit_code == StopReason.OPERATOR_ESTOP.exit_code:
            return replace(self, sentence=words)
        return Outcome(lost.reason.label, lost.reason.exit_code, words, is_fault=True)

    def _after(self, later: Outcome) -> Outcome:
        is_fall = self.sentence and later.label == StopReason.TILT.label
        if not self.is_fault and not is_fall:
            return later
        return replace(later if is_fall else self, sentence=f"{self.sentence}; then {later.sentence}")


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
    """Host time from the start of control to its end; shorter in lock-step."""
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
