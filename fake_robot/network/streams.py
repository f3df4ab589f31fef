"""Messages on their way: each delayed by its own draw, in order, some lost; and the state streams that clients read."""

from __future__ import annotations

import hashlib
import queue
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from bosdyn.api import robot_state_pb2

from fake_robot.scenario.parts import ChannelConfig
from spot_model.robot.facts import N_JOINTS

MessageT = TypeVar("MessageT")

_BLOCK = 512


@dataclass
class ChannelFault:
    """What a fault adds to a channel's own delays and losses; a fresh one adds nothing."""

    delay_s: float = 0.0
    jitter_s: float = 0.0
    """Mean of an exponential delay."""
    drop_probability: float = 0.0
    """Of each message, on its own."""


class DelayLine(Generic[MessageT]):
    """Messages under way. Times are nanoseconds of robot time since the start.

    A message arrives at max(arrival of the one before, sent + delay): a stream never overtakes itself.
    """

    def __init__(self, config: ChannelConfig, rng: np.random.Generator) -> None:
        self._config = config
        self._rng = rng
        self._under_way: deque[tuple[int, int, MessageT]] = deque()
        self._latest_ns = 0
        self._delays_ns: list[int] = []
        self._losses: list[bool] = []
        self.fault = ChannelFault()

    def send(self, message: MessageT, now_ns: int) -> None:
        """A message leaves now."""
        if not self._delays_ns:
            self._draw()
        delay_ns, is_lost = self._delays_ns.pop(), self._losses.pop()
        fault = self.fault
        if fault.jitter_s > 0.0:
            delay_ns += int(self._rng.exponential(fault.jitter_s) * 1e9)
        if fault.drop_probability > 0.0:
            is_lost = is_lost or self._rng.random() < fault.drop_probability
        if is_lost:
            return
        self._latest_ns = max(self._latest_ns, now_ns + delay_ns + round(fault.delay_s * 1e9))
        self._under_way.append((self._latest_ns, now_ns, message))

    @property
    def next_arrival_ns(self) -> int | None:
        """When the next message arrives; None if none is under way."""
        return self._under_way[0][0] if self._under_way else None

    def receive(self, now_ns: int) -> list[tuple[int, int, MessageT]]:
        """What has arrived by now and was not received before, in order: (arrival, sent, message)."""
        arrived = []
        while self._under_way and self._under_way[0][0] <= now_ns:
            arrived.append(self._under_way.popleft())
        return arrived

    def _draw(self) -> None:
        # In blocks: one draw costs as much as five hundred.
        self._delays_ns = (self._config.delay.sample(self._rng, _BLOCK) * 1e9).astype(np.int64).tolist()
        self._losses = (self._rng.random(_BLOCK) < self._config.drop_probability).tolist()


MAX_WAITING = 20_000
"""A reader that is a minute behind is gone: its stream is closed."""


class StateSubscription:
    """One open state stream, which gets every message, in order; none is ever skipped."""

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
    """A state message, spoilt.

    It lacks joints (``eleven_joints``, or those of an arm: ``no_arm``), is ``cut`` in the middle, ``noise`` of the same
    length, or ``empty``.
    """
    if kind in ("eleven_joints", "no_arm"):
        state = robot_state_pb2.RobotStateStreamResponse.FromString(message)
        for values in (state.joint_states.position, state.joint_states.velocity, state.joint_states.load):
            del values[11 if kind == "eleven_joints" else N_JOINTS :]
        wire: bytes = state.SerializeToString()
        return wire
    if kind == "cut":
        return message[: len(message) // 2]
    if kind == "noise":
        return hashlib.shake_256(message).digest(len(message))
    return b""
