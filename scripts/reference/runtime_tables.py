"""The tables within docs/runtime.md: stops of a run, reasons for which none begins, bounds of the safety core."""

from __future__ import annotations

import ast
import inspect
import itertools
from collections.abc import Iterator
from types import ModuleType

from fake_robot.start.process import FakeProcessError
from proof.demo import DemoError
from proof.loop_bench import BenchError
from spot_log.write.live_process import LiveViewError
from spot_model.errors import SpotRlError
from spot_runtime.control.safety import battery, states
from spot_runtime.control.safety.signals import bounds
from spot_runtime.hal import errors
from spot_runtime.host.instance_lock import AlreadyRunningError, LockError
from spot_runtime.operator.listening import ListenError
from spot_runtime.rescue.lease_note import LeaseNoteError
from spot_runtime.rescue.make_safe import NotSafeError
from spot_runtime.safety_limits import SafetyLimits
from spot_runtime.stops import StopReason
from spot_tools.client import RefusedError, UnreachableError
from trainer.collect.collect import CollectionError

from .words import plain, table

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
MARKER = "written by scripts/write_docs.py"


def runtime_page(text: str) -> str:
    """The page with its tables as they should be now, between the markers of each."""
    tables = {
        "stops": stops_table(),
        "errors": errors_table(),
        "codes": codes_table(),
        "limits": limits_table(),
        "bounds": bounds_table(),
    }
    for name, made in tables.items():
        begin, end = f"<!-- {name}: {MARKER} -->", f"<!-- end of {name} -->"
        head, _, rest = text.partition(begin)
        tail = rest.partition(end)[2]
        text = f"{head}{begin}\n\n{made}\n{end}{tail}"
    return text


def stops_table() -> str:
    """Every reason for which a run ends."""
    rules = [(reason.label, reason.value) for reason in StopReason]
    return table(
        ("reason", "exit code", "meaning", "reaction", "next step"),
        [(f"`{n}`", str(r.exit_code), r.text, r.reaction.value, r.next_step or "–") for n, r in rules],
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


def limits_table() -> str:
    """Every bound of the safety core with its default."""
    rows = []
    for name, field in SafetyLimits.model_fields.items():
        default = f"{field.default:g}" if isinstance(field.default, (int, float)) else f"{field.default}"
        rows.append((f"`{name}`", default, field.description or ""))
    return table(("key", "default", "meaning"), rows)


def bounds_table() -> str:
    """Every constant of the plausibility checks with its derivation."""
    rows = [row for module in (bounds, states, battery) for row in _constants(module)]
    return table(("bound", "value", "derivation"), rows)


def _constants(module: ModuleType) -> Iterator[tuple[str, str, str]]:
    """A module's public constants with the strings that stand below them."""
    body = ast.parse(inspect.getsource(module)).body
    for statement, following in itertools.pairwise([*body, ast.Pass()]):
        if not (isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name)):
            continue
        name, text = statement.target.id, ""
        if name.startswith("_"):
            continue
        if isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant):
            text = plain(str(following.value.value))
        value = getattr(module, name)
        words = " to ".join(f"{v:g}" for v in value) if isinstance(value, tuple) else f"{value:g}"
        yield f"`{name}`", words, text or "–"
