"""Open state streams: each gets every message, in order, and none is ever skipped."""

from __future__ import annotations

import hashlib
import queue
from collections.abc import Callable

from bosdyn.api import robot_state_pb2

MAX_WAITING = 20_000
"""A reader that is a minute behind is gone: its stream is closed."""


class StateSubscription:
    """One open state stream; see :class:`fake_robot.network.status.StateSubscription`."""

    def __init__(self, on_close: Callable[[StateSubscription], None]) -> None:
        self._on_close = on_close
        self._messages: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._is_closed = False

    def get(self, timeout_s: float) -> bytes | None:
        """The next message; None after ``timeout_s`` without one, or once closed and empty."""
        if self._is_closed:
            return None
        try:
            return self._messages.get(timeout=timeout_s)
        except queue.Empty:
            return None

    @property
    def is_closed(self) -> bool:
        """Whether no message will come any more."""
        return self._is_closed

    def close(self) -> None:
        """Send no more; a waiting ``get`` returns."""
        if not self._is_closed:
            self._is_closed = True
            self._messages.put(None)
            self._on_close(self)

    def put(self, message: bytes) -> None:
        """A message has arrived."""
        self._messages.put(message)
        if self._messages.qsize() > MAX_WAITING:
            self.close()


def spoil(message: bytes, kind: str) -> bytes:
    """A state message, spoilt: ``eleven_joints``, ``cut`` in the middle, ``noise`` of the same length, or ``empty``."""
    if kind == "eleven_joints":
        state = robot_state_pb2.RobotStateStreamResponse.FromString(message)
        for values in (state.joint_states.position, state.joint_states.velocity, state.joint_states.load):
            del values[11:]
        wire: bytes = state.SerializeToString()
        return wire
    if kind == "cut":
        return message[: len(message) // 2]
    if kind == "noise":
        return hashlib.shake_256(message).digest(len(message))
    return b""
