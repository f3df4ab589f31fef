"""Check what a first run needs."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer

from spot_model.console.command_registry import AsJson, OptionalPolicyFile
from spot_tools.checks import CheckResult, Finding, is_fit
from spot_tools.options import CaFile, ConfigFile, CredentialsFile, resolve_config

_COLOUR = {CheckResult.OK: "green", CheckResult.WARN: "yellow", CheckResult.FAIL: "red", CheckResult.SKIPPED: None}


def doctor(
    robot: Annotated[list[str] | None, typer.Option(help="Address of a robot to look at; repeatable.")] = None,
    policy: OptionalPolicyFile = None,
    config: ConfigFile = None,
    ca_file: CaFile = None,
    credentials_file: CredentialsFile = None,
    log_dir: Annotated[Path | None, typer.Option(help="Folder of the logs.")] = None,
    as_json: AsJson = False,
) -> None:
    """Check what a run needs, on this computer and on the robot, without moving, powering or claiming it.

    Exit code 1 if a check failed.
    """
    from spot_tools.computer_checks import Host, checks_of_computer
    from spot_tools.robot_checks import RobotDoctor

    settings = resolve_config(config, ca_file=ca_file, credentials_file=credentials_file, log_dir=log_dir)
    findings = [check.make() for check in checks_of_computer(Host(), settings, policy)]
    for address in robot or []:
        with closing(RobotDoctor(address, settings)) as patient:
            findings += [check.make() for check in patient.checks()]
    if as_json:
        data = {"fit": is_fit(findings), "checks": [finding.to_data() for finding in findings]}
        typer.echo(json.dumps(data, indent=2, ensure_ascii=False))
    else:
        for finding in findings:
            typer.secho(line_of(finding), fg=_COLOUR[finding.verdict])
    if not is_fit(findings):
        raise typer.Exit(1)


def line_of(finding: Finding) -> str:
    """A finding on one line."""
    advice = f"; {finding.advice}" if finding.advice else ""
    return f"{finding.verdict.value:<8} {finding.name}: {finding.found}{advice}"
