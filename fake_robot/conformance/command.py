"""``spot-rl fake-robot conformance``: hold a server to the protos."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import typer
from bosdyn.client.exceptions import Error as SdkError
from bosdyn.client.robot import Robot
from bosdyn.client.sdk import Sdk, create_standard_sdk

from fake_robot.conformance.check import Needs, Result, Verdict
from fake_robot.conformance.server import CLIENT_NAME, RPC_TIMEOUT_S, Server
from fake_robot.conformance.table import CHECKS, exit_code, run_checks, summary
from spot_model.errors import BadInputError, SpotRlError
from spot_model.process.signals import exit_on_termination

_COLOUR = {Verdict.PASS: "green", Verdict.FAIL: "red", Verdict.DIFFERS: "yellow", Verdict.OPEN: "yellow"}
_HOST_AND_PORT = re.compile(r"(\[[^\]]+\]|[^:]+):(\d{1,5})")
_LOCAL = ("ipv4:127.", "unix:", "localhost", "127.")


class UnreachableError(SpotRlError):
    """The server cannot be reached, or does not let us in."""


def run_suite(
    robot: str, *, is_attended: bool, with_motion: bool, ca_file: Path | None, names: tuple[str, ...], as_json: bool
) -> int:
    """Run the checks and print their table; returns the exit code, as of :func:`table.exit_code`.

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
    is_wrong = result.verdict in {Verdict.FAIL, Verdict.DIFFERS}
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
