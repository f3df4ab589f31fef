"""Velocity commands from a sequence file."""

from __future__ import annotations

from spot_model.io.velocity_sequence import VelocitySequence
from spot_runtime.sources.base import Wanted


class ScriptedSource:
    """Plays a sequence once, or for a given time."""

    def __init__(self, sequence: VelocitySequence, *, duration_s: float | None = None) -> None:
        """Play ``sequence``, or (with ``duration_s``, above 0) over and over until that time is up."""
        self.name = sequence.name
        self._sequence = sequence
        self._total_s = sequence.duration_s if duration_s is None else duration_s

    def sample(self, active_s: float, host_stamp_ns: int) -> Wanted:
        """See the protocol."""
        del host_stamp_ns
        if active_s >= self._total_s:
            return Wanted(self._sequence.at(self._sequence.duration_s), is_finished=True)
        return Wanted(self._sequence.at(active_s % self._sequence.duration_s))

    def close(self) -> None:
        """Nothing is held."""
