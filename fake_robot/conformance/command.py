"""``spot-rl fake-robot conformance``: all checks, run against a server, and the table of them for the documentation."""

from __future__ import annotations

import contextlib
import json
import os
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import typer
from bosdyn.client.exceptions import Error as SdkError
from bosdyn.client.robot import Robot
from bosdyn.client.sdk import Sdk, create_standard_sdk

from fake_robot.conformance import authority, commands, identity, laws, services
from fake_robot.conformance.check import Basis, CheckOutcome, ConformanceCheck, Needs, Result, judge
from fake_robot.conformance.power import CALL_ERRORS, cut_power, has_power
from fake_robot.conformance.server import CLIENT_NAME, RPC_TIMEOUT_S, Server
from spot_model.errors import BadInputError, SpotRlError
from spot_model.process.signals import exit_on_termination

BROKEN_CODE: Final = 1
OPEN_CODE: Final = 3
POWER_CODE: Final = 4
_COLOUR = {
    CheckOutcome.PASS: "green",
    CheckOutcome.FAIL: "red",
    CheckOutcome.DIFFERS: "yellow",
    CheckOutcome.OPEN: "yellow",
}
_HOST_AND_PORT = re.compile(r"(\[[^\]]+\]|[^:]+):(\d{1,5})")
_LOCAL = ("ipv4:127.", "unix:", "localhost", "127.")


CHECKS: tuple[ConformanceCheck, ...] = tuple(
    item
    for module in (identity, authority, services, laws, commands)
    for value in vars(module).values()
    for item in (value if isinstance(value, tuple) else (value,))
    if isinstance(item, ConformanceCheck)
)


def run_checks(server: Server, allowed: Needs, names: tuple[str, ...] = ()) -> Iterator[Result]:
    """Each check's result, in the table's order; all checks, or those of ``names``.

    The motors are looked at before the first check and after each. If they have power that they had not, it is taken
    away, the check has failed, and no other is made.
    """
    server.may_move = allowed >= Needs.MOTION
    had_power = _has_power(server)
    gained = ""
    for item in CHECKS:
        if names and item.name not in names:
            continue
        if gained:
            yield Result(item, CheckOutcome.OPEN, f"nothing more is sent to a robot that got power by {gained}")
            continue
        result = judge(item, server, allowed)
        if result.verdict is not CheckOutcome.SKIPPED and not had_power and _has_power(server):
            gained = item.name
            told = f"{result.seen}; the motors got power: {cut_power(server)}"
            result = Result(item, CheckOutcome.FAIL, told, gave_power=True)
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
    if not verdicts - {CheckOutcome.SKIPPED}:
        return OPEN_CODE
    return BROKEN_CODE if CheckOutcome.FAIL in verdicts else OPEN_CODE if CheckOutcome.OPEN in verdicts else 0


def summary(results: list[Result]) -> str:
    """Counts, then what follows from them, in one sentence each."""
    counts = Counter(result.verdict for result in results)
    told = [", ".join(f"{counts[verdict]} {verdict.value}" for verdict in CheckOutcome if counts[verdict]) + "."]
    reasons = Counter(r.seen for r in results if r.verdict in {CheckOutcome.OPEN, CheckOutcome.SKIPPED})
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


class UnreachableError(SpotRlError):
    """The server cannot be reached, or does not let us in."""


def run_suite(
    robot: str, *, is_attended: bool, with_motion: bool, ca_file: Path | None, names: tuple[str, ...], as_json: bool
) -> int:
    """Run the checks and print their table; returns the exit code, as of :func:`exit_code`.

    Raises:
        BadInputError: The host may be a real robot, and nobody said that they stand beside it.
        UnreachableError: The server cannot be reached.
    """
    if not robot.startswith(_LOCAL) and not is_attended:
        raise BadInputError(
            f"{robot} may be a real robot; stand beside it with its e-stop in your hand, then add --i-stand-beside-it"
        )
    unknown = set(names) - {item.name for item in CHECKS}
    if unknown:
        raise BadInputError(
            f"there is no check {', '.join(sorted(unknown))}; checks: {', '.join(item.name for item in CHECKS)}"
        )
    server = connect(robot, ca_file)
    results: list[Result] = []
    with exit_on_termination():  # a robot that has power sits down first
        for result in run_checks(server, Needs.MOTION if with_motion else Needs.LEASE, names):
            results.append(result)
            if not as_json:
                typer.secho(line_of(result), fg=_COLOUR.get(result.verdict))
    typer.echo(json.dumps([to_data(r) for r in results], indent=2, ensure_ascii=False) if as_json else summary(results))
    return exit_code(results)


def connect(robot: str, ca_file: Path | None) -> Server:
    """Log in with ``BOSDYN_CLIENT_USERNAME`` and ``BOSDYN_CLIENT_PASSWORD``.

    Raises:
        BadInputError: The variables are not set.
        UnreachableError: The server cannot be reached, or refuses the login.
    """
    username, password = os.environ.get("BOSDYN_CLIENT_USERNAME"), os.environ.get("BOSDYN_CLIENT_PASSWORD")
    if not username or not password:
        raise BadInputError("set BOSDYN_CLIENT_USERNAME and BOSDYN_CLIENT_PASSWORD to the robot's login")
    trusted = ca_file or (Path(os.environ["SPOT_RL_CA_FILE"]) if "SPOT_RL_CA_FILE" in os.environ else None)
    sdk = create_standard_sdk(CLIENT_NAME, cert_resource_glob=None if trusted is None else str(trusted))
    try:
        known = _robot_at(sdk, robot)
        known.authenticate(username, password, timeout=RPC_TIMEOUT_S)
        another = create_standard_sdk(CLIENT_NAME, cert_resource_glob=None if trusted is None else str(trusted))
        stranger = _robot_at(another, robot)
    except SdkError as error:
        what = str(error) or type(error).__name__
        raise UnreachableError(f"{robot}: {what}; check the address, the login, and --ca-file") from error
    return Server(known, stranger)


def _robot_at(sdk: Sdk, address: str) -> Robot:
    """The SDK's robot; the SDK itself takes a host alone, and nothing that says its port."""
    found = _HOST_AND_PORT.fullmatch(address)
    robot = sdk.create_robot(found[1] if found else address)
    if found:
        robot.update_secure_channel_port(int(found[2]))
    return robot


def line_of(result: Result) -> str:
    """A result on one line, for pipes and logs."""
    item = result.check
    is_wrong = result.verdict in {CheckOutcome.FAIL, CheckOutcome.DIFFERS}
    wanted = f"; expected {' or '.join(item.expects)}" if is_wrong else ""
    return f"{result.verdict.value:8}{item.name}: {item.rpc} ({item.sends or 'asked'}): {result.seen}{wanted}"


def to_data(result: Result) -> dict[str, str | list[str]]:
    """A result for JSON."""
    item = result.check
    return {
        "name": item.name,
        "verdict": result.verdict.value,
        "call": item.rpc,
        "sends": item.sends,
        "expects": list(item.expects),
        "seen": result.seen,
        "basis": item.basis.value,
        "source": item.source,
    }
