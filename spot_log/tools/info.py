"""The summary of a log as one object, for ``spot-rl log info --json`` and for the words made of it."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

from spot_log.tools.gaits import GaitSpan
from spot_log.tools.measures import Fall, Spread, Steps


@dataclass(frozen=True)
class Histogram:
    """Counts between edges."""

    edges_ms: list[float]
    counts: list[int]


@dataclass(frozen=True)
class TickInfo:
    """The policy's ticks."""

    count: int
    rate_hz: float
    """Mean by robot time, from the first to the last tick that ran the policy."""
    skipped: int
    state_age_ms: Spread
    inference_us: Spread
    compute_us: Spread
    modes_s: dict[str, float]
    """Time in each mode, robot time."""


@dataclass(frozen=True)
class CommandInfo:
    """The commands sent."""

    count: int
    rate_hz: float
    clamped: int
    """Commands whose set-points were changed by the limits."""
    echoed: int
    """Commands that a state has named as the newest received."""
    delay_ms: Spread
    """Sent to received, robot clock."""
    delay_histogram: Histogram
    acknowledge_lag_ms: Spread
    """Sent to first echo received, host clock."""
    state_to_command_ms: Spread
    """State received to command sent, host clock."""


@dataclass(frozen=True)
class PowerInfo:
    """Battery and temperatures."""

    polls: int
    charge_start_percent: float
    charge_end_percent: float
    voltage_min_v: float
    current_peak_a: float
    energy_j: float
    motor_temperature_max_c: float
    motor_temperature_joint: str
    faults: list[str]


@dataclass(frozen=True)
class MotionInfo:
    """What the body did."""

    distance_m: float
    mean_speed_m_s: float
    tracking_rms: list[float]
    """Of V_x, V_y (m/s) and ω_z (rad/s), over the ticks."""
    tilt_max_rad: float
    load_peak_nm: dict[str, float]
    falls: list[Fall] | None
    """None where the log has neither orientation nor contacts."""


@dataclass(frozen=True)
class LogInfo:
    """Everything that ``log info`` tells."""

    file: str
    size_bytes: int
    header: dict[str, Any]
    labels: dict[str, str]
    """The header's, and those that were given while it was written."""
    outcome: str
    duration_s: float
    damage: list[str]
    dropped: dict[str, int]
    states: Steps
    state_count: int
    receive_ms: Spread
    """Steps between receipts, host clock."""
    ticks: TickInfo
    commands: CommandInfo
    power: PowerInfo
    motion: MotionInfo
    gaits: list[GaitSpan]
    """One for each stretch in which the command stayed the same, or changed steadily."""
    events: list[dict[str, Any]]
    event_counts: dict[str, int]

    def to_json(self) -> dict[str, Any]:
        """As plain JSON values; NaN becomes null."""
        result = _plain(dataclasses.asdict(self))
        assert isinstance(result, dict)  # noqa: S101
        return result


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
