"""Scores of a run: ``scores.json``, the page beside it, and the lines for a terminal."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from spot_model.errors import BadInputError
from spot_model.io.whole import write_over
from withheld.scoring.leak import leaks
from withheld.scoring.page import page
from withheld.scoring.table import breakdown, table
from withheld.scoring.verify import Checked, check

SCHEMA: Final = "spot-rl/withheld-scores/3"
SCORES: Final = "scores.json"
PAGE: Final = "scores.html"


def write_scores(folders: Sequence[Path], out: Path) -> list[str]:
    """Check, score and write; returns the lines for a terminal.

    Raises:
        SpotRlError: The folders cannot be scored together, or something was changed.
    """
    checked = check(folders, Path("policies"))
    data = scores(checked)
    write_over(out / SCORES, json.dumps(data, indent=1) + "\n")
    write_over(out / PAGE, page(data, checked, out))
    return [*lines(data), f"page {out / PAGE}  table {out / SCORES}"]


def scores(checked: Checked) -> dict[str, Any]:
    """Everything as data; the same outcomes give the same bytes."""
    outcomes, head = checked.outcomes, checked.head
    seconds = [sum(o.seconds.values()) for o in outcomes]
    stages = sorted({s for o in outcomes for s in o.seconds})
    return {
        "schema": SCHEMA,
        "protocol": head.protocol,
        "generator": head.generator,
        "policies": head.policies,
        "reality": head.reality,
        "versions": head.versions,
        "seed": checked.seed,
        "seed_digest": head.seed_digest,
        "locked_in": list(checked.locked_in),
        "cases": len(outcomes),
        "asked_cases": head.cases,
        "is_quick": head.is_quick,
        "core_seconds_a_case": {"mean": float(np.mean(seconds)), "most": float(np.max(seconds))},
        "core_seconds_by_stage": {s: float(np.mean([o.seconds.get(s, 0.0) for o in outcomes])) for s in stages},
        "table": [row.to_data() for row in table(outcomes)],
        "breakdown": {cut: {v: s.to_data() for v, s in of.items()} for cut, of in breakdown(outcomes).items()},
        "metadata_alone": [asdict(leak) for leak in leaks(outcomes)],
    }


def lines(data: Mapping[str, Any]) -> list[str]:
    """The table for a terminal."""
    made = [f"{data['cases']} of {data['asked_cases']} cases, protocol {data['protocol'][:16]}, seed {data['seed']}"]
    for row in data["table"]:
        if row["trials"]:
            asked = f"; asked: {row['asked']}: {row['met'].upper()}" if row["asked"] else ""
            made.append(f"  {row['title']}: {row['text']}{asked}")
    made += [f"  {leak}" for leak in map(_leak, data["metadata_alone"])]
    return made


def markdown(folder: Path) -> list[str]:
    """A scored run's table as Markdown.

    Raises:
        BadInputError: The folder was not scored.
    """
    file = folder / SCORES
    if not file.is_file():
        raise BadInputError(f"{file} is not there; score first: `spot-rl withheld score {folder}`")
    data = json.loads(file.read_text(encoding="utf-8"))
    head = (
        f"{data['cases']} of {data['asked_cases']} cases, seed {data['seed']}, protocol `{data['protocol'][:16]}`, "
        f"generator `{data['generator'][:16]}`; locked in: {', '.join(data['locked_in'])}; "
        f"{data['core_seconds_a_case']['mean']:.0f} core-seconds a case."
    )
    made = [
        head,
        "",
        "| figure | asked | measured (cases; 95 % interval) | |",
        "|---|---|---|---|",
    ]
    made += [f"| {r['title']} | {r['asked']} | {r['text']} | {r['met']} |" for r in data["table"] if r["trials"]]
    return [*made, "", *map(_leak, data["metadata_alone"])]


def _leak(leak: Mapping[str, Any]) -> str:
    return (
        f"From metadata alone, {leak['question']}: balanced accuracy {leak['accuracy']:.2f}, "
        f"by chance {leak['chance']:.2f}, p {leak['p_value']:.2f}."
    )
