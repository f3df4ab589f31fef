"""Where the service stands: its state, since when, and the events by which everybody is told."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from spot_log.format.records import EventRecord, Severity
from spot_runtime.host.clock import HostClock
from spot_runtime.host.service_manager import ServiceManager
from spot_runtime.operator.refusal import not_now
from spot_runtime.operator.server.event_history import EventHistory
from spot_runtime.operator.server.states import State


class ServiceState:
    """One state at a time; guarded by :attr:`lock`, which its owner holds whenever it looks and then acts."""

    def __init__(self, manager: ServiceManager, tell: Callable[[EventRecord], None]) -> None:
        self._manager, self._tell, self._clock = manager, tell, HostClock()
        self.lock = threading.RLock()
        self._changed = threading.Condition(self.lock)
        self.now, self.since_s = State.IDLE, time.monotonic()
        self.events = EventHistory()

    def set(self, state: State) -> None:
        """The service is in this state now."""
        with self._changed:
            if state is not self.now:
                self.now, self.since_s = state, time.monotonic()
                self.say("state", state.value)
                self._manager.status(state.value)
            self._changed.notify_all()

    def wait_for_change(self, timeout_s: float) -> None:
        """Release the lock until the state is set again, for at most this long."""
        self._changed.wait(timeout_s)

    def need(self, name: str, *states: State) -> None:
        """Refuse what is asked in any other state. Raises Refusal."""
        if self.now not in states:
            wanted = " or ".join(state.value for state in states)
            raise not_now(f"{name} needs the state {wanted}, and it is {self.now.value}; {self.now.advice}")

    def say(self, name: str, text: str, *, severity: Severity = Severity.INFO) -> None:
        """Tell of an event of the service's own."""
        self.record(EventRecord(self._clock.now_ns(), 0, severity, f"service_{name}", text))

    def record(self, event: EventRecord) -> None:
        """Keep an event, and tell of it."""
        self.events.add(event)
        self._tell(event)
