"""Clock-skew estimates, one set of samples a client. Pure bookkeeping, no gRPC."""

from __future__ import annotations

import secrets
import threading
from collections import OrderedDict, deque
from dataclasses import dataclass, field

MAX_CLIENTS = 256
MAX_SAMPLES = 25


@dataclass(frozen=True)
class Sample:
    """One round trip: how long it took, and how far the robot's clock is ahead of the client's. Nanoseconds."""

    round_trip_ns: int
    clock_skew_ns: int
    robot_stamp_ns: int


def sample_from_round_trip(client_tx_ns: int, server_rx_ns: int, server_tx_ns: int, client_rx_ns: int) -> Sample:
    """Estimate skew and round trip as NTP does: the way there and the way back are taken to be equally long."""
    round_trip_ns = (client_rx_ns - client_tx_ns) - (server_tx_ns - server_rx_ns)
    clock_skew_ns = ((server_rx_ns - client_tx_ns) + (server_tx_ns - client_rx_ns)) // 2
    return Sample(round_trip_ns, clock_skew_ns, server_tx_ns)


@dataclass
class TimeSyncClients:
    """The time-sync service's memory: the last samples of each client. Thread-safe.

    The best estimate is the newest one of the shortest round trip among the last 25. In lock-step, where the robot's
    clock stands still between steps, only the newest counts.
    """

    needed_samples: int
    uses_newest: bool
    is_ready: bool = True
    _samples: OrderedDict[str, deque[Sample]] = field(default_factory=OrderedDict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def client(self, clock_identifier: str) -> str:
        """The identifier itself if it is known, else a new one."""
        with self._lock:
            if clock_identifier in self._samples:
                self._samples.move_to_end(clock_identifier)
                return clock_identifier
            identifier = f"spot-time-sync-{secrets.token_hex(8)}"
            self._samples[identifier] = deque(maxlen=MAX_SAMPLES)
            while len(self._samples) > MAX_CLIENTS:
                self._samples.popitem(last=False)
            return identifier

    def is_established(self, clock_identifier: str) -> bool:
        """Whether the identifier was given to a client, and that client has reported enough round trips."""
        with self._lock:
            return len(self._samples.get(clock_identifier, ())) >= self.needed_samples

    def add(self, clock_identifier: str, sample: Sample) -> None:
        """Remember a round trip of a known client; one with a negative duration is no measurement and is dropped."""
        with self._lock:
            if sample.round_trip_ns >= 0:
                self._samples[clock_identifier].append(sample)

    def best(self, clock_identifier: str) -> Sample | None:
        """The best estimate; None until there are enough samples."""
        with self._lock:
            samples = self._samples[clock_identifier]
            if len(samples) < self.needed_samples:
                return None
            return samples[-1] if self.uses_newest else min(reversed(samples), key=lambda s: s.round_trip_ns)

    def reset(self) -> None:
        """Forget every client, as a reboot does."""
        with self._lock:
            self._samples.clear()
