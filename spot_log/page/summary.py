"""A run in a dozen lines that a person can read."""

from __future__ import annotations

import math

from spot_log.read.run import Run
from spot_log.tools.gaits import gait_line
from spot_log.tools.log_info import Histogram, LogInfo, log_info
from spot_log.tools.measures import Spread

MAX_EVENTS = 8


def summarise(run: Run) -> str:
    """Tell what a run was and how it went. Ends without a newline."""
    return "\n".join(summary_lines(log_info(run)))


def summary_lines(info: LogInfo) -> list[str]:
    """The summary's lines, each a label and what there is to say."""
    lines = [_row("run", _run_text(info)), _row("outcome", info.outcome)]
    lines += [_row("damaged", text) for text in info.damage]
    lines += [
        _row("motion", _motion_text(info)),
        *_gait_rows(info),
        _row("falls", _falls_text(info)),
        _row("states", _states_text(info)),
        _row("ticks", _ticks_text(info)),
        _row("commands", _commands_text(info)),
        _row("delay", _delay_text(info)),
        _row("loads", _loads_text(info)),
        _row("power", _power_text(info)),
        _row("log", _log_text(info)),
    ]
    return lines + _event_lines(info)


def _row(label: str, text: str) -> str:
    return f"{label:<9} {text}"


def _run_text(info: LogInfo) -> str:
    header = info.header
    labels = "".join(f", {key} {value}" for key, value in info.labels.items())
    parts = [
        f"{info.duration_s:.1f} s on {header['robot_id'] or 'an unnamed robot'}",
        f"policy {header['policy_name'] or 'none'}",
        f"sequence {header['command_sequence'] or 'none'}, repeat {header['repeat']}",
    ]
    return ", ".join(parts) + labels


def _motion_text(info: LogInfo) -> str:
    motion = info.motion
    if not math.isfinite(motion.distance_m):
        return "not known: the log has no pose of the body"
    text = f"{motion.distance_m:.2f} m walked in {motion.control_s:.1f} s, "
    text += f"mean speed {number(motion.mean_speed_m_s, '.2f')} m/s, "
    text += f"largest tilt {number(math.degrees(motion.tilt_max_rad), '.1f')}°"
    if motion.tracking_rms and all(math.isfinite(value) for value in motion.tracking_rms):
        vx, vy, wz = motion.tracking_rms
        text += f", velocity error (RMS) forward {vx:.2f} m/s, sideways {vy:.2f} m/s, turning {wz:.2f} rad/s"
    return text


def _gait_rows(info: LogInfo) -> list[str]:
    shown = [_row("gait", gait_line(span)) for span in info.gaits[:12]]
    more = len(info.gaits) - len(shown)
    return [*shown, _row("gait", f"and {more} stretches more, in log info --json")] if more else shown


def _falls_text(info: LogInfo) -> str:
    if info.motion.falls is None:
        return "not known: the log has neither orientation nor contacts"
    if not info.motion.falls:
        return "none"
    told = [
        f"at {fall.start_s:.2f} s for {fall.duration_s:.2f} s ({fall.cause}; tilt {math.degrees(fall.tilt_rad):.0f}°)"
        for fall in info.motion.falls
    ]
    return f"{len(told)}: " + ", ".join(told)


def _states_text(info: LogInfo) -> str:
    states = info.states
    arm = f"; it has an arm, of {info.arm_joints} joints" if info.arm_joints else ""
    return (
        f"{info.state_count} at {number(states.rate_hz, '.2f')} Hz of robot time, longest step "
        f"{number(states.period_ms.largest, '.1f')} ms, {states.gaps} gaps, {states.backward} repeated or "
        f"back-dated{arm}"
    )


def _ticks_text(info: LogInfo) -> str:
    ticks = info.ticks
    return (
        f"{ticks.count} at {number(ticks.rate_hz, '.2f')} Hz, {ticks.skipped} skipped, "
        f"state age {spread(ticks.state_age_ms, 'ms')}, compute {spread(ticks.compute_us, 'µs', '.0f')}"
    )


def _commands_text(info: LogInfo) -> str:
    commands = info.commands
    return (
        f"{commands.count} at {number(commands.rate_hz, '.1f')} Hz, {commands.echoed} echoed, "
        f"{commands.clamped} clamped, state to command {spread(commands.state_to_command_ms, 'ms')}"
    )


def _delay_text(info: LogInfo) -> str:
    commands = info.commands
    return (
        f"command to robot {spread(commands.delay_ms, 'ms')}; "
        f"to its first echo here {spread(commands.acknowledge_lag_ms, 'ms')}"
    )


def _loads_text(info: LogInfo) -> str:
    known = [item for item in info.motion.load_peak_nm.items() if math.isfinite(item[1])]
    if not known:
        return "not known: the log has no joint loads"
    peaks = sorted(known, key=lambda item: -item[1])[:3]
    return "largest " + ", ".join(f"{joint} {peak:.1f} N·m" for joint, peak in peaks)


def _power_text(info: LogInfo) -> str:
    power = info.power
    if not power.polls:
        return "no record of battery and temperatures"
    text = (
        f"battery {number(power.charge_start_percent, '.1f')} to {number(power.charge_end_percent, '.1f')} %, lowest "
        f"{number(power.voltage_min_v, '.1f')} V, peak {number(power.current_peak_a, '.1f')} A, "
        f"{number(power.energy_j / 1e3, '.2f')} kJ drawn"
    )
    if power.motor_temperature_joint:
        text += f"; hottest motor {power.motor_temperature_joint} {power.motor_temperature_max_c:.0f} °C"
    if power.faults:
        text += "; faults: " + ", ".join(power.faults)
    return text


def _log_text(info: LogInfo) -> str:
    lost = {topic: count for topic, count in info.dropped.items() if count}
    told = ", ".join(f"{count} of {topic}" for topic, count in lost.items()) or "nothing"
    return f"{info.size_bytes / 1e6:.2f} MB, {told} dropped"


def _event_lines(info: LogInfo) -> list[str]:
    lines = []
    for event in info.events[:MAX_EVENTS]:
        values = "".join(f" {key}={value:g}" for key, value in event["values"].items())
        lines.append(_row("event", f"{seconds_text(event['time_s']):>9} {event['severity']}: {event['text']}{values}"))
    left = len(info.events) - MAX_EVENTS
    if left > 0:
        lines.append(_row("event", f"and {left} more: 'spot-rl log info --json' lists all"))
    return lines


def spread(values: Spread, unit: str, style: str = ".2f") -> str:
    """Word a spread as median, 99th percentile and largest."""
    if not values.count:
        return "not known"
    return f"p50 {values.p50:{style}}, p99 {values.p99:{style}}, max {values.largest:{style}} {unit}"


def number(value: float, style: str) -> str:
    """Word a number; a dash where it is not known."""
    return f"{value:{style}}" if math.isfinite(value) else "–"


def seconds_text(time_s: float) -> str:
    """Word an instant to a hundredth, without a negative zero."""
    return f"{round(time_s, 2) + 0.0:.2f} s"


def detail_lines(info: LogInfo) -> list[str]:
    """The summary's lines and the details below them."""
    lines = [info.file, *summary_lines(info), ""]
    lines += ["time in each mode"] + [f"  {mode or 'none'}: {time:.2f} s" for mode, time in info.ticks.modes_s.items()]
    lines += ["largest load of each joint, N·m", *_joint_rows(info.motion.load_peak_nm)]
    lines += ["delay from the sending of a command to its receipt by the robot, ms"]
    lines += histogram_lines(info.commands.delay_histogram) or ["  not known: no command was echoed"]
    lines += ["header"]
    for key, value in info.header.items():
        text = ", ".join(value) if isinstance(value, tuple) else str(value)
        lines.append(f"  {key}: {text if len(text) <= 100 else text[:100] + ' …'}")
    return lines


def histogram_lines(histogram: Histogram) -> list[str]:
    """Draw a histogram in text, one line a bin; empty where there is nothing to draw."""
    top = max(histogram.counts, default=0)
    if not top:
        return []
    return [
        f"  {low:8.2f} to {high:8.2f} {count:7d} {'█' * round(40 * count / top)}"
        for low, high, count in zip(histogram.edges_ms[:-1], histogram.edges_ms[1:], histogram.counts, strict=True)
    ]


def _joint_rows(values: dict[str, float]) -> list[str]:
    items = list(values.items())
    return [
        "  " + "   ".join(f"{joint} {value:6.1f}" for joint, value in items[i : i + 3]) for i in range(0, len(items), 3)
    ]
