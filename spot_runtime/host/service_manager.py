"""The notify protocol of systemd: ready, status, watchdog, stopping. Silent where no service manager listens.

The watchdog has one source: :meth:`ServiceManager.progressed`, which the control loop's own thread calls after each
cycle. Nothing else feeds it, no timer and no other thread, so a loop that hangs is ended although the process lives.

By hand, because the packages for it have no wheels for the robot's computer. Source: sd_notify(3).
"""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable, Mapping
from typing import Final

SOCKET_VARIABLE: Final = "NOTIFY_SOCKET"
PROCESS_VARIABLE: Final = "WATCHDOG_PID"
FEEDS_PER_PERIOD: Final = 4
"""systemd asks for at least two; with four, one late or lost message does not end a run."""


class ServiceManager:
    """Tells the service manager how the run goes. No method blocks or raises; what cannot be told is counted."""

    def __init__(
        self, address: str = "", watchdog_ns: int = 0, *, monotonic_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        """Connect to a datagram socket's path, or ``@name`` for an abstract one; nothing for an empty address.

        The manager expects a sign of progress each ``watchdog_ns`` by this clock; 0 for none.
        """
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._monotonic_ns = monotonic_ns
        self._feed_ns = watchdog_ns // FEEDS_PER_PERIOD
        self._feed_due_ns = 0
        self._is_ready = self._is_stopping = False
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) if address else None
        self.lost = 0
        """Messages that the manager did not take."""

    @staticmethod
    def from_environment(environment: Mapping[str, str]) -> ServiceManager:
        """The manager that the environment names.

        A watchdog meant for another process, as the variable ``WATCHDOG_PID`` says, is not fed.
        """
        address, period_us = environment.get(SOCKET_VARIABLE, ""), environment.get("WATCHDOG_USEC", "")
        is_ours = environment.get(PROCESS_VARIABLE, str(os.getpid())) == str(os.getpid())
        watchdog_ns = int(period_us) * 1_000 if is_ours and period_us.isdecimal() else 0
        return ServiceManager(address if address.startswith(("/", "@")) else "", watchdog_ns)

    @property
    def is_listening(self) -> bool:
        """Whether somebody is to be told."""
        return self._socket is not None

    def ready(self) -> None:
        """The loop is about to run; from now on the manager watches its progress."""
        if not self._is_ready:
            self._is_ready = True
            self._tell("READY=1")

    def progressed(self) -> None:
        """The loop has done a cycle. Called by the loop's thread alone; a message goes out four times a period."""
        if not self._feed_ns:
            return
        now_ns = self._monotonic_ns()
        if now_ns >= self._feed_due_ns:
            self._feed_due_ns = now_ns + self._feed_ns
            self._tell("WATCHDOG=1")

    def stopping(self) -> None:
        """The loop is done. The manager goes on watching for progress until the last process has ended."""
        if not self._is_stopping:
            self._is_stopping = True
            self._tell("STOPPING=1")

    def status(self, text: str) -> None:
        """What ``systemctl status`` shows: one line."""
        self._tell("STATUS=" + " ".join(text.split()))

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _tell(self, message: str) -> None:
        if self._socket is None:
            return
        try:
            self._socket.sendto(message.encode(), socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL, self._address)
        except OSError:
            self.lost += 1
