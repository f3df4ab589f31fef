"""How robot time passes: by itself, or only when asked. The rest of the adapter is the same for both."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from typing import Protocol

from spot_model.robot.state import RobotState
from spot_runtime.hal.spot.command_stream import CommandStream
from spot_runtime.hal.spot.jobs import Jobs
from spot_runtime.hal.spot.state_receiver import OnEnd, OnWire, StateQueue, take_all
from spot_runtime.host.clock import HostClock, RobotClockEstimate


class States(Protocol):
    """Something that brings states."""

    states: StateQueue

    def stop(self) -> None:
        """Stop bringing states."""


class Pace(Protocol):
    """What depends on how robot time passes."""

    def sync(self, round_trip: Callable[[], int]) -> int:
        """Compare the clocks, by ``round_trip`` or by a way of its own. Returns how far they are off, ns."""

    def start(self, jobs: Jobs) -> None:
        """Begin to run the chores."""

    def chore_now_s(self) -> float:
        """The clock by which chores are due."""

    def host_now_ns(self) -> int:
        """The host's clock."""

    def robot_now_ns(self) -> int:
        """The robot's clock."""

    def open_states(self, open_stream: Callable[[], States], on_wire: OnWire, on_end: OnEnd) -> States:
        """Begin to receive states: by ``open_stream``, or by a way of its own that tells the same two."""

    def pause(self, duration_s: float) -> None:
        """Let robot time pass while nothing is controlled."""

    def go_on(self, until_robot_ns: int, timeout_s: float) -> None:
        """Let time pass as :meth:`receive` will, which comes next; see :meth:`spot_runtime.hal.base.Hal.go_on`."""

    def finish_step(self) -> None:
        """Let no time be passing on account of :meth:`go_on`."""

    def receive(self, states: StateQueue, until_robot_ns: int, timeout_s: float) -> list[RobotState]:
        """States that have arrived, oldest first; see :meth:`spot_runtime.hal.base.Hal.receive`."""

    def begin(self, activate: Callable[[], None]) -> None:
        """Run ``activate`` once the first command is under way, without holding up the loop."""

    def opened(self, key: int) -> None:
        """Take note of the first command, with which the stream was opened."""

    def sender(self, stream: CommandStream) -> Callable[[int, bytes], None]:
        """What sends a command, given its key and wire bytes: the stream, or a way of its own."""

    def released(self) -> None:
        """Take note that nothing is sent any more."""

    def stop(self) -> None:
        """Stop the chores."""


class RealTime:
    """Robot time passes by itself; each chore has a thread of its own, so that a slow answer holds up no other."""

    def __init__(self, clock: HostClock, estimate: RobotClockEstimate) -> None:
        self._clock = clock
        self._estimate = estimate
        self._wake = threading.Event()
        self._threads: list[threading.Thread] = []

    def sync(self, round_trip: Callable[[], int]) -> int:
        """Ask the robot."""
        return round_trip()

    def start(self, jobs: Jobs) -> None:
        """Run the chores that come from now on."""

        def begin(name: str) -> None:
            self._threads.append(threading.Thread(target=self._run, args=(jobs, name), name=name, daemon=True))
            self._threads[-1].start()

        jobs.on_add = begin

    def chore_now_s(self) -> float:
        """The monotonic clock."""
        return time.monotonic()

    def host_now_ns(self) -> int:
        """The host's clock."""
        return self._clock.now_ns()

    def robot_now_ns(self) -> int:
        """The robot's clock, as estimated."""
        return self._estimate.robot_ns(self._clock.now_ns())

    def open_states(self, open_stream: Callable[[], States], on_wire: OnWire, on_end: OnEnd) -> States:
        """Open the stream, which tells them itself."""
        del on_wire, on_end
        return open_stream()

    def pause(self, duration_s: float) -> None:
        """Sleep."""
        time.sleep(duration_s)

    def go_on(self, until_robot_ns: int, timeout_s: float) -> None:
        """It does."""

    def finish_step(self) -> None:
        """There are no steps."""

    def receive(self, states: StateQueue, until_robot_ns: int, timeout_s: float) -> list[RobotState]:
        """Wait for a state, then take all that are there."""
        del until_robot_ns  # every state wakes the loop, so that it can be judged and answered
        try:
            first = states.get(timeout=timeout_s)
        except queue.Empty:
            return []
        return [] if first is None else [first, *take_all(states)]

    def begin(self, activate: Callable[[], None]) -> None:
        """In a thread of its own: the loop goes on sending meanwhile."""
        threading.Thread(target=activate, name="activation", daemon=True).start()

    def opened(self, key: int) -> None:
        """Nothing waits for it."""

    def sender(self, stream: CommandStream) -> Callable[[int, bytes], None]:
        """The stream."""
        return stream.put

    def released(self) -> None:
        """Nothing waits for it."""

    def stop(self) -> None:
        """End the threads."""
        self._wake.set()
        until_s = time.monotonic() + 5.0
        for thread in self._threads:
            thread.join(max(0.0, until_s - time.monotonic()))

    def _run(self, jobs: Jobs, name: str) -> None:
        while not self._wake.is_set():
            self._wake.wait(min(jobs.run_due(self.chore_now_s(), name), 0.2))
