"""The stream of joint commands: encoded one by one, and sent by a thread of the transport, always the newest."""

from __future__ import annotations

import queue
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, Generic, TypeVar

import grpc
from bosdyn.api import robot_command_pb2

from spot_model.robot.facts import NS_PER_S, Array
from spot_model.robot.state import Gains, JointCommand
from spot_runtime.hal.spot.arm import NO_ARM, Arm
from spot_runtime.hal.spot.vendor_errors import describe_error, enum_word

T = TypeVar("T")


class CommandEncoder:
    """Turns commands into wire bytes, reusing one message; for one thread.

    Every message carries the full gains: they are needed in the first one and after each change, and a message that
    gets lost must not leave the robot with the gains of another.
    """

    def __init__(self, client_name: str, velocity_safety_limit_rad_s: float, arm: Arm | None = None) -> None:
        self._arm, self._arm_command = arm or Arm(deque()), NO_ARM
        self._message = robot_command_pb2.JointControlStreamRequest()
        self._message.header.client_name = client_name
        self._message.joint_command.velocity_safety_limit.value = velocity_safety_limit_rad_s
        # What stays the same from one command to the next is not filled in again.
        self._gains: Gains | None = None
        self._velocity: Array | None = None
        self._load: Array | None = None

    def encode(self, command: JointCommand, host_stamp_ns: int) -> bytes:
        """The wire bytes of one command, which is sent at this instant of the host's clock; the arm's joints last."""
        stamp = self._message.header.request_timestamp
        stamp.seconds, stamp.nanos = divmod(host_stamp_ns, NS_PER_S)
        joint = self._message.joint_command
        joint.end_time.seconds, joint.end_time.nanos = divmod(command.end_robot_stamp_ns, NS_PER_S)
        arm = self._arm.command(command.gains) if self._arm.n_joints else NO_ARM
        is_new = arm is not self._arm_command
        self._arm_command = arm
        joint.position[:] = command.position_rad.tolist() + arm.position_rad
        if is_new or command.velocity_rad_s is not self._velocity:
            self._velocity = command.velocity_rad_s
            joint.velocity[:] = self._velocity.tolist() + arm.velocity_rad_s
        if is_new or command.load_nm is not self._load:
            self._load = command.load_nm
            joint.load[:] = self._load.tolist() + arm.load_nm
        if is_new or command.gains is not self._gains:
            self._gains = command.gains
            joint.gains.k_q_p[:] = command.gains.kp_nm_per_rad.tolist() + arm.kp_nm_per_rad
            joint.gains.k_qd_p[:] = command.gains.kd_nm_s_per_rad.tolist() + arm.kd_nm_s_per_rad
        joint.user_command_key = command.key
        wire: bytes = self._message.SerializeToString()
        return wire


class LatestSlot(Generic[T]):
    """Hands the newest value of one thread to another one that waits; ``put`` never blocks.

    A queue of the C library carries at most one token, which says that there is something to take: a condition variable
    takes several times as long.
    """

    def __init__(self) -> None:
        self._value: deque[T] = deque(maxlen=1)
        self._tokens: queue.SimpleQueue[None] = queue.SimpleQueue()
        self._is_closed = False
        self.replaced = 0
        """Values that were never taken."""

    def put(self, value: T) -> None:
        """Leave a value; after ``close`` it is dropped."""
        if self._value:
            self.replaced += 1
        self._value.append(value)
        # A reader that took the last token just now has not looked for the value yet, or will get another token.
        if self._tokens.empty():
            self._tokens.put(None)

    def take(self) -> T | None:
        """Wait for a value; None once the slot is closed."""
        while True:
            self._tokens.get()
            if self._is_closed:
                self._tokens.put(None)  # for the next call
                return None
            if self._value:
                return self._value.popleft()

    def close(self) -> None:
        """Wake the waiting thread for good; a value that was not taken is dropped."""
        self._is_closed = True
        self._tokens.put(None)


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
        """Open the stream with key and wire bytes of the first command.

        ``on_end`` takes the robot's verdict when the stream ends other than by :meth:`stop`.
        """
        self._slot: LatestSlot[tuple[int, bytes]] = LatestSlot()
        self._slot.put(first)
        self._now_ns, self._on_end = now_ns, on_end
        self._departures: deque[tuple[int, int]] = deque(maxlen=256)
        self._is_stopped = False
        stream = channel.stream_unary(
            "/bosdyn.api.RobotCommandStreamingService/JointControlStream",
            request_serializer=bytes,
            response_deserializer=robot_command_pb2.JointControlStreamResponse.FromString,
        )
        self._call: Any = stream.future(self._commands())
        self._call.add_done_callback(self._ended)

    def put(self, key: int, wire: bytes) -> None:
        """Send these bytes next."""
        self._slot.put((key, wire))

    def departed(self, key: int) -> None:
        """Take note that a command leaves now."""
        self._departures.append((key, self._now_ns()))

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

    def _commands(self) -> Iterator[bytes]:
        while (entry := self._slot.take()) is not None:
            key, wire = entry
            self.departed(key)
            yield wire

    def _ended(self, call: Any) -> None:
        self._slot.close()
        if self._is_stopped:
            return
        try:
            response = call.result()
        except grpc.RpcError as error:
            self._on_end(describe_error(error))
        except grpc.FutureCancelledError:
            return
        else:
            name = enum_word(robot_command_pb2.JointControlStreamResponse.Status, response.status)
            self._on_end(f"{name}: {response.message}" if response.message else name)
