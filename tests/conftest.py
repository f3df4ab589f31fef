"""For all tests: no deadlines, for computers are busy, and slow ones first, so that none is left at the end."""

from __future__ import annotations

import os
import signal

# Before numerical libraries are imported: their threads would share the cores with robots, and wait for each other.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import pytest
from hypothesis import HealthCheck, settings

# Hypothesis allows an example 200 ms by default; the same examples in every run, so that a failure can be had again.
settings.register_profile("any_computer", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any_computer")

# A shell has what it runs in the background ignore a terminal's keys, and whatever a test starts inherits that.
for key in (signal.SIGINT, signal.SIGQUIT):
    if signal.getsignal(key) is signal.SIG_IGN:
        signal.signal(key, signal.default_int_handler if key is signal.SIGINT else signal.SIG_DFL)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)  # within a file the order stays
