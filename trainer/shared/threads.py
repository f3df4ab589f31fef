"""How many threads a computation may use."""

from __future__ import annotations

import os


def available_threads() -> int:
    """One for each CPU, or as few as ``OMP_NUM_THREADS`` says: on shared CPUs, threads wait for each other."""
    available, wanted = len(os.sched_getaffinity(0)), os.environ.get("OMP_NUM_THREADS", "")
    return min(available, int(wanted)) if wanted.isdecimal() and int(wanted) else available
