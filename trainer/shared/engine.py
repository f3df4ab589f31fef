"""Run independent jobs in this process, in several, or on a Ray cluster, with the same results."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
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


IN_THIS_PROCESS: Final = Place()


class Engine(Generic[SharedT, JobT, ResultT]):
    """Calls ``work(shared, job)`` for each job; used as a context manager.

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
        elif self.place.workers > 1:
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(self.place.workers, context, _begin_worker, (self._work, self._shared))
            self._exit.callback(self._pool.shutdown, cancel_futures=True)
        return self

    def __exit__(self, *_: object) -> None:
        self._exit.close()

    def map(self, jobs: Sequence[JobT]) -> list[ResultT]:
        """Results in the order of the jobs; raises what a job raises."""
        if self._cluster is not None:
            results: list[ResultT] = self._cluster.ray.get([self._task(job) for job in jobs])
            return results
        if self._pool is not None:
            return list(self._pool.map(_work_here, jobs))
        return [self._work(self._shared, job) for job in jobs]

    def parts(self, n_items: int) -> int:
        """Into how many jobs ``n_items`` that one job can take together are best split."""
        return max(1, n_items if self.place.ray else min(n_items, self.place.workers))


_mine: tuple[Callable[[Any, Any], Any], Any] | None = None


def _begin_worker(work: Callable[[Any, Any], Any], shared: Any) -> None:
    global _mine  # noqa: PLW0603 - a worker process keeps what all jobs need for its whole life
    _mine = (work, shared)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to answer


def _work_here(job: Any) -> Any:
    if _mine is None:
        raise RuntimeError("the worker has nothing to do; Engine tells it when a worker starts")
    work, shared = _mine
    return work(shared, job)
