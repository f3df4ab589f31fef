"""What a control process asks of the operating system; what is refused is said once, with what to grant."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import gc
import os
import sys
from pathlib import Path
from typing import Final

from spot_runtime.config import RealTimeConfig

_MCL_CURRENT: Final = 1
_MCL_FUTURE: Final = 2
_MCL_ONFAULT: Final = 4
"""Lock pages once they are touched, so that the unused part of each thread's stack costs nothing."""


def apply_real_time(config: RealTimeConfig) -> list[str]:
    """Ask for everything that the configuration wants. Call it before any thread or channel exists.

    Returns:
        One sentence for each refusal, with what to grant; empty when all is granted.
    """
    refusals = []
    if config.fifo_priority:
        refusals += _scheduler(config.fifo_priority)
    if config.cpu_affinity:
        refusals += _affinity(config.cpu_affinity)
    if config.lock_memory:
        refusals += _lock_memory()
    sys.setswitchinterval(config.switch_interval_s)
    return refusals


def freeze_garbage_collection(config: RealTimeConfig) -> None:
    """Collect once, then never again: call it when everything is loaded, before motion."""
    if config.freeze_garbage_collection:
        gc.collect()
        gc.freeze()
        gc.disable()


def let_others_run() -> None:
    """Give the processor, and the interpreter's lock, to any other thread of our real-time priority that can go on.

    Threads of one real-time priority take turns only when they wait, and ours share one lock. Without such a priority
    nothing is done: yielding would let in whatever else the computer does.
    """
    if has_real_time_priority():
        os.sched_yield()


def has_real_time_priority() -> bool:
    """Whether this thread runs under SCHED_FIFO."""
    return os.sched_getscheduler(0) == os.SCHED_FIFO


def _scheduler(priority: int) -> list[str]:
    """Ask for the priority for every thread that there is; later ones inherit it.

    One that was left behind, the console's for instance, would stall all others: on a busy computer it is put aside for
    tens of milliseconds, with the interpreter's lock in its hands.
    """
    try:
        for thread in Path("/proc/self/task").iterdir():
            _prefer(int(thread.name), priority)
    except OSError as error:
        grant = f"grant it with 'LimitRTPRIO={priority}' in the unit, or CAP_SYS_NICE"
        return [f"SCHED_FIFO {priority} was refused ({error.strerror}): {grant}"]
    return []


def _prefer(thread: int, priority: int) -> None:
    with contextlib.suppress(ProcessLookupError):  # it has ended meanwhile
        os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(priority))


def _affinity(cpus: tuple[int, ...]) -> list[str]:
    try:
        os.sched_setaffinity(0, cpus)
    except OSError as error:
        there = sorted(os.sched_getaffinity(0))
        return [f"CPUs {list(cpus)} were refused ({error.strerror}): this process may use {there}"]
    return []


def _lock_memory() -> list[str]:
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT) == 0:
        return []
    number = ctypes.get_errno()
    name = errno.errorcode.get(number, str(number))
    return [f"locking memory was refused ({name}): grant it with 'LimitMEMLOCK=infinity' in the unit, or CAP_IPC_LOCK"]
