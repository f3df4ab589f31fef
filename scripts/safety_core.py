"""What the safety core is, and which tests judge it: one list for coverage, mutation and the documents."""

from __future__ import annotations

CORE = (
    "spot_runtime/safety.py",
    "spot_runtime/safety_limits.py",
    "spot_runtime/body_height.py",
    "spot_runtime/command_loss.py",
    "spot_runtime/modes.py",
    "spot_runtime/stops.py",
    "spot_runtime/watchdogs.py",
    "spot_runtime/handover.py",
    "spot_runtime/composer.py",
)

TESTS = (
    "tests/spot_runtime/test_core_bounds.py",
    "tests/spot_runtime/test_modes_and_stops.py",
    "tests/spot_runtime/test_command_loss.py",
    "tests/spot_runtime/test_safety.py",
    "tests/spot_runtime/test_watchdogs.py",
    "tests/spot_runtime/test_body_height.py",
    "tests/spot_runtime/test_handover.py",
    "tests/spot_runtime/test_composer.py",
)
