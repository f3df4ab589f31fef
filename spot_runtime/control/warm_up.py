"""Waiting for the state of a policy tick so that the tick finds warm caches and a processor that is awake.

Repeated without a pause a tick takes a fifth of what it takes at the real pace: between two ticks caches and branch
predictors are filled with other work, and the processor falls asleep. So shortly before such a state can come the tick
is taken once for nothing, on the newest state; then the loop polls for the state and does not sleep. Each poll gives
the processor and the interpreter's lock away, so that the state is received as soon as it would be otherwise.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Final

from spot_model.robot import facts
from spot_model.robot.facts import NS_PER_S
from spot_model.robot.state import RobotState
from spot_runtime.hal.base import Hal
from spot_runtime.host.realtime import has_real_time_priority, let_others_run

LEAD_NS: Final = 1_000_000
"""How long before the state can come the dry run begins, or as late as half of this. On a slow computer with cold
caches it takes 0.5 to 0.8 ms."""

AWAKE_NS: Final = 2_500_000
"""No more polling this long after the dry run began, so that a state that never comes costs little."""

JUDGED: Final = 50
"""After this many dry runs in a row, each longer than :data:`LEAD_NS`, dry runs end: they delay the tick."""

ARRIVALS: Final = 64


class Arrivals:
    """When a state may come, judged by those that came."""

    def __init__(self) -> None:
        self._host_minus_robot_ns: deque[int] = deque(maxlen=ARRIVALS)

    def add(self, state: RobotState) -> None:
        """A state has come."""
        self._host_minus_robot_ns.append(state.host_stamp_ns - state.robot_stamp_ns)

    def earliest_host_ns(self, robot_stamp_ns: int) -> int | None:
        """When a state with this stamp will arrive if it is as quick as the quickest recent one; None before any."""
        return robot_stamp_ns + min(self._host_minus_robot_ns) if self._host_minus_robot_ns else None


class WarmReceiver:
    """Receives the state of a tick after a dry run of it."""

    def __init__(self, hal: Hal, *, may_poll: bool | None = None) -> None:
        """Receive from ``hal``; poll by default only with a real-time priority, without which nothing is gained."""
        self._hal = hal
        self._may_poll = has_real_time_priority() if may_poll is None else may_poll
        self._took_ns: deque[int] = deque(maxlen=JUDGED)
        self.arrivals = Arrivals()

    @property
    def _helps(self) -> bool:
        """Whether a dry run is over before the state comes; that of a slow policy, or on a slow computer, is not."""
        return len(self._took_ns) < JUDGED or min(self._took_ns) <= LEAD_NS

    def receive(
        self, newest: RobotState, until_robot_ns: int, timeout_s: float, dry_run: Callable[[], None]
    ) -> list[RobotState]:
        """Like :meth:`Hal.receive`, for the state after ``newest``; calls ``dry_run`` where there is time for it."""
        hal, begin_ns = self._hal, self._hal.host_now_ns()
        end_ns = begin_ns + round(timeout_s * NS_PER_S)
        earliest_ns = self.arrivals.earliest_host_ns(newest.robot_stamp_ns + facts.STATE_PERIOD_NS)
        if earliest_ns is None or not self._helps or not begin_ns + LEAD_NS // 2 <= earliest_ns < end_ns + LEAD_NS:
            return hal.receive(until_robot_ns, timeout_s)
        states = hal.receive(until_robot_ns, max(0, earliest_ns - LEAD_NS - begin_ns) / NS_PER_S)
        if states:
            return states
        began_ns = hal.host_now_ns()
        dry_run()
        self._took_ns.append(hal.host_now_ns() - began_ns)
        awake_until_ns = min(end_ns, began_ns + AWAKE_NS)
        while self._may_poll and hal.host_now_ns() < awake_until_ns:
            states = hal.receive(until_robot_ns, 0.0)
            if states:
                return states
            let_others_run()
        return hal.receive(until_robot_ns, max(0.0, (end_ns - hal.host_now_ns()) / NS_PER_S))
