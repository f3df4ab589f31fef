"""Compute independent jobs in this process, in several, or on a Ray cluster, with the same results bit for bit.

Also the options by which commands name such a place.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Any, Final, Generic, TypeVar

import typer
from typing_extensions import Self

from spot_model.errors import BadInputError, SpotRlError


def available_threads() -> int:
    """One for each CPU, or as few as ``OMP_NUM_THREADS`` says: on shared CPUs, threads wait for each other."""
    available, wanted = len(os.sched_getaffinity(0)), os.environ.get("OMP_NUM_THREADS", "")
    return min(available, int(wanted)) if wanted.isdecimal() and int(wanted) else available


SharedT = TypeVar("SharedT")
JobT = TypeVar("JobT")
ResultT = TypeVar("ResultT")
Tell = Callable[[float], None]
"""Called now and then with the share that is done, 0 to 1."""


class EngineError(SpotRlError):
    """Jobs cannot be computed where they were sent."""


@dataclass(frozen=True)
class Place:
    """Where to compute: ``workers`` processes on this machine, or a Ray cluster (the extra ``ray``)."""

    workers: int = 1
    ray: bool = False
    ray_address: str | None = None
    """Address of a running cluster; None takes the one that runs on this machine, or else starts one."""
    device: str = "cpu"
    """What simulates: "cpu", or a GPU ("cuda", "cuda:N"), which one process alone uses."""
    is_apart: bool = False
    """Whether a single worker, too, is a process of its own; each has one thread, and none outlives this process."""

    def __post_init__(self) -> None:
        """Refuse a GPU beside processes or a cluster: one process fills it."""
        if self.device != "cpu" and (self.workers > 1 or self.ray):
            raise BadInputError(
                f"device {self.device!r} with {'engine ray' if self.ray else f'{self.workers} workers'}: one process "
                "fills a GPU; allowed: one worker, without Ray"
            )


IN_THIS_PROCESS: Final = Place()
RETRIES: Final = 3
"""How often Ray begins a job again whose process or machine died."""
POLL_S: Final = 0.5
"""Time between two messages about progress."""
DIE_WITH_PARENT: Final = 1
"""PR_SET_PDEATHSIG."""
ONE_THREAD: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def ignore(_: float) -> None:
    """A :data:`Tell` that tells nobody."""


class Engine(Generic[SharedT, JobT, ResultT]):
    """Calls ``work(shared, job, tell)`` for each job; used as a context manager.

    :meth:`map` does all jobs; :meth:`start`, :meth:`finished` and :meth:`result` take them one by one. What a job
    raises is raised here, and the job is not tried again. A job whose process or machine dies is begun again on Ray,
    :data:`RETRIES` times; so work must be a pure function, or leave the same files when it runs twice.

    Args:
        work: What is called; a function of a module, so that other processes find it.
        shared: What all jobs need; sent once to each process, or to each machine of a cluster.
        place: Where to compute.

    Raises:
        EngineError: Ray is not installed.
    """

    def __init__(
        self, work: Callable[[SharedT, JobT, Tell], ResultT], shared: SharedT, place: Place = IN_THIS_PROCESS
    ) -> None:
        self._work, self._shared, self.place = work, shared, place
        self._ray = _import_ray() if place.ray else None
        self._exit = ExitStack()
        self._pool: ProcessPoolExecutor | None = None
        self._task: Any = None
        self._shares: Sequence[float] = ()

    def __enter__(self) -> Self:
        """Start the processes, or connect to the cluster. Raises EngineError: there is no cluster at the address."""
        workers, is_apart = self.place.workers, self.place.is_apart
        if self._ray is not None:
            if not self._ray.is_initialized():
                _join_cluster(self._ray, self.place.ray_address)
                self._exit.callback(self._ray.shutdown)
            given = self._ray.put((self._work, self._shared))
            task = self._ray.remote(num_cpus=1, max_retries=RETRIES, retry_exceptions=False)(_work_on_cluster)
            self._task = lambda job: task.remote(given, job)
        elif workers > 1 or is_apart:
            for name in ONE_THREAD if is_apart else ():
                os.environ.setdefault(name, "1")
            context = multiprocessing.get_context("spawn")
            self._shares = context.RawArray("d", workers)
            given = (self._work, self._shared, self._shares, context.Value("i", 0), is_apart)
            self._pool = ProcessPoolExecutor(workers, context, _begin_worker, given)
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
        if self._ray is not None:
            return max(1, int(self._ray.cluster_resources().get("CPU", 1)))
        return self.place.workers

    def start(self, job: JobT) -> Any:
        """Begin a job; returns its ticket. In this process, it is done when its result is asked for."""
        if self._task is not None:
            return self._task(job)
        return job if self._pool is None else self._pool.submit(_work_here, job)

    def finished(self, tickets: Sequence[Any], timeout_s: float) -> list[Any]:
        """Tickets whose jobs are done; waits for one, but no longer than this."""
        if self._ray is not None:
            return list(self._ray.wait(list(tickets), num_returns=1, timeout=timeout_s)[0])
        return list(tickets[:1] if self._pool is None else wait(tickets, timeout_s, FIRST_COMPLETED).done)

    def result(self, ticket: Any) -> ResultT:
        """The result of a job, once it is done.

        Raises:
            EngineError: The job's process died; on a cluster more often than :data:`RETRIES` times.
            Exception: What the job raised.
        """
        try:
            if self._ray is not None:
                return self._ray.get(ticket)  # type: ignore[no-any-return]
            if self._pool is not None:
                return ticket.result()  # type: ignore[no-any-return]
        except BrokenProcessPool as error:
            raise EngineError("a worker process died: killed, or out of memory; give fewer --workers") from error
        except Exception as error:
            if self._ray is None or not isinstance(error, self._ray.exceptions.RayError):
                raise
            if isinstance(error, self._ray.exceptions.RayTaskError):
                # Ray's own message is the remote traceback; what the job raised has the words for the user.
                raise error.cause from error
            raise EngineError(f"engine ray: a job is lost: {str(error).splitlines()[0]}") from error
        return self._work(self._shared, ticket, ignore)

    def map(self, jobs: Sequence[JobT], tell: Tell = ignore) -> list[ResultT]:
        """Results in the order of the jobs; raises what :meth:`result` raises as soon as one job fails.

        Args:
            jobs: What to do.
            tell: Called with the share of all jobs that is done, on a cluster in steps of one job.
        """
        if self._pool is None and self._ray is None:
            return [self._work(self._shared, job, _part_of(tell, i, len(jobs))) for i, job in enumerate(jobs)]
        tickets = [self.start(job) for job in jobs]
        results: dict[Any, ResultT] = {}
        while len(results) < len(tickets):
            waiting = [ticket for ticket in tickets if ticket not in results]
            results.update((ticket, self.result(ticket)) for ticket in self.finished(waiting, POLL_S))
            tell(min(1.0, (len(results) + sum(self._shares)) / len(tickets)))
        return [results[ticket] for ticket in tickets]

    def parts(self, n_items: int) -> int:
        """Into how many jobs ``n_items`` that one job can take together are best split."""
        return max(1, min(n_items, self.places))


def _part_of(tell: Tell, i: int, n: int) -> Tell:
    return lambda share: tell((i + share) / n)


def _import_ray() -> Any:
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing is reported to Ray's makers
    try:
        import ray
    except ModuleNotFoundError as error:
        raise EngineError("engine ray: Ray is not installed; install the extra: pip install 'spot-rl[ray]'") from error
    return ray


def _join_cluster(ray: Any, address: str | None) -> None:
    try:
        ray.init(address=address, include_dashboard=False, log_to_driver=False)
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise EngineError(
            f"engine ray: no cluster at {address or 'this machine'}: {error}; start one with 'ray start --head' and, "
            "if it has a token, set RAY_AUTH_MODE=token and RAY_AUTH_TOKEN, or leave --ray-address out"
        ) from error


def _work_on_cluster(given: tuple[Callable[[Any, Any, Tell], Any], Any], job: Any) -> Any:
    work, shared = given
    return work(shared, job, ignore)


_mine: tuple[Callable[[Any, Any, Tell], Any], Any, Tell] | None = None


def _begin_worker(work: Callable[..., Any], shared: Any, shares: Any, number: Any, is_apart: bool) -> None:
    global _mine  # noqa: PLW0603 - a worker process keeps what all jobs need for its whole life
    with number.get_lock():
        mine = number.value
        number.value += 1

    def tell(share: float) -> None:
        shares[mine] = share

    _mine = (work, shared, tell)
    os.environ["OMP_NUM_THREADS"] = str(max(1, available_threads() // len(shares)))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to answer
    if is_apart:
        ctypes.CDLL(None).prctl(DIE_WITH_PARENT, signal.SIGKILL, 0, 0, 0)


def _work_here(job: Any) -> Any:
    if _mine is None:
        raise RuntimeError("the worker has nothing to do; Engine tells it when a worker starts")
    work, shared, tell = _mine
    try:
        return work(shared, job, tell)
    finally:
        tell(0.0)


def check_device(device: str) -> None:
    """Refuse a device that is not there. Raises BadInputError: no such device; the message says what there is."""
    if device == "cpu":
        return
    import torch

    if not device.startswith("cuda"):
        raise BadInputError(f"device {device!r} is unknown; allowed: cpu, cuda, cuda:N")
    if not torch.cuda.is_available():
        raise BadInputError(
            f"device {device!r}: there is no usable NVIDIA GPU here (torch {torch.__version__}); "
            "use --device cpu, or a machine with a GPU and a CUDA build of torch"
        )
    index = torch.device(device).index or 0
    if index >= torch.cuda.device_count():
        raise BadInputError(f"device {device!r}: there are {torch.cuda.device_count()} GPUs, cuda:0 upwards")


class EngineName(str, Enum):
    """Kinds of :class:`~trainer.simulate.engine.Place`."""

    LOCAL = "local"
    RAY = "ray"


Workers = Annotated[int, typer.Option("--workers", min=1, max=1024, help="Processes; the result is the same.")]
EngineOption = Annotated[
    EngineName, typer.Option("--engine", help="Where to compute: processes on this machine, or a Ray cluster.")
]
Device = Annotated[
    str,
    typer.Option(
        "--device", help="Where to simulate: cpu, or cuda for an NVIDIA GPU, for which one process is enough."
    ),
]
RayAddress = Annotated[
    str | None, typer.Option("--ray-address", help="A running Ray cluster; by default one is started here.")
]


def place_of(workers: int, engine: EngineName, ray_address: str | None, device: str) -> Place:
    """The place that these options name.

    Raises:
        BadInputError: The device does not exist, or does not go with the engine.
    """
    check_device(device)
    return Place(workers if device == "cpu" else 1, engine is EngineName.RAY, ray_address, device)
