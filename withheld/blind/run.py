"""Many cases on many cores or machines: each independent, done once, kept when a run is interrupted."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

from trainer.shared.ray_cluster import RayCluster
from withheld.blind.execute import Job, case_folder, execute
from withheld.blind.ledger import Ledger, read_ledger
from withheld.outcome import Outcome

DIE_WITH_PARENT = 1
"""PR_SET_PDEATHSIG."""
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class Engine(Protocol):
    """Runs cases side by side."""

    @property
    def places(self) -> int:
        """How many at once."""
        ...

    def start(self, job: Job) -> Any:
        """Begin a case; returns its ticket."""
        ...

    def finished(self, tickets: Sequence[Any], timeout_s: float) -> list[Any]:
        """Tickets that are done; waits for one."""
        ...

    def outcome(self, ticket: Any) -> Outcome:
        """Of a finished one; raises what the case raised."""
        ...


class Processes:
    """Cases in processes of this machine."""

    def __init__(self, pool: ProcessPoolExecutor, places: int) -> None:
        """Use a pool."""
        self._pool, self.places = pool, places

    def start(self, job: Job) -> Future[Outcome]:
        """Begin a case."""
        return self._pool.submit(execute, job)

    def finished(self, tickets: Sequence[Future[Outcome]], timeout_s: float) -> list[Future[Outcome]]:
        """Done ones."""
        return list(wait(tickets, timeout_s, FIRST_COMPLETED).done)

    def outcome(self, ticket: Future[Outcome]) -> Outcome:
        """Its outcome."""
        return ticket.result()


@contextmanager
def processes(workers: int) -> Iterator[Processes]:
    """A pool of fresh interpreters, one thread each; none of them, nor what it started, outlives this process."""
    for name in ONE_THREAD:
        os.environ.setdefault(name, "1")
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), die_with_parent)
    try:
        yield Processes(pool, workers)
    except BaseException:
        for child in multiprocessing.active_children():
            child.kill()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def die_with_parent() -> None:
    """For a worker: an interrupt is the parent's business, and so is when to end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    ctypes.CDLL(None).prctl(DIE_WITH_PARENT, signal.SIGKILL, 0, 0, 0)


class Ray:
    """Cases as tasks of a Ray cluster that shares the run's folder."""

    def __init__(self, address: str | None, work: Callable[[Job], Outcome] = execute) -> None:
        """Connect, or start a cluster on this machine."""
        self._cluster = RayCluster(address)
        self._cluster.join()
        self._ray = self._cluster.ray
        self.places = max(1, int(self._ray.cluster_resources().get("CPU", 1)))
        self._task: Any = self._ray.remote(num_cpus=1)(work)

    def start(self, job: Job) -> Any:
        """Begin a case."""
        return self._task.remote(job)

    def finished(self, tickets: Sequence[Any], timeout_s: float) -> list[Any]:
        """Done ones."""
        done: list[Any] = self._ray.wait(list(tickets), num_returns=1, timeout=timeout_s)[0]
        return done

    def outcome(self, ticket: Any) -> Outcome:
        """Its outcome."""
        made: Outcome = self._ray.get(ticket)
        return made

    def close(self) -> None:
        """Leave the cluster."""
        self._cluster.leave()


def run_cases(
    jobs: Sequence[Job], engine: Engine, out: Path, until_s: float, on_done: Callable[[int, str], None]
) -> int:
    """Run cases that are not there yet; returns how many are left.

    After ``until_s`` none is begun; those in the making are finished. A case that fails for a reason of its own is told
    of and left for ``--resume``.

    Args:
        jobs: All cases.
        engine: Where they run.
        out: The run's folder.
        until_s: Seconds from now.
        on_done: Called with number and text of each case that ends.
    """
    ledger = Ledger(out / "ledger.jsonl")
    end_s = time.monotonic() + until_s
    waiting = [job for job in jobs if not (case_folder(out, job.number) / "outcome.json").exists()]
    waiting.reverse()
    running: dict[Any, Job] = {}
    failed = 0
    while waiting or running:
        while waiting and len(running) < engine.places and time.monotonic() < end_s:
            job = waiting.pop()
            running[engine.start(job)] = job
        if not running:
            break
        for ticket in engine.finished(list(running), 10.0):
            job = running.pop(ticket)
            try:
                outcome = engine.outcome(ticket)
            except (BrokenProcessPool, KeyboardInterrupt):
                raise
            except Exception as error:  # noqa: BLE001 - one broken case must not end three hundred
                failed += 1
                on_done(job.number, f"failed: {type(error).__name__}: {error}")
                continue
            last = read_ledger(case_folder(out, job.number) / "ledger.jsonl")[-1]
            ledger.add("case", case=job.number, ledger=last.hash, seal=outcome.seal, verdict=outcome.verdict_sha256)
            on_done(job.number, f"{outcome.status}, {sum(outcome.seconds.values()):.0f} s")
    return len(waiting) + failed
