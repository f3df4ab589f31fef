"""Try every row of the fault matrix on a fake robot."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Annotated, Final

import typer
from rich.console import Console
from rich.table import Table

from proof.faults import rows_link, rows_log, rows_measured, rows_phases, rows_policy, rows_process, rows_robot
from proof.faults.rows import Result, Row, tidy, try_row
from proof.faults.search import search_cases
from proof.rig import rig
from spot_model.console.command_registry import AsJson, PolicyFile, ScenarioName
from spot_model.console.progress import Progress
from spot_model.errors import BadInputError
from spot_model.policy.built_in import WALK
from spot_model.policy.policy import load_policy
from spot_model.process.signals import exit_on_termination

ROWS: Final[tuple[Row, ...]] = (
    *rows_link.ROWS,
    *rows_measured.ROWS,
    *rows_robot.ROWS,
    *rows_policy.ROWS,
    *rows_process.ROWS,
    *rows_log.ROWS,
    *rows_phases.ROWS,
    *rows_measured.SIGNAL_ROWS,
    *rows_robot.ALONE,
)
EXIT_FAILED: Final = 1


def faults(
    as_json: AsJson = False,
    real_time: Annotated[bool, typer.Option("--real-time", help="Only the rows about time, in real time.")] = False,
    only: Annotated[str, typer.Option(help="Only rows whose name contains this.")] = "",
    quick: Annotated[bool, typer.Option("--quick", help="Skip the rows that take minutes.")] = False,
    policy: PolicyFile = WALK,
    scenario: ScenarioName = "default",
    search: Annotated[bool, typer.Option("--search", help="Inject random faults instead.")] = False,
    minutes: Annotated[float, typer.Option(min=0.1, help="How long to search.")] = 60.0,
    seed: Annotated[int, typer.Option(min=0, help="Random seed of the search.")] = 0,
) -> None:
    """Inject every fault of the fault table into a fake robot in lock-step, and check the reaction."""
    load_policy(policy)
    if search:
        raise typer.Exit(EXIT_FAILED if search_and_tell(seed, minutes, policy, scenario, as_json) else 0)
    rows = chosen(only, is_real_time=real_time, is_quick=quick)
    results: list[Result] = []
    with Progress("rows", len(rows)) as progress:
        for result in try_rows(rows, policy, scenario, is_real_time=real_time):
            results.append(result)
            mark, words = "ok " if result.ok else "BAD", "; ".join(result.problems)
            progress.update(len(results), f"{mark} {result.fault}: {result.reaction} {words}", is_told=True)
    failed = sum(not result.ok for result in results)
    if as_json:
        typer.echo(json.dumps({"rows": [result.to_json() for result in results], "failed": failed}, ensure_ascii=False))
    else:
        Console().print(table(results))
        typer.echo(f"{len(results)} rows, {failed} failed")
    raise typer.Exit(EXIT_FAILED if failed else 0)


def search_and_tell(seed: int, minutes: float, policy: Path, scenario: str, as_json: bool) -> int:
    """Search, and tell of each case. Returns how many broke a law."""
    began_s, count, bad = time.monotonic(), 0, []
    with tempfile.TemporaryDirectory(prefix="spot-rl-search-") as folder:
        for verdict in search_cases(seed, minutes, policy, Path(folder), scenario):
            count += 1
            left_min = max(0.0, minutes - (time.monotonic() - began_s) / 60.0)
            mark, words = ("BAD", "; ".join(verdict.problems)) if verdict.problems else ("ok ", verdict.sentence)
            told = f"{count} {mark} {verdict.case.words} -> {verdict.outcome}: {words} ({left_min:.0f} min left)"
            typer.echo(told, err=True)
            if verdict.problems:
                bad.append(verdict)
                typer.echo(f"  case {verdict.case.to_json()}", err=True)
    if as_json:
        found = [{"case": verdict.case.to_json(), "problems": verdict.problems} for verdict in bad]
        typer.echo(json.dumps({"seed": seed, "minutes": minutes, "cases": count, "found": found}, ensure_ascii=False))
    else:
        typer.echo(f"{count} cases from seed {seed} in {minutes:g} min, {len(bad)} broke a law")
    return len(bad)


def chosen(only: str, *, is_real_time: bool, is_quick: bool) -> list[Row]:
    """The rows that were asked for.

    Raises:
        BadInputError: There is none.
    """
    rows = [row for row in ROWS if only in row.fault and (row.is_real_time or not is_real_time)]
    rows = [row for row in rows if not (is_quick and row.is_long)]
    if not rows:
        raise BadInputError(f"no row's name holds {only!r}; rows: {', '.join(row.fault for row in ROWS)}")
    return rows


def try_rows(rows: Iterable[Row], policy: Path, scenario: str, *, is_real_time: bool) -> Iterator[Result]:
    """Try rows in turn on one robot; a row that has failed, or wants a robot to itself, leaves the next a new one."""
    left = list(rows)
    while left:
        with (
            exit_on_termination(),
            tempfile.TemporaryDirectory(prefix="spot-rl-faults-") as folder,
            rig(Path(folder), policy, is_lock_step=not is_real_time, scenario=scenario) as robot,
        ):
            is_good = True
            while left and is_good:
                row = left.pop(0)
                result = tidy(robot, row, try_row(robot, row))
                is_good = result.ok and not row.is_alone and not (left and left[0].is_alone)
                yield result


def table(results: Iterable[Result]) -> Table:
    """For a person."""
    shown = Table("fault", "reaction", "ms", "bound ms", "body min m", "peak N·m", "log", "ok")
    for result in results:
        shown.add_row(
            result.fault,
            result.reaction,
            _number(result.reaction_ms),
            _number(result.bound_ms),
            _number(result.body_height_min_m),
            _number(result.peak_torque_nm),
            "whole" if result.log_ok else "BAD",
            "ok" if result.ok else "BAD",
        )
    return shown


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:g}"
