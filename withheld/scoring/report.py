"""Scores of a run: ``scores.json``, the page beside it, and the lines for a terminal."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from withheld.scoring.leak import leaks
from withheld.scoring.page import page
from withheld.scoring.scores import stated
from withheld.scoring.statistics import reliability
from withheld.scoring.table import breakdown, comparison, confusion, power_curve, tables
from withheld.scoring.verify import Checked, check

SCHEMA: Final = "spot-rl/withheld-scores/1"
SCORES: Final = "scores.json"
PAGE: Final = "scores.html"


def write_scores(folders: Sequence[Path], out: Path) -> list[str]:
    """Check, score and write; returns the lines for a terminal.

    Raises:
        SpotRlError: The folders cannot be scored together, or something was changed.
    """
    checked = check(folders, Path("policies"))
    data = scores(checked)
    (out / SCORES).write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    (out / PAGE).write_text(page(data, checked, out), encoding="utf-8")
    return lines(data, out)


def scores(checked: Checked) -> dict[str, Any]:
    """Everything as data; the same outcomes give the same bytes."""
    outcomes = checked.outcomes
    made = stated(outcomes)
    seconds = [sum(o.seconds.values()) for o in outcomes]
    return {
        "schema": SCHEMA,
        "protocol": checked.head.protocol,
        "generator": checked.head.generator,
        "policies": checked.head.policies,
        "reality": checked.head.reality or "withheld.realities",
        "versions": checked.head.versions,
        "seed": checked.seed,
        "seed_digest": checked.head.seed_digest,
        "locked_in": list(checked.locked_in),
        "cases": len(outcomes),
        "asked_cases": checked.head.cases,
        "drawn_again": sum(o.case.attempt > 0 for o in outcomes),
        "core_seconds_a_case": {"mean": float(np.mean(seconds)), "most": float(np.max(seconds))},
        "core_seconds_by_stage": {
            stage: float(np.mean([o.seconds.get(stage, 0.0) for o in outcomes]))
            for stage in sorted({s for o in outcomes for s in o.seconds})
        },
        "tables": {name: t.to_data() for name, t in tables(outcomes).items()},
        "baselines": comparison(outcomes),
        "breakdown": {
            cut: {value: share.to_data() for value, share in shares.items()}
            for cut, shares in breakdown(outcomes).items()
        },
        "confusion": confusion(outcomes),
        "reliability": [{"said": b.said, **b.share.to_data()} for b in reliability(made.said, made.true)],
        "power_curve": [
            {"size": size, "named": named.to_data(), "noticed": noticed.to_data()}
            for size, named, noticed in power_curve(outcomes)
        ],
        "metadata_alone": [asdict(leak) for leak in leaks(outcomes)],
    }


def lines(data: dict[str, Any], out: Path) -> list[str]:
    """The table in words."""
    made = [f"{data['cases']} of {data['asked_cases']} cases, protocol {data['protocol'][:16]}, seed {data['seed']}"]
    for name in ("issue", "all"):
        t = data["tables"][name]
        made.append(f"-- {t['title']} ({t['cases']} cases)")
        made += [f"  {words(r)}" for r in t["rows"] if r["trials"]]
    for leak in data["metadata_alone"]:
        made.append(
            f"metadata alone, {leak['question']}: {leak['accuracy']:.2f}, by chance {leak['chance']:.2f}, "
            f"p {leak['p_value']:.2f}"
        )
    made.append(f"page {out / PAGE}  table {out / SCORES}")
    return made


def words(row: dict[str, Any]) -> str:
    """One figure as text."""
    if "hits" in row:
        value = f"{100 * row['value']:.0f} % ({row['hits']}/{row['trials']}, "
        value += f"{100 * row['low']:.0f} to {100 * row['high']:.0f} %)"
    else:
        value = f"{row['value']:.2f} ({row['trials']}, {row['low']:.2f} to {row['high']:.2f})"
    met = {True: "  met", False: "  NOT met", None: ""}[row["met"]]
    return f"{row['title']}: {value}" + (f"; asked: {row['asked']}{met}" if row["asked"] else "")
