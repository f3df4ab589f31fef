"""Check what a first run needs."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from spot_tools.doctor.check import Result, Verdict, is_fit, make
from spot_tools.doctor.computer import checks_of_computer
from spot_tools.doctor.host import Host
from spot_tools.doctor.robot import RobotDoctor
from spot_tools.options import CaFile, ConfigFile, CredentialsFile, resolve_config

_COLOUR = {Verdict.OK: "green", Verdict.WARN: "yellow", Verdict.FAIL: "bold red", Verdict.SKIPPED: "dim"}


def doctor(
    robot: Annotated[list[str] | None, typer.Option(help="Address of a robot to look at; repeatable.")] = None,
    policy: Annotated[Path | None, typer.Option(help="ONNX file to check.")] = None,
    config: ConfigFile = None,
    ca_file: CaFile = None,
    credentials_file: CredentialsFile = None,
    log_dir: Annotated[Path | None, typer.Option(help="Folder of the logs.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Check what a run needs, on this computer and on the robot, without moving, powering or claiming it.

    Exit code 1 if a check failed.
    """
    settings = resolve_config(config, ca_file=ca_file, credentials_file=credentials_file, log_dir=log_dir)
    results = [make(check) for check in checks_of_computer(Host(), settings, policy)]
    for address in robot or []:
        patient = RobotDoctor(address, settings)
        try:
            results += [make(check) for check in patient.checks()]
        finally:
            patient.close()
    if as_json:
        data = {"fit": is_fit(results), "checks": [result.to_data() for result in results]}
        typer.echo(json.dumps(data, indent=2, ensure_ascii=False))
    elif sys.stdout.isatty():
        Console().print(table_of(results))
    else:
        for result in results:
            typer.echo(line_of(result))
    if not is_fit(results):
        raise typer.Exit(1)


def line_of(result: Result) -> str:
    """A result on one line, for pipes and journals."""
    advice = f"; {result.advice}" if result.advice else ""
    return f"{result.verdict.value:<8} {result.name}: {result.found}{advice}"


def table_of(results: list[Result]) -> Table:
    """All results as a table for a terminal."""
    table = Table("check", "", "found", "what to do", show_lines=False)
    for result in results:
        colour = _COLOUR[result.verdict]
        table.add_row(result.name, Text(result.verdict.value, style=colour), Text(result.found), Text(result.advice))
    return table
