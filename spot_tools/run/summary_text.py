"""How a run ended, for a person."""

from __future__ import annotations

from spot_runtime.session.summary import RunSummary


def summary_text(end: RunSummary) -> str:
    """The end of a run, in a few lines for a person."""
    lines = [f"outcome            {end.outcome}: {end.sentence}"]
    if end.ticks:
        lines += [
            f"control            {end.control_robot_s:.1f} s of robot time in {end.control_wall_s:.1f} s",
            f"policy ticks       {end.ticks} at {end.rate_hz:.3f} Hz of robot time, {end.skipped_ticks} skipped",
            _pair("tick compute", end.tick_compute_p50_us, end.tick_compute_p99_us, "µs"),
            _pair("state to command", end.state_to_command_p50_ms, end.state_to_command_p99_ms, "ms"),
            _pair("state age, receipt", end.state_age_p50_ms, end.state_age_p99_ms, "ms"),
            _pair("state age, robot", end.acquisition_age_p50_ms, end.acquisition_age_p99_ms, "ms"),
        ]
    lost = end.log_dropped + end.log_unwritten
    lines.append(f"log                {end.log_path or 'none is left'} ({lost} messages lost)")
    if end.log_problem:
        lines.append(f"log's problem      {end.log_problem}")
    return "\n".join(lines)


def _pair(name: str, p50: float, p99: float, unit: str) -> str:
    digits = 0 if unit == "µs" else 2
    return f"{name:<18} p50 {p50:.{digits}f} {unit}, p99 {p99:.{digits}f} {unit}"
