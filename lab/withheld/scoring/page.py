"""The scored page: self-contained, opens from disk."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from spot_log.page.render import rendered
from spot_log.page.sections import Content, Fold, Head, Items, Mark, Section, Table, Words
from spot_model.text import counted
from withheld.cases import WORDS
from withheld.outcome import Outcome
from withheld.scoring.reading import Cases, fault_words, verdict_words
from withheld.scoring.scores import differences, does

LOOKS: Final = {"met": "good", "right": "good", "not met": "bad", "wrong": "bad", "not shown": "fair"}


def page(data: Mapping[str, Any], cases: Cases, out: Path) -> str:
    """The page as text.

    Args:
        data: From :func:`withheld.scoring.report.scores`.
        cases: That are scored.
        out: Folder of the page; links are relative to it.
    """
    shown = [r for r in data["table"] if r["trials"]]
    empty = [r["title"] for r in data["table"] if not r["trials"]]
    about_figures = (
        "'Not shown' means that the interval contains the target. A fault matters if it moves the robot by twice what "
        "repeats explain, or costs 0.1 m/s, 5 % of power or a fall. F1 is 1 if all joints with a fault are named "
        "and no other joint is."
    )
    about_kinds = "All cases count but those whose effects are outside the library and do not matter."
    figures = [(r["title"], r["text"], r["asked"], Mark(r["met"], LOOKS.get(r["met"], ""))) for r in shown]
    rights = [(cut, value, _share(s)) for cut, values in data["breakdown"].items() for value, s in values.items()]
    rows = [_case(o, cases.folders[o.case.number], out) for o in cases.outcomes]
    head = ("case", "kind", "logs", "hidden", "said", "S", "judged")
    measured = Table(("figure", "measured (cases; 95 % interval)", "target", "result"), figures)
    parts = [
        _head(data, shown),
        Section("Figures", about_figures, [measured, Fold("Figures without a case", Items(empty))]),
        Section("Right answers by kind of case", about_kinds, Table(("grouped by", "group", "right"), rights)),
        Section("Cases", "The number links to the case's report, if it was kept.", Table(head, rows)),
        Section("Protocol", "What was fixed before the first case.", _protocol(data)),
    ]
    return rendered("Withheld check", parts)


def _head(data: Mapping[str, Any], shown: Sequence[Mapping[str, Any]]) -> Head:
    asked = [r for r in shown if r["met"]]
    met = [r for r in asked if r["met"] == "met"]
    missed = [r["title"] for r in asked if r["met"] == "not met"]
    kind = "good" if asked and len(met) == len(asked) else "bad" if missed else "fair"
    are = "is" if data["cases"] == 1 else "are"
    lines = [f"{data['cases']} of {counted(data['asked_cases'], 'case')} {are} judged."]
    lines += [f"Missed: {'; '.join(missed)}."] if missed else []
    meta = "'Met' means that the whole 95 % interval meets the target."
    headline = f"{len(met)} of {len(asked)} targets are met" if asked else "Too few cases for any target"
    return Head("Withheld check", kind, headline, lines, meta)


def _share(s: Mapping[str, Any]) -> str:
    return f"{100 * s['value']:.0f} % ({s['hits']}/{s['trials']}; {100 * s['low']:.0f} to {100 * s['high']:.0f})"


def _case(o: Outcome, folder: Path, out: Path) -> Sequence[Words]:
    report = folder / "report.html"
    hidden = [f"{fault_words(f)} ({does(o, i)})" for i, f in enumerate(o.truth.faults)]
    hidden.append(f"errors {o.truth.error_scale:.2g} times the usual")
    said = "; ".join(f"{'/'.join(sorted(c.names))} {c.probability:.2f}" for c in differences(o.verdict))
    words = verdict_words(o)
    logs = f"{o.case.policy}, {len(o.case.sequences)} x {o.case.repeats}"
    logs += f", without {', '.join(o.case.missing)}" if o.case.missing else ""
    return (
        Mark(str(o.case.number), "", os.path.relpath(report, out) if report.exists() else ""),
        WORDS[o.case.kind],
        logs,
        "\n".join(hidden),
        f"{o.status}\n{said}",
        "" if o.true_s is None else f"{o.true_s:.2f}",
        Mark(words, LOOKS.get(words.split(":")[0], "")),
    )


def _protocol(data: Mapping[str, Any]) -> Content:
    drawn = "drawn by the operating system" if data["is_seed_drawn"] else "given"
    frozen = f"revision {data['revision']}\ndigest of sources and policies {data['digest']}\n"
    about = f"Catalogue {data['reality']}; {data['core_seconds_a_case']['mean']:.0f} core-seconds a case."
    return [about, Fold("Revision and seed", Mark(f"{frozen}seed {data['seed']}, {drawn}", "pre"))]
