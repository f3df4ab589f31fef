"""How robot time passes: by itself, or only when asked. The rest of the adapter is the same for both."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from spot_model.robot.state import RobotState
from spot_runtime.hal.spot.command_stream import CommandStream
from spot_runtime.hal.spot.state_receiver import OnEnd, OnWire, StateQueue, take_all
from spot_runtime.host.clock import HostClock, RobotClockEstimate


@dataclass
class Job:
    """A chore and when it is due next."""

    name: str
    period_s: float
    run: Callable[[], None]
    due_s: float = 0.0


class Jobs:
    """Runs chores that are due. Time is whatever the caller passes: the host's clock, or lock-step's robot time."""

    def __init__(self, on_error: Callable[[str, Exception], None]) -> None:
        """An exception of a chore goes to ``on_error`` with the chore's name; the chore stays."""
        self._jobs: list[Job] = []
        self._on_error = on_error
        self._lock = threading.Lock()
        self.on_add: Callable[[str], None] = lambda _: None
        """Told of the name of each chore that is taken."""

    def add(self, name: str, period_s: float, run: Callable[[], None], *, now_s: float) -> None:
        """Take a chore; it is due a period from now."""
        with self._lock:
            self._jobs.append(Job(name, period_s, run, now_s + period_s))
        self.on_add(name)

    def remove(self, name: str) -> None:
        """Drop a chore; an unknown name is ignored, since it may have been dropped before."""
        with self._lock:
            self._jobs = [job for job in self._jobs if job.name != name]

    def run_due(self, now_s: float, name: str = "") -> float:
        """Run what is due, each chore once; only the one of this name, if there is one.

        Returns:
            Seconds until the next one is due; 1 where there is none.
        """
        with self._lock:
            jobs = [job for job in self._jobs if name in ("", job.name)]
        due = [job for job in jobs if job.due_s <= now_s]
        for job in due:
            job.due_s = now_s + job.period_s
            try:
                job.run()
            except Exception as error:  # noqa: BLE001 - one failing chore must not end the others
                self._on_error(job.name, error)
        return min((max(0.0, job.due_s - now_s) for job in jobs), default=1.0)


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
