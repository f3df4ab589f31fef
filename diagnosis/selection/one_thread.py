"""Many small matrices: threads that share one wait for each other longer than they compute."""

from __future__ import annotations

from contextlib import AbstractContextManager

from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]


def one_thread() -> AbstractContextManager[object]:
    """Within it, linear algebra runs on one thread: five times as fast here on a busy machine."""
    limits: AbstractContextManager[object] = threadpool_limits(1)
    return limits
