"""The scored page: self-contained, opens from disk."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from spot_log.page.look import Html, boxed, folded, framed, headed, listed, table
from spot_log.page.svg import esc
from spot_model.text import counted
from withheld.cases import WORDS
from withheld.outcome import Outcome
from withheld.scoring.reading import Cases, fault_words, verdict_words
from withheld.scoring.scores import differences, does

_MORE: Final = """
.met, .right { color: var(--good); } .not-met, .wrong { color: var(--bad); font-weight: 600; }
.not-shown { color: var(--warn); } td:first-child { min-width: 90px; }
"""


def page(data: Mapping[str, Any], cases: Cases, out: Path) -> str:
    """The page as text.

    Args:
        data: From :func:`withheld.scoring.report.scores`.
        cases: That are scored.
        out: Folder of the page; links are relative to it.
    """
    shown = [r for r in data["table"] if r["trials"]]
    empty = [r["title"] for r in data["table"] if not r["trials"]]
    body = [
        _head(data, shown),
        boxed(
            "Figures",
            "'Not shown' means that the interval contains the target. A fault matters if it moves the robot by two "
            "floors, or costs 0.1 m/s, 5 % of power or a fall. F1 is 1 if all joints with a fault are named and no "
            "other joint is.",
            _table(("figure", "measured (cases; 95 % interval)", "target", "result"), map(_figure, shown))
            + _unasked(empty),
        ),
        boxed(
            "Right answers by kind of case",
            "All cases count but those whose effects are outside the library and do not matter.",
            _table(("grouped by", "group", "right"), _breakdown(data["breakdown"])),
        ),
        boxed(
            "Cases",
            "The number links to the case's report, if it was kept.",
            _table(
                ("case", "kind", "logs", "hidden", "said", "S", "judged"),
                [_case(o, cases.folders[o.case.number], out) for o in cases.outcomes],
            ),
        ),
        boxed("Protocol", "What was fixed before the first case.", _protocol(data)),
    ]
    return framed("Withheld check", body, _MORE)


def _head(data: Mapping[str, Any], shown: Sequence[Mapping[str, Any]]) -> str:
    asked = [r for r in shown if r["met"]]
    met = [r for r in asked if r["met"] == "met"]
    missed = [r["title"] for r in asked if r["met"] == "not met"]
    kind = "good" if asked and len(met) == len(asked) else "bad" if missed else "fair"
    lines = [
        f"{data['cases']} of {counted(data['asked_cases'], 'case')} {'is' if data['cases'] == 1 else 'are'} judged."
    ]
    lines += [f"Missed: {'; '.join(missed)}."] if missed else []
    meta = "'Met' means that the whole 95 % interval meets the target."
    headline = f"{len(met)} of {len(asked)} targets are met" if asked else "Too few cases for any target"
    return headed("Withheld check", kind, headline, lines, meta)


def _unasked(titles: Sequence[str]) -> str:
    return folded("Figures without a case", listed(titles))


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> Html:
    """A table of cells that are HTML already; empty without rows."""
    return table(heads, ([Html(cell) for cell in row] for row in rows))


def _figure(row: Mapping[str, Any]) -> Sequence[str]:
    met = f"<span class='{row['met'].replace(' ', '-')}'>{row['met']}</span>" if row["met"] else ""
    return esc(row["title"]), esc(row["text"]), esc(row["asked"]), met


def _share(s: Mapping[str, Any]) -> str:
    return f"{100 * s['value']:.0f} % ({s['hits']}/{s['trials']}; {100 * s['low']:.0f} to {100 * s['high']:.0f})"


def _breakdown(cuts: Mapping[str, Mapping[str, Any]]) -> list[Sequence[str]]:
    return [(esc(cut), esc(value), _share(s)) for cut, values in cuts.items() for value, s in values.items()]


def _case(o: Outcome, folder: Path, out: Path) -> Sequence[str]:
    report, number = folder / "report.html", str(o.case.number)
    if report.exists():
        number = f"<a href='{esc(os.path.relpath(report, out))}'>{number}</a>"
    hidden = [f"{fault_words(f)} ({does(o, i)})" for i, f in enumerate(o.truth.faults)]
    hidden.append(f"errors {o.truth.error_scale:.2g} times the usual")
    said = "; ".join(f"{'/'.join(sorted(c.names))} {c.probability:.2f}" for c in differences(o.verdict))
    words = verdict_words(o)
    logs = f"{o.case.policy}, {len(o.case.sequences)} x {o.case.repeats}"
    logs += f", without {', '.join(o.case.missing)}" if o.case.missing else ""
    return (
        number,
        esc(WORDS[o.case.kind]),
        esc(logs),
        "<br>".join(map(esc, hidden)),
        f"{esc(o.status)}<br>{esc(said)}",
        "" if o.true_s is None else f"{o.true_s:.2f}",
        f"<span class='{words.split(':')[0].replace(' ', '-')}'>{esc(words)}</span>",
    )


def _protocol(data: Mapping[str, Any]) -> str:
    drawn = "drawn by the operating system" if data["is_seed_drawn"] else "given"
    return (
        f"<p>Catalogue {esc(data['reality'])}; {data['core_seconds_a_case']['mean']:.0f} core-seconds a case.</p>"
        "<details><summary>Revision and seed</summary>"
        f"<pre>revision {esc(data['revision'])}\ndigest of sources and policies {data['digest']}\n"
        f"seed {data['seed']}, {drawn}</pre></details>"
    )
