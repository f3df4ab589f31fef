"""Velocity commands from a sequence file."""

from __future__ import annotations

from spot_model.io.velocity_sequence import VelocitySequence
from spot_runtime.sources.base import Wanted


class ScriptedSource:
    """Plays a sequence, ``repeat`` times or for a given time."""

    def __init__(self, sequence: VelocitySequence, *, repeat: int = 1, duration_s: float | None = None) -> None:
        """Play ``sequence`` ``repeat`` times, or (with ``duration_s``) over and over until that time is up.

        Raises:
            ValueError: ``repeat`` is below 1, or ``duration_s`` not above 0.
        """
        if repeat < 1 or (duration_s is not None and duration_s <= 0.0):
            raise ValueError(f"repeat = {repeat}, duration_s = {duration_s}; allowed: at least 1, above 0")
        self.name = sequence.name
        self._sequence = sequence
        self._total_s = sequence.duration_s * repeat if duration_s is None else duration_s

    @property
    def total_s(self) -> float:
        """How long it plays."""
        return self._total_s

    def sample(self, active_s: float, host_stamp_ns: int) -> Wanted:
        """See the protocol."""
        del host_stamp_ns
        if active_s >= self._total_s:
            return Wanted(self._sequence.at(self._sequence.duration_s), is_finished=True)
        return Wanted(self._sequence.at(active_s % self._sequence.duration_s))

    def close(self) -> None:
        """Nothing is held."""
