"""The stream of joint commands, which a thread of the transport feeds from a slot with the newest one."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, Final

import grpc
from bosdyn.api import robot_command_pb2

from spot_runtime.hal.spot.latest_slot import LatestSlot
from spot_runtime.hal.spot.vendor_errors import describe

COMMAND_METHOD: Final = "/bosdyn.api.RobotCommandStreamingService/JointControlStream"


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
            request_serializer=bytes,
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
