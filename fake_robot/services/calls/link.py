"""Whether the robot can be reached at all: cut for a while, or gone for a reboot. No gRPC."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field


@dataclass
class Link:
    """The network between the clients and the robot. Thread-safe.

    Cuts are measured on the host's clock: in lock-step a cut-off client could not let robot time pass.
    """

    host_now_ns: Callable[[], int] = time.monotonic_ns
    _down_until_ns: int = 0
    _reason: str = ""
    _streams: list[tuple[str, Callable[[], None]]] = field(default_factory=list)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def cut(self, duration_s: float, reason: str) -> None:
        """Refuse every call for ``duration_s`` host seconds, and end the open streams."""
        with self._lock:
            self._down_until_ns = self.host_now_ns() + round(duration_s * 1e9)
            self._reason = reason
        self.end_streams()

    def restore(self) -> None:
        """End a cut."""
        with self._lock:
            self._down_until_ns = 0

    def why_down(self) -> str | None:
        """The reason for which calls are refused now; None while the link is up."""
        with self._lock:
            return self._reason if self.host_now_ns() < self._down_until_ns else None

    def end_streams(self, kind: str = "") -> int:
        """End the open streams of one kind (``state`` or ``command``), or all; returns how many."""
        with self._lock:
            chosen = [end for name, end in self._streams if kind in {"", name}]
        for end_stream in chosen:
            end_stream()
        return len(chosen)

    def open_streams(self, kind: str) -> int:
        """How many streams of one kind are open."""
        with self._lock:
            return sum(name == kind for name, _ in self._streams)

    def listen(self, kind: str, end_stream: Callable[[], None]) -> Callable[[], None]:
        """Have ``end_stream`` called when the stream has to end; returns what takes it off the list again."""
        entry = (kind, end_stream)
        with self._lock:
            self._streams.append(entry)

        def forget() -> None:
            with self._lock:
                if entry in self._streams:
                    self._streams.remove(entry)

        return forget
