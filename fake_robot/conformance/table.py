"""All checks, and the table of them that stands in the documentation."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterator
from typing import Final

from fake_robot.conformance import authority, commands, identity, joint_stream, laws, requests, services
from fake_robot.conformance.check import Basis, Check, Needs, Result, Verdict, judge
from fake_robot.conformance.power import CALL_ERRORS, cut_power, has_power
from fake_robot.conformance.server import Server

BROKEN_CODE: Final = 1
OPEN_CODE: Final = 3
POWER_CODE: Final = 4


CHECKS: tuple[Check, ...] = tuple(
    item
    for module in (identity, authority, requests, services, laws, joint_stream, commands)
    for value in vars(module).values()
    for item in (value if isinstance(value, tuple) else (value,))
    if isinstance(item, Check)
)


def run_checks(server: Server, allowed: Needs, names: tuple[str, ...] = ()) -> Iterator[Result]:
    """Each check's result, in the table's order; all checks, or those of ``names``.

    The motors are looked at before the first check and after each. If they have power that they had not, it is taken
    away, the check has failed, and no other is made.
    """
    had_power = _has_power(server)
    gained = ""
    for item in CHECKS:
        if names and item.name not in names:
            continue
        if gained:
            yield Result(item, Verdict.OPEN, f"nothing more is sent to a robot that got power by {gained}")
            continue
        result = judge(item, server, allowed)
        if result.verdict is not Verdict.SKIPPED and not had_power and _has_power(server):
            gained = item.name
            told = f"{result.seen}; the motors got power: {cut_power(server)}"
            result = Result(item, Verdict.FAIL, told, gave_power=True)
        yield result


def _has_power(server: Server) -> bool:
    with contextlib.suppress(*CALL_ERRORS):
        return has_power(server.state())
    return False


def exit_code(results: list[Result]) -> int:
    """4 if motors had power that they should not, 1 if a rule is broken, 3 if one could not be judged, else 0."""
    if any(result.gave_power for result in results):
        return POWER_CODE
    verdicts = {result.verdict for result in results}
    if not verdicts - {Verdict.SKIPPED}:
        return OPEN_CODE
    return BROKEN_CODE if Verdict.FAIL in verdicts else OPEN_CODE if Verdict.OPEN in verdicts else 0


def summary(results: list[Result]) -> str:
    """Counts, then what follows from them, in one sentence each."""
    counts = Counter(result.verdict for result in results)
    told = [", ".join(f"{counts[verdict]} {verdict.value}" for verdict in Verdict if counts[verdict]) + "."]
    reasons = Counter(r.seen for r in results if r.verdict in {Verdict.OPEN, Verdict.SKIPPED})
    told += [f"{count} not judged: {reason}." for reason, count in reasons.most_common()]
    told.append(
        {
            POWER_CODE: "Motors had power that they should not have had: see the line of the check.",
            BROKEN_CODE: "The server does not conform.",
            OPEN_CODE: "Whether the server conforms is not known: not all that was asked for could be judged.",
        }.get(exit_code(results), "No rule is broken in what was judged.")
    )
    return "\n".join(told)


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
