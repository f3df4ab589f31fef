"""Where candidates are evaluated: in this process, in several, or on a Ray cluster; the numbers are the same bits."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from types import TracebackType
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from typing_extensions import Self

from trainer.ppo.ray_cluster import RayCluster
from trainer.sysid.search.problem import CandidateResult, Problem

Array = NDArray[np.float64]


class Engine(Protocol):
    """Evaluates candidates; used as a context manager."""

    def evaluate(self, values: Array) -> list[CandidateResult]:
        """Results of candidates, shape (k, n_parameters), in their order."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class LocalEngine:
    """Evaluates in this process (one worker) or in several."""

    def __init__(self, problem: Problem, workers: int = 1) -> None:
        self._problem = problem
        self._workers = workers
        self._pool: ProcessPoolExecutor | None = None

    def __enter__(self) -> Self:
        if self._workers > 1:
            self._pool = ProcessPoolExecutor(
                self._workers, multiprocessing.get_context("spawn"), _set_problem, (self._problem,)
            )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)

    def evaluate(self, values: Array) -> list[CandidateResult]:
        """Results in order."""
        if self._pool is None:
            return self._problem.evaluate(values)
        parts = self._pool.map(_evaluate_here, _chunks(values, self._workers))
        return [result for part in parts for result in part]


class RayEngine:
    """Evaluates one candidate a task on a Ray cluster (the extra ``ray``): the running one, or one on this machine."""

    def __init__(self, problem: Problem, address: str | None = None) -> None:
        self._cluster = RayCluster(address)
        self._ray = self._cluster.ray
        self._problem = problem
        self._shared: Any = None
        self._task: Any = None

    def __enter__(self) -> Self:
        self._cluster.join()
        self._shared = self._ray.put(self._problem)
        self._task = self._ray.remote(num_cpus=1)(_evaluate_one)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._cluster.leave()

    def evaluate(self, values: Array) -> list[CandidateResult]:
        """Results in order."""
        results: list[CandidateResult] = self._ray.get([self._task.remote(self._shared, v) for v in values])
        return results


_problem: Problem | None = None


def _set_problem(problem: Problem) -> None:
    global _problem  # noqa: PLW0603 - a worker process keeps its problem for its whole life
    _problem = problem


def _evaluate_here(values: Array) -> list[CandidateResult]:
    if _problem is None:
        raise RuntimeError("the worker has no problem; LocalEngine sets it when a worker starts")
    return _problem.evaluate(values)


def _evaluate_one(problem: Problem, values: Array) -> CandidateResult:
    return problem.evaluate(values[None, :])[0]


def _chunks(values: Array, n: int) -> Iterable[Array]:
    return [part for part in np.array_split(values, n) if len(part)]
