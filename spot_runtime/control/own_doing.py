"""What this process itself, or its computer, has to do with a stop."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from spot_runtime.host.pauses import SHARE, Pause
from spot_runtime.stops import Stop, StopReason

LATE: Final = (StopReason.STATE_STALE, StopReason.STATE_LOST, StopReason.TICKS_SKIPPED)
"""What a process that did not run sees of a robot and a link that are well."""


def with_own_doing(stop: Stop, pause: Pause) -> Stop:
    """The stop, in words that tell of this process's own pause; where that explains all, a stop of its own.

    After a pause states come again, so it ends in damping, which needs a link, also where silence had been due.
    """
    age_s = stop.values.get("age_s", 0.0)
    # What has piled up in a pause is caught up with in no more time than that.
    is_just_over = pause.duration_s >= SHARE * age_s and pause.ago_s <= max(age_s, pause.duration_s)
    if stop.reason in LATE and pause.is_standstill and is_just_over:
        return Stop(StopReason.PROCESS_PAUSED, f"for {pause.duration_s:.3g} s", stop.values)
    if stop.reason not in LATE and pause.is_standstill:  # no command reached the robot meanwhile
        words = f"{pause.ago_s:.1f} s before, this process did not run for {pause.duration_s:.3g} s"
        return replace(stop, detail=f"{stop.detail}; {words}" if stop.detail else words)
    if stop.reason is StopReason.STATE_STALE:
        return replace(stop, detail=why_old(age_s, pause if is_just_over else pause._replace(duration_s=0.0)))
    return stop


def why_old(age_s: float, pause: Pause) -> str:
    """Whether this computer or what lies before it is why a state is so old; empty where that is not known."""
    waited_s = pause.cpu_wait_s
    if waited_s is not None and waited_s >= SHARE * max(age_s, pause.duration_s):
        return (
            f"this computer is too busy; a thread of this program had to wait {waited_s * 1e3:.1f} ms for a processor"
        )
    if pause.duration_s >= SHARE * age_s:
        busy = "though it had a processor: it, or what this computer runs on, was busy"
        return f"this program did not look for {pause.duration_s * 1e3:.1f} ms, {busy}"
    if waited_s is None:
        return ""
    return (
        "the robot or the link was late; this program looked in time, and none of its threads waited more than "
        f"{waited_s * 1e3:.1f} ms for a processor"
    )
