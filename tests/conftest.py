"""For all tests: no deadlines, for computers are busy, and long files first, so that none is left at the end."""

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

LONG = (
    "spot_runtime/faults/test_matrix.py",
    "docs/test_docs.py",
    "fake_robot/test_sdk_programs.py",
    "spot_runtime/operator/test_serve.py",
    "spot_rl/test_tour.py",
    "test_on_ray.py",
    "spot_runtime/operator/test_operated_run.py",
    "spot_runtime/test_on_the_fake_robot.py",
    "spot_runtime/operator/test_stop_gets_through.py",
    "fake_robot/test_conformance.py",
    "diagnosis/test_stranger.py",
    "diagnosis/test_library.py",
    "spot_runtime/operator/test_guardian.py",
    "spot_runtime/operator/test_make_safe.py",
    "spot_runtime/faults/test_invariants.py",
    "fake_robot/body/test_cut.py",
    "spot_runtime/test_bench_and_demo.py",
    "spot_rl/test_api.py",
    "docs/test_in_a_clone.py",
    "docs/test_apart.py",
    "withheld/test_end_to_end.py",
    "deploy/test_install.py",
    "docs/test_installing.py",
    "trainer/test_training.py",
    "trainer/sysid/test_search.py",
)
"""By the time that they took, the longest first; the rest are short, and fill what is left."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    places = {name: place for place, name in enumerate(LONG)}

    def place(item: pytest.Item) -> int:
        return next((at for name, at in places.items() if item.path.as_posix().endswith(f"tests/{name}")), len(LONG))

    items.sort(key=place)  # within a file the order stays
