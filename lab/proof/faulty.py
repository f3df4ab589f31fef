"""What a fault does to a run: to the vendor's adapter, to the policy's actions, and signals to the process.

A signal of somebody who wants a bench to end is told from those that its faults raise: a run answers both alike.
"""

from __future__ import annotations

import contextlib
import os
import signal
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from typing_extensions import Self

from proof.robot import FakeRobot
from spot_log.write.sink import LogSink
from spot_model.policy.policy import Policy
from spot_model.robot.state import JointCommand, RobotState, SlowState
from spot_runtime.config import RunConfig
from spot_runtime.hal.address import parse_address
from spot_runtime.hal.spot.adapter import BosdynHal
from spot_runtime.hal.spot.pace import Pace

Actions = NDArray[np.float32]
When = Literal["up", "control", "down"]
"""Standing up, joint control, or sitting down."""

ENDING: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_raised: Counter[int] = Counter()


class FaultyHal(BosdynHal):
    """The vendor's adapter, to which something happens once, and which may lose or change what it receives."""

    def __init__(self, robot: FakeRobot, config: RunConfig, sink: LogSink, pace: Pace | None) -> None:
        super().__init__(parse_address(robot.address.robot), config, sink, pace)
        self.pace = self._pace
        self.robot = robot
        self.happened_ns, self.power_off_ns = 0, 0
        """Robot clock when it happened, and when sitting down and powering off was asked for; 0 if it never was."""
        self.truth: Any = None
        """The body's extremes from the start of joint control to its end; None where it never began."""
        self.was_off = False
        """Whether the motors had no power any more when sitting down was asked for."""
        self._has_begun = False
        self._planned: list[tuple[int, Callable[[], object]]] = []
        self._spoilt: list[tuple[int, Callable[[RobotState], RobotState | None]]] = []
        self._spoilt_slow: list[tuple[int, Callable[[SlowState], SlowState]]] = []
        self._happens: Callable[[FaultyHal], object] = lambda _: None
        self._at_s = 0.0
        self._when: When = "control"

    def prepare(self, happens: Callable[[FaultyHal], object], at_s: float, when: When) -> None:
        """Say what happens, once, and how long after joint control or another phase began."""
        self._happens, self._at_s, self._when = happens, at_s, when

    def plan(self, seconds: float, happens: Callable[[], object]) -> None:
        """Have something else happen after this much robot time."""
        self._planned.append((self._after_ns(seconds), happens))

    def spoil(self, spoilt: Callable[[RobotState], RobotState | None], lasts_s: float = 0.0) -> None:
        """Change every state before it is used, or lose it, for this long; 0 s: to the end."""
        self._spoilt.append((self._after_ns(lasts_s or 1e9), spoilt))

    def spoil_slow(self, spoilt: Callable[[SlowState], SlowState], lasts_s: float = 0.0) -> None:
        """Spoil a polled state, as :meth:`spoil` does with a streamed one."""
        self._spoilt_slow.append((self._after_ns(lasts_s or 1e9), spoilt))

    @property
    def slow_state(self) -> SlowState | None:
        """The newest polled state, spoilt."""
        slow = super().slow_state
        for until_ns, spoilt in self._spoilt_slow:
            if slow is not None and self.robot_now_ns() < until_ns:
                slow = spoilt(slow)
        return slow

    def begin_joint_control(self, first: JointCommand) -> None:
        """Begin, and count from here."""
        self.robot.truth(reset_extremes=True)
        self._has_begun = True
        self._begins("control")
        super().begin_joint_control(first)

    def stand(self) -> None:
        """Power on and stand, and count from here where that is when it happens."""
        self._begins("up")
        super().stand()

    def go_on(self, until_robot_ns: int, timeout_s: float) -> None:
        """Let it happen when it is due, before time passes."""
        self._let_happen()
        super().go_on(until_robot_ns, timeout_s)

    def receive(self, until_robot_ns: int, timeout_s: float) -> list[RobotState]:
        """Spoil what came."""
        self._let_happen()
        states = super().receive(until_robot_ns, timeout_s)
        for until_ns, spoilt in self._spoilt:
            if self.robot_now_ns() < until_ns:
                states = [changed for state in states if (changed := spoilt(state)) is not None]
        return states

    def power_off(self) -> None:
        """Note when."""
        self.power_off_ns = self.robot_now_ns()
        if self._has_begun and self.truth is None:  # a second call finds the robot half-way down
            self.truth = self.robot.truth()
        self.was_off = not self.robot.is_powered
        self._begins("down")
        super().power_off()

    def _after_ns(self, seconds: float) -> int:
        return self.robot_now_ns() + round(seconds * 1e9)

    def _begins(self, when: When) -> None:
        if when == self._when:
            self.plan(self._at_s, self._happen)

    def _happen(self) -> None:
        if not self.happened_ns:
            self.happened_ns = self.robot_now_ns()
            self._happens(self)

    def _let_happen(self) -> None:
        while due := [planned for planned in self._planned if self.robot_now_ns() >= planned[0]]:
            self._planned = [planned for planned in self._planned if planned not in due]
            for _, happens in due:
                happens()

    def _pause(self, duration_s: float) -> None:
        if self._when != "control":
            self._let_happen()
        super()._pause(duration_s)


@dataclass
class Change:
    """What is done to a network's output."""

    act: Callable[[Actions], Actions] | None = None
    """Takes and returns shape (n, 12); None: nothing is done."""


@dataclass(frozen=True)
class FaultyPolicy(Policy):
    """A policy whose output may be changed while it runs."""

    change: Change = field(default_factory=Change)

    @classmethod
    def of(cls, policy: Policy) -> Self:
        """Make the same policy, unchanged so far."""
        return cls(**{part.name: getattr(policy, part.name) for part in fields(policy)})

    def act(self, observation: NDArray[Any]) -> Actions:
        """Act like the real one, changed; shapes (48,) to (12,), or (n, 48) to (n, 12)."""
        if self.change.act is None:
            return super().act(observation)
        actions = self.change.act(super().act(np.atleast_2d(observation)))
        return actions[0] if np.ndim(observation) == 1 else actions


def raise_as_fault(number: signal.Signals) -> None:
    """Send this process a signal that belongs to what is tried."""
    _raised[number] += 1
    signal.raise_signal(number)


@contextmanager
def ending_the_bench() -> Iterator[None]:
    """After the block, end the bench if a signal came in it that no fault has raised; only in the main thread.

    The run in the block answers the signal first, and brings its robot to rest.

    Raises:
        KeyboardInterrupt: It was SIGINT.
        SystemExit: It was SIGTERM or SIGHUP; the exit code is 128 and its number.
    """
    _raised.clear()
    heard, told = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
    before, came = signal.set_wakeup_fd(told, warn_on_full_buffer=False), b""
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        with contextlib.suppress(BlockingIOError):
            came = os.read(heard, 65536)
        os.close(heard)
        os.close(told)
    for number in ENDING:
        if came.count(number) > _raised[number]:
            raise KeyboardInterrupt if number == signal.SIGINT else SystemExit(128 + number)
