"""Events in the words and the form that operators get."""

from __future__ import annotations

import signal
from typing import Final

from spot_protos import log_pb2, operator_pb2

_SEVERITIES: Final = {number: name.lower() for name, number in log_pb2.Event.Severity.items()}


def operator_event(event: log_pb2.Event) -> operator_pb2.Event:
    """An event of a run's log, for operators."""
    return operator_pb2.Event(
        host_stamp_ns=event.host_stamp_ns,
        robot_stamp_ns=event.robot_stamp_ns,
        severity=_SEVERITIES.get(event.severity, "info"),
        name=event.name,
        text=event.text,
        values=dict(event.values),
    )


def how_it_died(code: int) -> str:
    """A control process that ended without its last word."""
    how = f"with signal {signal.Signals(-code).name}" if code < 0 else f"with exit code {code}"
    if code == 0:
        how = "with exit code 0, or with one that the system has lost,"
    return (
        f"the control process ended {how} and said nothing more; the robot's own time-outs ended the motion; "
        "see to the robot, then arm again"
    )
