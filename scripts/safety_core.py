"""What the safety core is, and which tests judge each file of it: one list for coverage, mutation and the documents."""

from __future__ import annotations

_BOUNDS = "tests/spot_runtime/test_core_bounds.py"
_SIGNAL_BOUNDS = "tests/spot_runtime/test_signal_bounds.py"
_CAUSES = "tests/spot_runtime/test_causes.py"
_MODES = "tests/spot_runtime/test_modes_and_stops.py"
_SET_POINT = "tests/spot_runtime/test_set_point.py"

_SIGNALS = (_SIGNAL_BOUNDS, "tests/spot_runtime/test_signal_memories.py", "tests/spot_runtime/test_signals.py")
_ANSWERS = "tests/spot_runtime/test_answers.py"
_HOLD = "tests/spot_runtime/test_hold.py"
_STANCE = "tests/spot_runtime/test_stance.py"
_WIRING = "tests/spot_runtime/test_wiring.py"

_SAFETY = "tests/spot_runtime/test_safety.py"
_WATCHDOGS = "tests/spot_runtime/test_watchdogs.py"
_HANDOVER = "tests/spot_runtime/test_handover.py"

TESTS_OF = {
    **{f"spot_runtime/control/safety/{name}.py": (_BOUNDS, _SIGNAL_BOUNDS, _SAFETY) for name in ("states", "commands")},
    "spot_runtime/safety_limits.py": (_BOUNDS,),
    "spot_runtime/control/safety/battery.py": (_BOUNDS, _SIGNAL_BOUNDS, _WATCHDOGS, _SAFETY),
    "spot_runtime/control/safety/body_height.py": ("tests/spot_runtime/test_body_height.py", _BOUNDS),
    "spot_runtime/control/safety/watchdogs.py": (
        _WATCHDOGS,
        "tests/spot_runtime/test_command_loss.py",
        _BOUNDS,
        _SIGNAL_BOUNDS,
    ),
    **{f"spot_runtime/control/safety/signals/{name}.py": _SIGNALS for name in ("ground", "motion", "still", "window")},
    "spot_runtime/control/safety/signals/legs.py": (_STANCE, _WIRING, *_SIGNALS),
    "spot_runtime/control/safety/signals/wiring.py": (_WIRING, _STANCE),
    "spot_runtime/control/safety/signals/readers.py": ("tests/spot_runtime/test_readers.py",),
    "spot_runtime/control/safety/signals/answer.py": (_ANSWERS, _HOLD, *_SIGNALS),
    "spot_runtime/control/safety/signals/check.py": (*_SIGNALS, _ANSWERS, _HOLD, _STANCE, _WIRING),
    "spot_runtime/control/modes.py": (_MODES, _BOUNDS),
    "spot_runtime/stops.py": (_MODES, _BOUNDS, _CAUSES),
    "spot_runtime/control/set_point.py": (_SET_POINT, _HANDOVER, _BOUNDS),
}
"""Each file with the tests that must notice every change of it."""

CORE = tuple(TESTS_OF)
TESTS = tuple(dict.fromkeys(test for tests in TESTS_OF.values() for test in tests))
