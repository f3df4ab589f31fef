"""Whatever a run, a service or a command ends with stands in the reference of stops."""

from __future__ import annotations

import ast
from pathlib import Path

from spot_runtime.hal.errors import HalError
from spot_runtime.stops import StopReason

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "reference" / "stops.md").read_text(encoding="utf-8")
PACKAGES = ("spot_runtime", "spot_log", "spot_tools")


def nodes() -> tuple[ast.Call | ast.ClassDef, ...]:
    """Calls and classes of all files that make an outcome or declare an exit code."""
    paths = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
    texts = [path.read_text(encoding="utf-8") for path in paths]
    trees = [ast.parse(text) for text in texts if "Outcome(" in text or "exit_code" in text]
    return tuple(node for tree in trees for node in ast.walk(tree) if isinstance(node, (ast.Call, ast.ClassDef)))


def written_outcomes() -> set[str]:
    """Labels that are written out where an outcome is made, or prefixed to one."""
    found = set()
    for node in nodes():
        if isinstance(node, ast.Call) and getattr(node.func, "id", getattr(node.func, "attr", "")) == "Outcome":
            given = [*node.args[:1], *(k.value for k in node.keywords if k.arg in ("label", "outcome"))]
            found |= {value.value for value in given if isinstance(value, ast.Constant)}
    return found - {""}


def exit_codes() -> set[int]:
    """Codes that classes of errors declare; 1 to 3 and 70 stand in the sentence above the tables."""
    declared = (node for node in nodes() if isinstance(node, ast.ClassDef))
    assignments = (line for node in declared for line in node.body if isinstance(line, ast.Assign))
    return {
        line.value.value
        for line in assignments
        if getattr(line.targets[0], "id", "") == "exit_code" and isinstance(line.value, ast.Constant)
    }


def test_outcomes_are_found_in_the_code() -> None:
    """So that the tests below cannot pass by finding nothing."""
    assert {"power_off_failed", "control_process_died"} <= written_outcomes()
    assert {78, 79, 80, 91, 94, 95, 96, 97, 98, 99} <= exit_codes()


def test_every_stop_and_every_refusal_has_its_row() -> None:
    kinds = (*StopReason, HalError, *HalError.__subclasses__())
    assert not [kind for kind in kinds if f"| `{kind.label}` | {kind.exit_code} |" not in PAGE]


def test_every_outcome_and_every_exit_code_that_is_written_out_is_explained() -> None:
    assert not {label for label in written_outcomes() if f"`{label}`" not in PAGE}
    assert not {code for code in exit_codes() - {1, 2, 3, 70} if f"| {code} |" not in PAGE}
