"""What ``spot-rl log info --all`` prints: the summary, then per-joint figures, the delay histogram, the header."""

from __future__ import annotations

from spot_log.page.summary import summary_lines
from spot_log.tools.info import Histogram, LogInfo

BAR_WIDTH = 40


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
        f"  {low:8.2f} to {high:8.2f} {count:7d} {'█' * round(BAR_WIDTH * count / top)}"
        for low, high, count in zip(histogram.edges_ms[:-1], histogram.edges_ms[1:], histogram.counts, strict=True)
    ]


def _joint_rows(values: dict[str, float]) -> list[str]:
    items = list(values.items())
    return [
        "  " + "   ".join(f"{joint} {value:6.1f}" for joint, value in items[i : i + 3]) for i in range(0, len(items), 3)
    ]
