"""Scores of a run: ``scores.json``, the page beside it, and the lines for a terminal."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from spot_model.errors import BadInputError
from spot_model.io.whole import write_over
from withheld.blind.run_folder import PAGE, SCORES
from withheld.scoring.page import page
from withheld.scoring.reading import Cases, read_cases
from withheld.scoring.table import breakdown, table

SCHEMA: Final = "spot-rl/withheld-scores/4"


def write_scores(folders: Sequence[Path], out: Path) -> list[str]:
    """Score and write; returns the lines for a terminal.

    Raises:
        BadInputError: The folders cannot be scored together.
    """
    cases = read_cases(folders)
    data = scores(cases)
    write_over(out / SCORES, json.dumps(data, indent=1) + "\n")
    write_over(out / PAGE, page(data, cases, out))
    return [*lines(data), f"page {out / PAGE}  table {out / SCORES}"]


def scores(cases: Cases) -> dict[str, Any]:
    """Everything as data; the same outcomes give the same bytes."""
    outcomes, head = cases.outcomes, cases.head
    seconds = [sum(o.seconds.values()) for o in outcomes]
    stages = sorted({s for o in outcomes for s in o.seconds})
    return {
        "schema": SCHEMA,
        **head.model_dump(exclude={"schema_name", "cases", "part"}),
        "cases": len(outcomes),
        "asked_cases": head.cases,
        "core_seconds_a_case": {"mean": float(np.mean(seconds)), "most": float(np.max(seconds))},
        "core_seconds_by_stage": {s: float(np.mean([o.seconds.get(s, 0.0) for o in outcomes])) for s in stages},
        "table": [row.to_data() for row in table(outcomes)],
        "breakdown": {cut: {v: s.to_data() for v, s in of.items()} for cut, of in breakdown(outcomes).items()},
    }


def lines(data: Mapping[str, Any]) -> list[str]:
    """The table for a terminal."""
    made = [f"{data['cases']} of {data['asked_cases']} cases, revision {data['revision']}, seed {data['seed']}"]
    for row in data["table"]:
        if row["trials"]:
            asked = f"; asked: {row['asked']}: {row['met'].upper()}" if row["asked"] else ""
            made.append(f"  {row['title']}: {row['text']}{asked}")
    return made


def markdown(folder: Path, beside: Path | None = None) -> list[str]:
    """A scored run's table as Markdown, with the same figures of another run's ``scores.json`` beside it.

    Raises:
        BadInputError: The folder was not scored, or there is no such file.
    """
    file = folder / SCORES
    if not file.is_file():
        raise BadInputError(f"{file} is not there; score first: `spot-rl withheld score {folder}`")
    data = json.loads(file.read_text(encoding="utf-8"))
    head = (
        f"{data['cases']} of {data['asked_cases']} cases, seed {data['seed']} "
        f"({'drawn by the operating system' if data['is_seed_drawn'] else 'given'}), revision `{data['revision']}`, "
        f"digest `{data['digest'][:16]}`; {data['core_seconds_a_case']['mean']:.0f} core-seconds a case."
    )
    made = [head, "", "| figure | asked | measured (cases; 95 % interval) | |", "|---|---|---|---|"]
    others: dict[str, str] = {}
    if beside is not None:
        if not beside.is_file():
            raise BadInputError(f"{beside} is not there; --beside takes the {SCORES} of another run")
        other = json.loads(beside.read_text(encoding="utf-8"))
        made[2] += f" {other['cases']} cases of another run, seed {other['seed']} |"
        made[3] += "---|"
        others = {r["key"]: r["text"] for r in other["table"] if r["trials"]}
    for row in data["table"]:
        if row["trials"]:
            cells = [row["title"], row["asked"], row["text"], row["met"]]
            cells += [others.get(row["key"], "")] if beside is not None else []
            made.append(f"| {' | '.join(cells)} |")
    return made
