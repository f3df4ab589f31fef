"""Where states come from: a stream with its own thread, or lock-step, which hands them in."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterable
from typing import Any, Final

import grpc
from bosdyn.api import robot_state_pb2

from spot_log.format.records import WireState
from spot_log.format.vendor_state import StateMessageError, robot_state_from_wire
from spot_model.robot.facts import NS_PER_S
from spot_model.robot.state import RobotState
from spot_runtime.hal.spot.vendor_errors import describe_error
from spot_runtime.host.realtime import let_others_run

StateQueue = queue.SimpleQueue[RobotState | None]
"""States as they come; None after the last one."""

OnWire = Callable[[WireState], None]
"""Takes a message's bytes and the instant of its receipt, host clock."""

OnEnd = Callable[[str], None]
"""Takes why a stream has ended."""

REOPEN_AFTER_NS: Final = NS_PER_S
"""A stream that the robot closes is opened again, but not one that lived for less than this: it would go on so. While
no state comes, the newest grows old, and the watchdogs act as on a link that is silent."""


class StateReceiver:
    """Drains the state stream: raw bytes to the log, states to a queue.

    The vendor never drops a state for a slow reader, so the thread does nothing else.
    """

    def __init__(
        self,
        channel: grpc.Channel,
        request: robot_state_pb2.RobotStateStreamRequest,
        *,
        now_ns: Callable[[], int],
        on_wire: OnWire,
        on_end: OnEnd,
        on_reopen: Callable[[float], None] = lambda _: None,
    ) -> None:
        """Open the stream by a request with its header.

        ``on_wire`` takes each message's bytes and the instant of its receipt, ``on_end`` the reason when the stream
        ends other than by :meth:`stop`, ``on_reopen`` for how many seconds one was open that the robot closed and that
        was opened again.
        """
        self.states: StateQueue = queue.SimpleQueue()
        self._now_ns, self._on_wire, self._on_end, self._on_reopen = now_ns, on_wire, on_end, on_reopen
        self._is_stopped = False
        self._request = request
        self._stream = channel.unary_stream(
            "/bosdyn.api.RobotStateStreamingService/GetRobotStateStream",
            request_serializer=robot_state_pb2.RobotStateStreamRequest.SerializeToString,
            response_deserializer=bytes,
        )
        self._call: Any = self._stream(request)
        self._thread = threading.Thread(target=self._run, name="states", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the stream and the thread."""
        self._is_stopped = True
        self._call.cancel()
        self._thread.join(timeout=2.0)

    def _run(self) -> None:
        reason = ""
        while not reason and not self._is_stopped:
            opened_ns = self._now_ns()
            reason = self._drain()
            if reason or self._is_stopped:
                break
            lived_ns = self._now_ns() - opened_ns
            if lived_ns < REOPEN_AFTER_NS:
                reason = "the robot closed the state stream"
            else:
                self._call = self._stream(self._request)
                self._on_reopen(lived_ns / NS_PER_S)
        if self._is_stopped:
            self._call.cancel()  # stopped while it was opened again
        else:
            self._on_end(reason)
        self.states.put(None)

    def _drain(self) -> str:
        """Take what one stream brings. Returns what is wrong with it; empty where the robot just closed it."""
        put, now_ns, on_wire = self.states.put, self._now_ns, self._on_wire
        try:
            for wire in self._call:
                stamp_ns = now_ns()
                put(robot_state_from_wire(wire, stamp_ns))
                # The log can wait until the loop has answered, and the answer has left; each gets a turn.
                let_others_run()
                let_others_run()
                on_wire(WireState(wire, stamp_ns))
        except grpc.RpcError as error:
            return describe_error(error)
        except StateMessageError as error:
            self._call.cancel()
            return str(error)
        return ""


class PolledStates:
    """States that are handed in, where no stream of our own brings them; otherwise like :class:`StateReceiver`."""

    def __init__(self, receipt_ns: Callable[[int], int], on_wire: OnWire, on_end: OnEnd) -> None:
        self.states: StateQueue = queue.SimpleQueue()
        self._receipt_ns, self._on_wire, self._on_end = receipt_ns, on_wire, on_end
        self._is_ended = False

    def feed(self, wires: Iterable[bytes], ended: str) -> None:
        """Take messages, and the reason why the stream has ended; empty while it goes on."""
        if self._is_ended:
            return
        try:
            for wire in wires:
                state = robot_state_from_wire(wire, self._receipt_ns)
                self.states.put(state)
                self._on_wire(WireState(wire, state.host_stamp_ns))
        except StateMessageError as error:
            ended = str(error)
        if ended:
            self._is_ended = True
            self._on_end(ended)

    def stop(self) -> None:
        """Nothing is open."""


def take_all(states: StateQueue) -> list[RobotState]:
    """Take what is there, without waiting; there is one reader, so what is there stays there."""
    taken = []
    while not states.empty():
        state = states.get_nowait()
        if state is not None:
            taken.append(state)
    return taken
