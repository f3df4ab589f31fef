"""A scored run's table as Markdown: it says what fails as plainly as what works."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

from spot_model.errors import BadInputError
from withheld.baselines import LEAST_SQUARES, PAPER, TWO_SAMPLE
from withheld.scoring.report import SCORES

COLUMNS: Final = ("issue", "full", "all", "power")
HEADS: Final = ("as asked", "five repeats, every size", "all cases", "power at 4 to 6 m/s")


def markdown(folder: Path) -> list[str]:
    """Lines.

    Raises:
        BadInputError: The folder was not scored.
    """
    file = folder / SCORES
    if not file.is_file():
        raise BadInputError(f"{file} is not there; score first: `spot-rl withheld score {folder}`")
    data = json.loads(file.read_text(encoding="utf-8"))
    head = f"{data['cases']} cases, seed {data['seed']}, protocol `{data['protocol'][:16]}`, generator "
    head += f"`{data['generator'][:16]}`; locked in: {', '.join(data['locked_in'])}; "
    head += f"{data['core_seconds_a_case']['mean']:.0f} core-seconds a case."
    made = [head, "", "| figure | asked | " + " | ".join(HEADS) + " |", "|---|---|" + "---|" * len(HEADS)]
    rows = {name: {r["key"]: r for r in data["tables"][name]["rows"]} for name in COLUMNS}
    for key, row in rows["all"].items():
        cells = [cell(rows[name][key]) for name in COLUMNS]
        verdict = {True: " (met)", False: " (**not met**)", None: ""}[rows["issue"][key]["met"]]
        made.append(f"| {row['title']} | {row['asked']}{verdict} | " + " | ".join(cells) + " |")
    made += ["", "| the limit of power or bus, at 4 to 6 m/s | |", "|---|---|"]
    made += [f"| {row['title']} | {cell(row)} |" for key, row in rows["power"].items() if key not in rows["all"]]
    beside = ("diagnosis", "paper's way (diagnosis on its cases)", "two-sample test", "least squares")
    made += ["", "| beside simpler ways, same cases | " + " | ".join(beside) + " |"]
    made.append("|---|---|---|---|---|")
    for entry in data["baselines"].values():
        cells = [cell(entry["diagnosis"]), f"{cell(entry[PAPER])} ({cell(entry['diagnosis_where_paper_ran'])})"]
        cells += [cell(entry[TWO_SAMPLE]), cell(entry[LEAST_SQUARES])]
        made.append(f"| {entry['title']} | " + " | ".join(cells) + " |")
    for leak in data["metadata_alone"]:
        text = f"Metadata alone, {leak['question']}: balanced accuracy {leak['accuracy']:.2f}, "
        made += ["", f"{text}by chance {leak['chance']:.2f}, p {leak['p_value']:.2f}."]
    return made


def cell(row: dict[str, Any] | None) -> str:
    """One figure."""
    if row is None:
        return "cannot say"
    if not row["trials"]:
        return "-"
    if "hits" in row:
        return f"{100 * row['value']:.0f} % ({row['hits']}/{row['trials']})"
    return f"{row['value']:.2f} ({row['trials']})"
