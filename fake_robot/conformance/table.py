"""All checks, and the table of them that stands in the documentation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from types import ModuleType

from fake_robot.conformance import answers, authority, commands, identity, joint_stream, measurements, memory, reports
from fake_robot.conformance.check import Basis, Check, Needs, Result, Verdict, judge
from fake_robot.conformance.server import Server


def _checks_of(module: ModuleType) -> list[Check]:
    found: list[Check] = []
    for value in vars(module).values():
        found += [item for item in (value if isinstance(value, tuple) else (value,)) if isinstance(item, Check)]
    return found


CHECKS: tuple[Check, ...] = tuple(
    item
    for module in (identity, authority, commands, joint_stream, reports, measurements, memory, answers)
    for item in _checks_of(module)
)


def run_checks(server: Server, allowed: Needs, names: tuple[str, ...] = ()) -> Iterator[Result]:
    """Each check's result, in the table's order; all checks, or those of ``names``."""
    for item in CHECKS:
        if not names or item.name in names:
            yield judge(item, server, allowed)


def has_failed(results: list[Result]) -> bool:
    """Whether the server broke a rule that is documented or measured."""
    return any(result.verdict is Verdict.FAIL for result in results)


def summary(results: list[Result]) -> str:
    """One line."""
    counts = Counter(result.verdict for result in results)
    return ", ".join(f"{counts[verdict]} {verdict.value}" for verdict in Verdict if counts[verdict])


def markdown() -> str:
    """The table as it stands in the documentation."""
    rows = ["| call and field | what is sent | right answer | how we know | switch |", "|---|---|---|---|---|"]
    for item in CHECKS:
        answer = " or ".join(f"`{expected}`" if expected.isupper() else expected for expected in item.expects)
        switch = f"`{item.switch}`" if item.switch else ""
        rows.append(f"| {item.rpc} | {item.sends} | {answer} | {item.basis.value}: {item.source} | {switch} |")
    counts = Counter(item.basis for item in CHECKS)
    told = ", ".join(f"{counts[basis]} {basis.value}" for basis in Basis)
    return "\n".join([*rows, "", f"{len(CHECKS)} checks: {told}.", ""])
