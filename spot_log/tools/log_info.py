"""Compute the summary of a log."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from spot_log.read.run import Run
from spot_log.tools import measures
from spot_log.tools.gaits import GaitSpan, gaits
from spot_log.tools.measures import Fall, Spread, Steps
from spot_model.robot.facts import Array
from spot_model.robot.rotation import tilt_rad


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

    control_s: float
    """Time under the policy's control, or the whole log's where it has no ticks."""
    distance_m: float
    """Path of the body in that time."""
    mean_speed_m_s: float
    tracking_rms: list[float]
    """Root mean square errors of V_x, V_y (m/s) and ω_z (rad/s), over the ticks."""
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
    arm_joints: int
    """Joints of an arm that the states have beside the legs'; 0 for a robot without one."""
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
        """All figures as plain JSON values; NaN becomes null."""
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


def log_info(run: Run) -> LogInfo:
    """Compute every figure of a run."""
    header = dataclasses.asdict(run.header)
    return LogInfo(
        file=str(run.path),
        size_bytes=run.path.stat().st_size,
        header=header,
        labels=run.labels,
        outcome=run.outcome,
        duration_s=run.duration_s,
        damage=list(run.damage),
        dropped=measures.dropped(run),
        states=measures.steps(run.states.robot_stamp_ns),
        state_count=len(run.states),
        arm_joints=run.arm.position_rad.shape[1] if len(run.arm) else 0,
        receive_ms=Spread.of(np.diff(run.states.host_stamp_ns), 1e-6),
        ticks=_ticks(run),
        commands=_commands(run),
        power=_power(run),
        motion=_motion(run),
        gaits=gaits(run),
        events=[_event(run, i) for i in range(len(run.events))],
        event_counts=dict(Counter(event.name for event in run.events)),
    )


def _ticks(run: Run) -> TickInfo:
    ticks = run.ticks
    time_s = measures.seconds(run, ticks.robot_stamp_ns)
    modes: dict[str, float] = {}
    for mode, step_s in zip(ticks.mode[:-1].tolist(), np.diff(time_s).tolist(), strict=True):
        modes[mode] = modes.get(mode, 0.0) + step_s
    policy = np.isfinite(ticks.action).all(axis=1) if len(ticks) else np.zeros(0, dtype=np.bool_)
    return TickInfo(
        count=len(ticks),
        rate_hz=measures.steps(ticks.robot_stamp_ns[policy]).rate_hz,
        skipped=int(ticks.skipped.sum()),
        state_age_ms=Spread.of(ticks.state_age_s, 1e3),
        inference_us=Spread.of(ticks.inference_s[policy], 1e6),
        compute_us=Spread.of(ticks.compute_s[policy], 1e6),
        modes_s=modes,
    )


def _commands(run: Run) -> CommandInfo:
    _, delay_s = measures.command_delay_s(run)
    return CommandInfo(
        count=len(run.commands),
        rate_hz=measures.steps(run.commands.host_stamp_ns).rate_hz,
        clamped=measures.clamped_commands(run),
        echoed=len(delay_s),
        delay_ms=Spread.of(delay_s, 1e3),
        delay_histogram=histogram(delay_s * 1e3),
        acknowledge_lag_ms=Spread.of(measures.acknowledge_lag_s(run), 1e3),
        state_to_command_ms=Spread.of(measures.state_to_command_s(run), 1e3),
    )


def _power(run: Run) -> PowerInfo:
    slow = run.slow_states
    hottest, joint = float("nan"), ""
    if np.isfinite(slow.motor_temperature_c).any():
        per_joint = np.nan_to_num(slow.motor_temperature_c, nan=-np.inf).max(axis=0)
        hottest, joint = float(per_joint.max()), run.header.joint_names[int(per_joint.argmax())]
    faults = {
        f for rows in (slow.system_faults, slow.behavior_faults, slow.service_faults) for row in rows for f in row
    }
    has = len(slow) > 0
    nan = float("nan")
    return PowerInfo(
        polls=len(slow),
        charge_start_percent=float(slow.battery_charge_percent[0]) if has else nan,
        charge_end_percent=float(slow.battery_charge_percent[-1]) if has else nan,
        voltage_min_v=float(slow.battery_voltage_v.min()) if has else nan,
        current_peak_a=float(slow.battery_current_a[np.abs(slow.battery_current_a).argmax()]) if has else nan,
        energy_j=measures.energy_from_battery_j(run),
        motor_temperature_max_c=hottest,
        motor_temperature_joint=joint,
        faults=sorted(faults),
    )


def _motion(run: Run) -> MotionInfo:
    states = run.states
    error = measures.tracking_error(run)
    error = error[np.isfinite(error).all(axis=1)]
    distance, (begin_s, end_s) = measures.distance_m(run), measures.control_span_s(run)
    tilt = tilt_rad(states.odom_from_body_wxyz)
    tilt = tilt[np.isfinite(tilt)]
    names = run.header.joint_names
    peaks = [Spread.of(np.abs(states.load_nm[:, j])).largest for j in range(len(names))]
    return MotionInfo(
        control_s=end_s - begin_s,
        distance_m=distance,
        mean_speed_m_s=distance / (end_s - begin_s) if end_s > begin_s else float("nan"),
        tracking_rms=np.sqrt(np.mean(error**2, axis=0)).tolist() if len(error) else [],
        tilt_max_rad=float(tilt.max()) if len(tilt) else float("nan"),
        load_peak_nm=dict(zip(names, peaks, strict=True)),
        falls=list(measures.falls(run)) if measures.has_falls_signals(run) else None,
    )


def _event(run: Run, index: int) -> dict[str, Any]:
    event = run.events[index]
    first_ns = run.states.host_stamp_ns[0] if len(run.states) else run.header.started_host_stamp_ns
    return {
        "time_s": round(float(event.host_stamp_ns - first_ns) * 1e-9, 6),
        "severity": event.severity.name.lower(),
        "name": event.name,
        "text": event.text,
        "values": dict(event.values),
    }


def histogram(values_ms: Array) -> Histogram:
    """Count values, shape (n,), in 20 equal bins up to their 99th percentile and one more up to the largest."""
    if not len(values_ms):
        return Histogram([], [])
    low, high, top = float(values_ms.min()), float(np.percentile(values_ms, 99)), float(values_ms.max())
    edges = np.linspace(low, high if high > low else low + 1.0, 21)
    if top > edges[-1]:
        edges = np.append(edges, top)
    counts, _ = np.histogram(values_ms, bins=edges)
    return Histogram(edges.tolist(), counts.tolist())
