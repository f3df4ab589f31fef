"""Run independent jobs in this process, in several, or on a Ray cluster, with the same results."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar

from typing_extensions import Self

from trainer.shared.ray_cluster import RayCluster

SharedT = TypeVar("SharedT")
JobT = TypeVar("JobT")
ResultT = TypeVar("ResultT")


@dataclass(frozen=True)
class Place:
    """Where to compute: ``workers`` processes on this machine, or a Ray cluster (the extra ``ray``)."""

    workers: int = 1
    ray: bool = False
    ray_address: str | None = None
    """Of a running cluster; None starts one on this machine."""
    is_apart: bool = False
    """Whether a single worker, too, is a process of its own; each has one thread, and none outlives this process."""


IN_THIS_PROCESS: Final = Place()
DIE_WITH_PARENT: Final = 1
"""PR_SET_PDEATHSIG."""
ONE_THREAD: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class Engine(Generic[SharedT, JobT, ResultT]):
    """Calls ``work(shared, job)`` for each job; used as a context manager.

    :meth:`map` does all jobs; :meth:`start`, :meth:`finished` and :meth:`result` take them one by one.

    Args:
        work: What is called; a function of a module, so that other processes find it.
        shared: What all jobs need; sent once to each process.
        place: Where to compute.
    """

    def __init__(
        self, work: Callable[[SharedT, JobT], ResultT], shared: SharedT, place: Place = IN_THIS_PROCESS
    ) -> None:
        self._work, self._shared, self.place = work, shared, place
        self._cluster = RayCluster(place.ray_address) if place.ray else None
        self._exit = ExitStack()
        self._pool: ProcessPoolExecutor | None = None
        self._task: Any = None

    def __enter__(self) -> Self:
        if self._cluster is not None:
            self._cluster.join()
            self._exit.callback(self._cluster.leave)
            kept = self._cluster.ray.put(self._shared)
            task = self._cluster.ray.remote(num_cpus=1)(self._work)
            self._task = lambda job: task.remote(kept, job)
        elif self.place.workers > 1 or self.place.is_apart:
            for name in ONE_THREAD if self.place.is_apart else ():
                os.environ.setdefault(name, "1")
            given = (self._work, self._shared, self.place.is_apart)
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(self.place.workers, context, _begin_worker, given)
            self._exit.callback(self._pool.shutdown, cancel_futures=True)
        return self

    def __exit__(self, error: object, *_: object) -> None:
        if error is not None and self.place.is_apart:
            for child in multiprocessing.active_children():
                child.kill()
        self._exit.close()

    @property
    def places(self) -> int:
        """How many jobs are done at once."""
        if self._cluster is not None:
            return max(1, int(self._cluster.ray.cluster_resources().get("CPU", 1)))
        return self.place.workers

    def start(self, job: JobT) -> Any:
        """Begin a job; returns its ticket. In this process, it is done when its result is asked for."""
        if self._cluster is not None:
            return self._task(job)
        return job if self._pool is None else self._pool.submit(_work_here, job)

    def finished(self, tickets: Sequence[Any], timeout_s: float) -> list[Any]:
        """Tickets whose jobs are done; waits for one, but no longer than this."""
        if self._cluster is not None:
            return list(self._cluster.ray.wait(list(tickets), num_returns=1, timeout=timeout_s)[0])
        return list(tickets[:1] if self._pool is None else wait(tickets, timeout_s, FIRST_COMPLETED).done)

    def result(self, ticket: Any) -> ResultT:
        """The result of a job, once it is done; raises what the job raised."""
        if self._pool is None and self._cluster is None:
            return self._work(self._shared, ticket)
        found: ResultT = ticket.result() if self._cluster is None else self._cluster.ray.get(ticket)
        return found

    def map(self, jobs: Sequence[JobT]) -> list[ResultT]:
        """Results in the order of the jobs; raises what a job raises."""
        return [self.result(ticket) for ticket in [self.start(job) for job in jobs]]

    def parts(self, n_items: int) -> int:
        """Into how many jobs ``n_items`` that one job can take together are best split."""
        return max(1, n_items if self.place.ray else min(n_items, self.place.workers))


_mine: tuple[Callable[[Any, Any], Any], Any] | None = None


def _begin_worker(work: Callable[[Any, Any], Any], shared: Any, is_apart: bool) -> None:
    global _mine  # noqa: PLW0603 - a worker process keeps what all jobs need for its whole life
    _mine = (work, shared)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to answer
    if is_apart:
        ctypes.CDLL(None).prctl(DIE_WITH_PARENT, signal.SIGKILL, 0, 0, 0)


def _work_here(job: Any) -> Any:
    if _mine is None:
        raise RuntimeError("the worker has nothing to do; Engine tells it when a worker starts")
    work, shared = _mine
    return work(shared, job)
