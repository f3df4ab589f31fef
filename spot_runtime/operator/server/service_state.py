"""Where the service stands: its states, since when, and the last events, for everybody who asks."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from enum import Enum
from typing import Final

from typing_extensions import Self

from spot_log.format.records import EventRecord, Severity
from spot_protos import operator_pb2
from spot_runtime.host.clock import HostClock
from spot_runtime.host.service_manager import ServiceManager
from spot_runtime.operator.door.access import not_now

KEPT: Final = 500


class EventHistory:
    """A ring of numbered events. A slow reader sees a gap in the numbers and delays nobody."""

    def __init__(self) -> None:
        self._events: deque[operator_pb2.Event] = deque(maxlen=KEPT)
        self._lock = threading.Lock()
        self.count = 0

    def add(self, record: EventRecord) -> None:
        """Number an event and keep it."""
        event = operator_pb2.Event(
            host_stamp_ns=record.host_stamp_ns,
            robot_stamp_ns=record.robot_stamp_ns,
            severity=record.severity.name.lower(),
            name=record.name,
            text=record.text,
            values=record.values,
        )
        with self._lock:
            self.count += 1
            event.number = self.count
            self._events.append(event)

    def after(self, number: int) -> Sequence[operator_pb2.Event]:
        """Events with a higher number than this."""
        if self.count <= number:
            return ()
        with self._lock:
            return [event for event in self._events if event.number > number]


class State(Enum):
    """Where the service stands. Commands reach the joints in ``running`` alone."""

    IDLE = "idle", "no lease is held, nothing is commanded", "arm"
    ARMING = "arming", "connecting, powering on, standing up by the vendor's controller", "stop damp"
    ARMED = (
        "armed",
        "the vendor's controller stands, the lease is ours, the policy waits",
        "start stop damp switch-policy start-log label-log attend",
    )
    RUNNING = (
        "running",
        "the policy has the joints, or takes them over, or hands them back",
        "velocity stop damp label-log attend",
    )
    ENDING = "ending", "sitting, powering off, giving the lease back", "stop"

    meaning: str
    allows: tuple[str, ...]
    """The commands of ``spot-rl ctl`` that are not refused."""

    def __new__(cls, value: str, meaning: str, allows: str) -> Self:
        """A state has its name on the wire as its value."""
        state = object.__new__(cls)
        state._value_, state.meaning, state.allows = value, meaning, tuple(allows.split())
        return state

    @property
    def advice(self) -> str:
        """What to do."""
        return f"allowed now: {', '.join(self.allows)}"


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
