"""The vendor's adapter with something that happens at an instant of robot time, and states spoilt on their way."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal

from spot_log.write.sink import LogSink
from spot_model.robot.state import JointCommand, RobotState, SlowState
from spot_runtime.config import RunConfig
from spot_runtime.hal.connection.address import Address
from spot_runtime.hal.spot.adapter import BosdynHal
from spot_runtime.hal.spot.pace import Pace

if TYPE_CHECKING:
    from proof.faults.rig import Rig

When = Literal["up", "control", "down"]
"""Standing up, joint control, or sitting down."""


class FaultyHal(BosdynHal):
    """The vendor adapter, with something that happens at an instant of robot time."""

    def __init__(self, address: Address, config: RunConfig, sink: LogSink, pace: Pace | None) -> None:
        super().__init__(address, config, sink, pace)
        self.sink = sink
        self.pace = self._pace
        self.happened_ns, self.power_off_ns = 0, 0
        self.truth: Any = None
        self._has_begun = False
        self._due_ns = 0
        self._planned: list[tuple[int, Callable[[], None]]] = []
        self._spoilt: list[tuple[int, Callable[[RobotState], RobotState]]] = []
        self._spoilt_slow: list[tuple[int, Callable[[SlowState], SlowState]]] = []
        self._arrives: Callable[[RobotState], bool] = lambda _: True
        self._at_ns = 0
        self._when: When = "control"
        self.was_off = False
        self._rig: Rig | None = None
        self._happens: Callable[[FaultyHal], None] = lambda _: None

    def prepare(self, rig: Rig, happens: Callable[[FaultyHal], None], at_s: float, when: When) -> None:
        """Say what happens, and when."""
        self._rig, self._happens, self._at_ns, self._when = rig, happens, round(at_s * 1e9), when

    def later(self, seconds: float, happens: Callable[[], None]) -> None:
        """Have something else happen after this much robot time."""
        self.plan(seconds, happens)

    def plan(self, seconds: float, happens: Callable[[], None]) -> None:
        """As :meth:`later`, for as many things as you like."""
        self._planned.append((self.robot_now_ns() + round(seconds * 1e9), happens))

    def spoil(self, spoilt: Callable[[RobotState], RobotState], lasts_s: float) -> None:
        """Change every state before it is used, for this long; 0 s: to the end."""
        self._spoilt.append((self._until_ns(lasts_s), spoilt))

    def spoil_slow(self, spoilt: Callable[[SlowState], SlowState], lasts_s: float) -> None:
        """As :meth:`spoil`, what is polled."""
        self._spoilt_slow.append((self._until_ns(lasts_s), spoilt))

    def thin(self, arrives: Callable[[RobotState], bool]) -> None:
        """Let only these states arrive from now on."""
        self._arrives = arrives

    @property
    def slow_state(self) -> SlowState | None:
        """As it is spoilt."""
        slow = super().slow_state
        for until_ns, spoilt in self._spoilt_slow:
            if slow is not None and self.robot_now_ns() < until_ns:
                slow = spoilt(slow)
        return slow

    def begin_joint_control(self, first: JointCommand) -> None:
        """Begin, and count from here."""
        if self._rig is not None:
            self._rig.truth(reset_extremes=True)
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
        states = [state for state in super().receive(until_robot_ns, timeout_s) if self._arrives(state)]
        for until_ns, spoilt in self._spoilt:
            if self.robot_now_ns() < until_ns:
                states = [spoilt(state) for state in states]
        return states

    def power_off(self) -> None:
        """Note when."""
        self.power_off_ns = self.robot_now_ns()
        if self._rig is not None:
            if self._has_begun and self.truth is None:  # a second call finds the robot half-way down
                self.truth = self._rig.truth()
            self.was_off = self._rig.status().motor_power.lower().endswith("off")
        self._begins("down")
        super().power_off()

    def _until_ns(self, lasts_s: float) -> int:
        return self.robot_now_ns() + round(lasts_s * 1e9) if lasts_s else 1 << 62

    def _begins(self, when: When) -> None:
        if when == self._when:
            self._due_ns = self.robot_now_ns() + self._at_ns

    def _let_happen(self) -> None:
        if self._due_ns and not self.happened_ns and self.robot_now_ns() >= self._due_ns:
            self.happened_ns = self.robot_now_ns()
            self._happens(self)
        due = [planned for planned in self._planned if self.robot_now_ns() >= planned[0]]
        self._planned = [planned for planned in self._planned if planned not in due]
        for _, happens in due:
            happens()

    def _pause(self, duration_s: float) -> None:
        if self._when != "control":
            self._let_happen()
        super()._pause(duration_s)
