"""Robot time on the host's clock: one thread on an absolute schedule, which catches up and never spirals."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from fake_robot.body.clock import RobotClock
from fake_robot.robot.simulation import Simulation

_LOGGER = logging.getLogger(__name__)


class RealTimeLoop:
    """Lets robot time follow the clock.

    The thread wakes when the next state is to be sampled and when the next message reaches the client, whichever comes
    first. The simulation is never ahead of the clock, so every command that has arrived by then is known. After a
    stall it runs as fast as it can; what is more than ``max_catch_up_s`` behind is taken off the robot's clock.
    """

    def __init__(
        self,
        simulation: Simulation,
        clock: RobotClock,
        lock: threading.Condition,
        *,
        max_catch_up_s: float,
        on_crash: Callable[[], None],
    ) -> None:
        self._simulation, self._clock, self._lock = simulation, clock, lock
        self._max_catch_up_ns = round(max_catch_up_s * 1e9)
        self._is_stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="fake-robot-time", daemon=True)
        self.crash: BaseException | None = None
        """What ended the thread against its will."""
        self._on_crash = on_crash
        self.lost_ns = 0
        """Robot time given up after stalls."""

    def start(self) -> None:
        """Begin."""
        self._clock.run()
        self._thread.start()

    def stop(self) -> None:
        """End, and wait for the thread."""
        self._is_stopping.set()
        if self._thread.is_alive() and threading.current_thread() is not self._thread:
            self._thread.join()
        self._clock.halt()
        if self.lost_ns:
            _LOGGER.warning("in all, %.2f s of robot time were lost", self.lost_ns * 1e-9)

    def _run(self) -> None:
        try:
            while not self._is_stopping.is_set():
                self.wake()
        except BaseException as error:
            self.crash = error
            self._on_crash()
            raise

    def wake(self) -> None:
        """Wait for what is due next, though not for long, and do it."""
        simulation, clock = self._simulation, self._clock
        due_ns = simulation.next_state_ns
        arrival_ns = simulation.next_arrival_ns
        if arrival_ns is not None and arrival_ns < due_ns:
            due_ns = arrival_ns
        wait_s = clock.host_seconds_until(due_ns)
        if wait_s > 0.0:
            time.sleep(min(wait_s, 0.003))
        now_ns = clock.elapsed_ns()
        if now_ns < due_ns:
            return
        self._note(now_ns - due_ns)
        now_ns = clock.elapsed_ns()
        with self._lock:
            simulation.advance_to(min(now_ns, due_ns))
            simulation.deliver_states(now_ns)

    def _note(self, late_ns: int) -> None:
        if late_ns > self._max_catch_up_ns:
            lost_ns = late_ns - self._max_catch_up_ns
            if not self.lost_ns:
                _LOGGER.warning(
                    "this computer is too slow or too busy for real time: %.0f ms of robot time are lost, and more may "
                    "be; the total is told at the end. Use --lock-step, or stop other work",
                    lost_ns * 1e-6,
                )
            self.lost_ns += lost_ns
            self._clock.slip(lost_ns)
