"""The scored page: self-contained, opens from disk."""

from __future__ import annotations

import html
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from withheld.cases.protocol import WORDS
from withheld.outcome import Outcome
from withheld.scoring.scores import causes
from withheld.scoring.show import fault_words, verdict_words
from withheld.scoring.sizes import sizes
from withheld.scoring.verify import Checked

STYLE: Final = """
:root { color-scheme: light; }
body { font: 15px/1.45 system-ui, sans-serif; color: #26313b; background: #f4f6f8; margin: 0; }
main { max-width: 1320px; margin: 0 auto; padding: 20px; }
section { background: #fff; border: 1px solid #dde3e8; border-radius: 8px; padding: 14px 18px; margin: 14px 0; }
h1 { font-size: 24px; margin: 4px 0 2px; } h2 { font-size: 18px; margin: 0 0 6px; }
p.note { color: #61707d; margin: 0 0 6px; font-size: 13px; overflow-wrap: anywhere; }
table { border-collapse: collapse; width: 100%; font-size: 14px; }
td, th { text-align: left; vertical-align: top; padding: 3px 12px 3px 0; border-bottom: 1px solid #edf0f3; }
th { color: #61707d; font-weight: 500; }
.met, .right { color: #1e7d4f; } .not-met, .wrong { color: #c0392b; font-weight: 600; } .not-shown { color: #9a6700; }
"""


def page(data: Mapping[str, Any], checked: Checked, out: Path) -> str:
    """The page as text.

    Args:
        data: From :func:`withheld.scoring.report.scores`.
        checked: The cases.
        out: Folder of the page; links are relative to it.
    """
    shown = [r for r in data["table"] if r["trials"]]
    empty = [r["title"] for r in data["table"] if not r["trials"]]
    asked = [r for r in shown if r["met"]]
    n_met = sum(r["met"] == "met" for r in asked)
    summary = (
        f"{data['cases']} of {data['asked_cases']} cases are judged. Of {len(asked)} figures with an aim, {n_met} "
    )
    summary += "are met: the whole 95 % interval lies where it is asked to."
    body = [
        "<h1>Withheld check</h1>",
        f"<p>{summary}</p>",
        _section(
            "Figures",
            "<i>Not shown</i>: the interval holds both what is asked and what is not. A fault matters "
            "if it moves the gap between this robot and the same one without it by twice the gap's floor.",
            _table(("figure", "measured (cases; 95 % interval)", "asked", ""), [_figure(r) for r in shown])
            + (f"<p class='note'>Without a case: {_e('; '.join(empty))}.</p>" if empty else ""),
        ),
        _section(
            "Where it is right",
            "Cases whose truth is clear: faults that matter, or none that does.",
            _table(("by", "", "right"), _breakdown(data["breakdown"])),
        ),
        _section(
            "Stated probabilities",
            "Of causes, of no gap and of an unknown effect, in steps of a tenth.",
            _table(("stated", "was so"), [(f"{b['said']:.2f}", _share(b)) for b in data["reliability"]]),
        ),
        _section(
            "Metadata alone",
            "A classifier on names, sizes, stamps, counts and headers has to be at chance.",
            _table(
                ("question", "balanced accuracy", "by chance", "p"),
                [
                    (_e(x["question"]), f"{x['accuracy']:.2f}", f"{x['chance']:.2f}", f"{x['p_value']:.2f}")
                    for x in data["metadata_alone"]
                ],
            ),
        ),
        _section(
            "Cases",
            "Each with its report, where reports were kept.",
            _table(
                ("case", "kind", "logs", "hidden", "said", "S", ""),
                [_case(o, checked.folders[o.case.number], out) for o in checked.outcomes],
            ),
        ),
        _section("Protocol", "What was fixed before the first case.", _protocol(data)),
    ]
    return (
        "<!doctype html><html lang='en'><head><meta charset='utf-8'><title>Withheld check</title>"
        f"<link rel='icon' href='data:,'><style>{STYLE}</style></head><body><main>{''.join(body)}</main></body></html>"
    )


def _e(text: object) -> str:
    return html.escape(str(text))


def _section(title: str, note: str, content: str) -> str:
    return f"<section><h2>{_e(title)}</h2><p class='note'>{note}</p>{content}</section>"


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    head = "".join(f"<th>{_e(h)}</th>" for h in heads)
    return (
        f"<table><tr>{head}</tr>{''.join('<tr>' + ''.join(f'<td>{c}</td>' for c in r) + '</tr>' for r in rows)}</table>"
    )


def _figure(row: Mapping[str, Any]) -> Sequence[str]:
    met = f"<span class='{row['met'].replace(' ', '-')}'>{row['met']}</span>" if row["met"] else ""
    return _e(row["title"]), _e(row["text"]), _e(row["asked"]), met


def _share(s: Mapping[str, Any]) -> str:
    return f"{100 * s['value']:.0f} % ({s['hits']}/{s['trials']}; {100 * s['low']:.0f} to {100 * s['high']:.0f})"


def _breakdown(cuts: Mapping[str, Mapping[str, Any]]) -> list[Sequence[str]]:
    return [(_e(cut), _e(value), _share(s)) for cut, values in cuts.items() for value, s in values.items()]


def _case(o: Outcome, folder: Path, out: Path) -> Sequence[str]:
    report, number = folder / "report.html", str(o.case.number)
    if report.exists():
        number = f"<a href='{_e(os.path.relpath(report, out))}'>{number}</a>"
    hidden = [f"{fault_words(f)} ({s.value})" for f, s in zip(o.truth.faults, sizes(o), strict=True)]
    hidden.append(f"errors {o.truth.error_scale:.2g} times the usual")
    said = "; ".join(f"{'/'.join(sorted(c.names))} {c.probability:.2f}" for c in causes(o.verdict))
    words = verdict_words(o)
    logs = f"{o.case.policy}, {len(o.case.sequences)} x {o.case.repeats}"
    logs += f", without {', '.join(o.case.missing)}" if o.case.missing else ""
    return (
        number,
        _e(WORDS[o.case.kind]),
        _e(logs),
        "<br>".join(map(_e, hidden)),
        f"{_e(o.status)}<br>{_e(said)}",
        "" if o.true_s is None else f"{o.true_s:.2f}",
        f"<span class='{words.split(':')[0].split(',')[0].replace(' ', '-')}'>{_e(words)}</span>",
    )


def _protocol(data: Mapping[str, Any]) -> str:
    return (
        f"<p class='note'>diagnosis {data['protocol']}<br>generator {data['generator']}<br>catalogue {data['reality']}"
        f"<br>seed {data['seed']}, its digest before the first case {data['seed_digest']}<br>"
        f"locked in: {_e(', '.join(data['locked_in']))}; "
        f"{data['core_seconds_a_case']['mean']:.0f} core-seconds a case</p>"
    )
