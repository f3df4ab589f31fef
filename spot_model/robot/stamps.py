"""Stamps are integers of nanoseconds; durations are floats of seconds."""

from typing import Final

NS_PER_S: Final = 1_000_000_000
