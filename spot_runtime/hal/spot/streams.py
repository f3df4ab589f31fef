"""The two streams of joint control: states in, commands out, each with a thread of its own."""

from __future__ import annotations

import queue
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final

import grpc
from bosdyn.api import robot_command_pb2, robot_state_pb2

from spot_log.format.vendor_state import StateMessageError, robot_state_from_wire
from spot_model.robot.state import RobotState
from spot_runtime.hal.spot.latest_slot import LatestSlot
from spot_runtime.hal.spot.vendor_errors import describe
from spot_runtime.host.realtime import let_others_run

STATE_METHOD: Final = "/bosdyn.api.RobotStateStreamingService/GetRobotStateStream"
COMMAND_METHOD: Final = "/bosdyn.api.RobotCommandStreamingService/JointControlStream"


OnWire = Callable[[bytes, int], None]
"""Takes a message's bytes and the instant of its receipt, host clock."""

OnEnd = Callable[[str], None]
"""Takes why a stream has ended."""


def _as_it_is(wire: bytes) -> bytes:
    return wire


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
    ) -> None:
        """Open the stream.

        Args:
            channel: Secure channel to the state streaming service.
            request: The request, header filled.
            now_ns: The host's clock.
            on_wire: Takes each message's bytes and the instant of its receipt.
            on_end: Takes the reason when the stream ends other than by :meth:`stop`.
        """
        self.states: queue.SimpleQueue[RobotState | None] = queue.SimpleQueue()
        """States as they come; None after the last one."""
        self._now_ns, self._on_wire, self._on_end = now_ns, on_wire, on_end
        self._is_stopped = False
        stream = channel.unary_stream(
            STATE_METHOD,
            request_serializer=robot_state_pb2.RobotStateStreamRequest.SerializeToString,
            response_deserializer=_as_it_is,
        )
        self._call: Any = stream(request)
        self._thread = threading.Thread(target=self._run, name="states", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the stream and the thread."""
        self._is_stopped = True
        self._call.cancel()
        self._thread.join(timeout=2.0)

    def _run(self) -> None:
        put, now_ns, on_wire = self.states.put, self._now_ns, self._on_wire
        try:
            for wire in self._call:
                stamp_ns = now_ns()
                put(robot_state_from_wire(wire, stamp_ns))
                # The log can wait until the loop has answered, and the answer has left; each gets a turn.
                let_others_run()
                let_others_run()
                on_wire(wire, stamp_ns)
            reason = "the robot closed the state stream"
        except grpc.RpcError as error:
            reason = describe(error)
        except StateMessageError as error:
            self._call.cancel()
            reason = str(error)
        if not self._is_stopped:
            self._on_end(reason)
        put(None)


class FedStates:
    """States that are handed in, where no stream of our own brings them; otherwise like :class:`StateReceiver`."""

    def __init__(self, receipt_ns: Callable[[int], int], on_wire: OnWire, on_end: OnEnd) -> None:
        """Take the same as :class:`StateReceiver`."""
        self.states: queue.SimpleQueue[RobotState | None] = queue.SimpleQueue()
        self._receipt_ns, self._on_wire, self._on_end = receipt_ns, on_wire, on_end
        self._is_ended = False

    def feed(self, wires: Iterable[bytes], ended: str) -> None:
        """Take messages, and why no more will come; empty when they go on."""
        if self._is_ended:
            return
        try:
            for wire in wires:
                state = robot_state_from_wire(wire, self._receipt_ns)
                self.states.put(state)
                self._on_wire(wire, state.host_stamp_ns)
        except StateMessageError as error:
            ended = str(error)
        if ended:
            self._is_ended = True
            self._on_end(ended)

    def stop(self) -> None:
        """Nothing is open."""


class CommandStream:
    """Feeds the command stream from a slot that holds the newest command."""

    def __init__(
        self,
        channel: grpc.Channel,
        first: tuple[int, bytes],
        *,
        now_ns: Callable[[], int],
        on_end: Callable[[str], None],
    ) -> None:
        """Open the stream.

        Args:
            channel: Secure channel to the command streaming service.
            first: Key and wire bytes of the first command.
            now_ns: The host's clock.
            on_end: Takes the robot's verdict when the stream ends other than by :meth:`stop`.
        """
        self._slot: LatestSlot[tuple[int, bytes]] = LatestSlot()
        self._slot.put(first)
        self._now_ns, self._on_end = now_ns, on_end
        self._departures: deque[tuple[int, int]] = deque(maxlen=256)
        self._is_stopped = False
        stream = channel.stream_unary(
            COMMAND_METHOD,
            request_serializer=_as_it_is,
            response_deserializer=robot_command_pb2.JointControlStreamResponse.FromString,
        )
        self._call: Any = stream.future(self._commands())
        self._call.add_done_callback(self._ended)

    @property
    def replaced(self) -> int:
        """Commands that were overtaken by a newer one before they were sent."""
        return self._slot.replaced

    def put(self, key: int, wire: bytes) -> None:
        """Send these bytes next."""
        self._slot.put((key, wire))

    def departures(self) -> list[tuple[int, int]]:
        """Key and host stamp of each command that the transport took since the last call."""
        taken = []
        while self._departures:
            taken.append(self._departures.popleft())
        return taken

    def stop(self) -> None:
        """Send nothing more and close the stream."""
        self._is_stopped = True
        self._slot.close()

    def cancel(self) -> None:
        """Close the stream without waiting for the robot's answer."""
        self.stop()
        self._call.cancel()

    def _commands(self) -> Iterator[bytes]:
        while (entry := self._slot.take()) is not None:
            key, wire = entry
            self._departures.append((key, self._now_ns()))
            yield wire

    def _ended(self, call: Any) -> None:
        self._slot.close()
        if self._is_stopped:
            return
        try:
            response = call.result()
        except grpc.RpcError as error:
            self._on_end(describe(error))
        except grpc.FutureCancelledError:
            return
        else:
            name = robot_command_pb2.JointControlStreamResponse.Status.Name(response.status)
            self._on_end(f"{name}: {response.message}" if response.message else name)
