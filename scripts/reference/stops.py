"""docs/reference/stops.md: how a run ends, why none begins, and the exit codes of commands."""

from __future__ import annotations

import inspect

from fake_robot.start.process import FakeProcessError
from proof.loop_bench import BenchError
from spot_log.write.live_process import LiveViewError
from spot_model.errors import SpotRlError
from spot_rl.demo import DemoError
from spot_runtime.hal import errors
from spot_runtime.host.instance_lock import AlreadyRunningError, LockError
from spot_runtime.operator.listening import ListenError
from spot_runtime.rescue.lease_note import LeaseNoteError
from spot_runtime.rescue.make_safe import NotSafeError
from spot_runtime.stops import Reaction, StopReason
from spot_tools.client import RefusedError, UnreachableError
from trainer.collect.collect import CollectionError

from .words import page, table

COMMAND_ERRORS: tuple[type[SpotRlError], ...] = (
    CollectionError,
    FakeProcessError,
    BenchError,
    DemoError,
    LeaseNoteError,
    NotSafeError,
    AlreadyRunningError,
    RefusedError,
    UnreachableError,
    ListenError,
    LiveViewError,
    LockError,
)
ABOUT = """\
Every run ends with a *reason*: a name in its log and on the terminal, and an exit code. What the robot does then is its
*reaction*, one of [four](../runtime.md#stops): *hand back*, *damp*, *expire* and *e-stop*. After each, the motors are
powered off. [The fault table](../evidence/faults.md) shows how quickly each came.

All commands share these exit codes:

| exit code | meaning |
|---|---|
| 0 | done |
| 1 | a file or folder cannot be read or written, or a check found a fault |
| 2 | wrong usage or input, or a missing extra |
| 3 | a policy file is refused |
| 70 | a defect of this program |
| 130 | interrupted with Ctrl-C |"""

OUTCOMES = """\
Three outcomes have no exit code of their own.

- `power_off_failed`: the run ended normally, but the robot did not sit or kept its power. The code is that of the error
  above.
- `control_process_died`: `spot-rl serve` reports a control process that ended without a message, with its code.
- The outcome of a log that was not closed begins with `interrupted:`, or with `recovered:` after its recovery."""


def stops_page() -> str:
    """The page."""
    return page(
        "Stops and exit codes",
        ABOUT,
        [
            f"## Stops of a run\n\n{stops_table()}",
            f"## Refused runs\n\n{errors_table()}\n{OUTCOMES}",
            f"## Commands beside a run\n\n{codes_table()}",
        ],
    )


def stops_table() -> str:
    """Every reason for which a run ends."""
    rules = [(reason.label, reason.value) for reason in StopReason]
    words = {reaction: reaction.name.lower().replace("_", " ").replace("estop", "e-stop") for reaction in Reaction}
    return table(
        ("reason", "exit code", "meaning", "reaction", "next step"),
        [(f"`{n}`", str(r.exit_code), r.text, words[r.reaction], r.next_step or "–") for n, r in rules],
    )


def errors_table() -> str:
    """Every reason for which a run does not begin."""
    kinds = [kind for _, kind in inspect.getmembers(errors, inspect.isclass) if issubclass(kind, errors.HalError)]
    kinds.sort(key=lambda kind: kind.exit_code)
    rows = [(f"`{kind.label}`", str(kind.exit_code), (kind.__doc__ or "").strip()) for kind in kinds]
    return table(("reason", "exit code", "meaning"), rows)


def codes_table() -> str:
    """Every exit code with which a command ends that did not begin to drive a robot, or did not need to."""
    rows = {kind.exit_code: (kind.__doc__ or "").strip() for kind in COMMAND_ERRORS}
    return table(("exit code", "meaning"), [(str(code), rows[code]) for code in sorted(rows)])
