"""Times on the wire: integer nanoseconds to and from protobuf's timestamps and durations."""

from __future__ import annotations

from typing import Any, TypeAlias

from google.protobuf.duration_pb2 import Duration
from google.protobuf.timestamp_pb2 import Timestamp

from spot_model.robot.stamps import NS_PER_S

StatusValue: TypeAlias = Any
"""A value of one of the vendor's status enumerations, whose generated code has no types."""


def timestamp_from_ns(stamp_ns: int) -> Timestamp:
    """A timestamp of ``stamp_ns`` nanoseconds since the UNIX epoch."""
    return Timestamp(seconds=stamp_ns // NS_PER_S, nanos=stamp_ns % NS_PER_S)


def ns_from_timestamp(stamp: Timestamp) -> int:
    """Nanoseconds since the UNIX epoch."""
    return stamp.seconds * NS_PER_S + stamp.nanos


def duration_from_ns(duration_ns: int) -> Duration:
    """A duration whose seconds and nanoseconds have one sign, as protobuf demands."""
    seconds, nanos = divmod(abs(duration_ns), NS_PER_S)
    return Duration(seconds=seconds, nanos=nanos) if duration_ns >= 0 else Duration(seconds=-seconds, nanos=-nanos)


def ns_from_duration(duration: Duration) -> int:
    """Nanoseconds of a duration, with its sign."""
    return duration.seconds * NS_PER_S + duration.nanos
