"""The scored page: self-contained, opens from disk."""

from __future__ import annotations

import html
import os
from pathlib import Path
from typing import Any, Final

from withheld import figures
from withheld.baselines import LEAST_SQUARES, PAPER, TITLES, TWO_SAMPLE
from withheld.cases.draw import WORDS
from withheld.scoring.outcome import Outcome
from withheld.scoring.scores import is_large
from withheld.scoring.show import fault_words, verdict_words
from withheld.scoring.verify import Checked

STYLE: Final = """
:root { color-scheme: light; }
body { font: 15px/1.45 system-ui, sans-serif; color: #26313b; background: #f4f6f8; margin: 0; }
main { max-width: 1320px; margin: 0 auto; padding: 20px; }
h1 { font-size: 24px; margin: 4px 0 2px; } h2 { font-size: 18px; margin: 0 0 6px; }
section { background: #fff; border: 1px solid #dde3e8; border-radius: 8px; padding: 14px 18px; margin: 14px 0; }
.two { display: grid; grid-template-columns: 1fr 1fr; gap: 14px; } .two section { margin: 0; min-width: 0; }
p.note { color: #61707d; margin: 0 0 6px; font-size: 13px; overflow-wrap: anywhere; }
table { border-collapse: collapse; width: 100%; font-size: 14px; }
td, th { text-align: left; vertical-align: top; padding: 3px 12px 3px 0; border-bottom: 1px solid #edf0f3; }
th { color: #61707d; font-weight: 500; } td.n { font-variant-numeric: tabular-nums; white-space: nowrap; }
.met { color: #1e7d4f; } .not { color: #c0392b; font-weight: 600; } .small { color: #61707d; font-size: 12px; }
details > summary { cursor: pointer; color: #61707d; } .wide { overflow-x: auto; }
@media (max-width: 900px) { .two { grid-template-columns: 1fr; } }
"""
SHOWN: Final = ("issue", "large", "full", "power", "all")


def page(data: dict[str, Any], checked: Checked, out: Path) -> str:
    """The page as text.

    Args:
        data: From :func:`withheld.scoring.report.scores`.
        checked: The cases.
        out: Folder of the page; links are relative to it.
    """
    from plotly.offline import get_plotlyjs

    body = [
        f"<h1>Withheld check: {data['cases']} cases</h1>",
        _head(data),
        *(_table(data["tables"][name], is_open=name in ("issue", "power", "all")) for name in SHOWN),
        _section(
            "Beside simpler ways",
            "Shares with 95 % bounds. The paper's search ran in some of the cases; the "
            "second column is the diagnosis on those.",
            _baselines(data["baselines"]),
        ),
        _section(
            "Metadata alone",
            "A classifier on names, sizes, stamps, counts and headers has to be at chance.",
            _leaks(data["metadata_alone"]),
        ),
        _section(
            "What was hidden, what was said",
            "Counts of cases with at most one effect. Rows: hidden.",
            figures.confusion(data["confusion"]),
        ),
        "<div class='two'>",
        _section(
            "Reliability",
            "Stated probabilities of effects, none and unknown against how often it was so.",
            figures.reliability(data["reliability"]),
        ),
        _section(
            "Power over size",
            "Single effects in their library, by their place on the ladder (1: end of the realistic range).",
            figures.power_curve(data["power_curve"]),
        ),
        "</div>",
        _section(
            "Where it works",
            "Single effects in their library, named in a group of at most three.",
            figures.breakdown(data["breakdown"]),
        ),
        _section("Cases", "Each with its report, where reports were kept.", _cases(checked, out)),
    ]
    return (
        "<!doctype html><html lang='en'><head><meta charset='utf-8'><title>Withheld check</title>"
        "<link rel='icon' href='data:,'>"
        f"<style>{STYLE}</style><script>{get_plotlyjs()}</script></head>"
        f"<body><main>{''.join(body)}</main></body></html>"
    )


def _head(data: dict[str, Any]) -> str:
    return (
        f"<p class='note'>protocol {data['protocol']}<br>generator {data['generator']}<br>"
        f"seed {data['seed']}, its digest before the first case {data['seed_digest']}<br>"
        f"locked in: {_e(', '.join(data['locked_in']))}; "
        f"{data['core_seconds_a_case']['mean']:.0f} core-seconds a case</p>"
    )


def _e(text: object) -> str:
    return html.escape(str(text))


def _section(title: str, note: str, content: str) -> str:
    return f"<section><h2>{_e(title)}</h2><p class='note'>{_e(note)}</p>{content}</section>"


def _table(t: dict[str, Any], *, is_open: bool) -> str:
    rows = "".join(
        f"<tr><td>{_e(r['title'])}</td><td class='n'>{_value(r)}</td><td class='n'>{_e(r['asked'])}</td>"
        f"<td>{_met(r['met'])}</td></tr>"
        for r in t["rows"]
    )
    head = "<tr><th>figure</th><th>value (hits of cases; 95 % bounds)</th><th>asked</th><th></th></tr>"
    inner = f"<table>{head}{rows}</table>"
    title = f"<summary><b>{_e(t['title'])}</b>, {t['cases']} cases</summary>"
    return f"<section><details{' open' if is_open else ''}>{title}{inner}</details></section>"


def _met(met: bool | None) -> str:
    return "" if met is None else "<span class='met'>met</span>" if met else "<span class='not'>not met</span>"


def _value(r: dict[str, Any] | None) -> str:
    if r is None:
        return "<span class='small'>cannot say</span>"
    if not r["trials"]:
        return "<span class='small'>no case</span>"
    if "hits" in r:
        of = f"({r['hits']}/{r['trials']}; {100 * r['low']:.0f} to {100 * r['high']:.0f} %)"
        return f"{100 * r['value']:.0f} % <span class='small'>{of}</span>"
    return f"{r['value']:.2f} <span class='small'>({r['trials']}; {r['low']:.2f} to {r['high']:.2f})</span>"


def _baselines(data: dict[str, dict[str, Any]]) -> str:
    columns = (
        ("diagnosis", "diagnosis"),
        ("diagnosis_where_paper_ran", "diagnosis, same cases as the paper's way"),
        *((m, TITLES[m]) for m in (PAPER, TWO_SAMPLE, LEAST_SQUARES)),
    )
    head = "<tr><th></th>" + "".join(f"<th>{_e(title)}</th>" for _, title in columns) + "</tr>"
    rows = "".join(
        f"<tr><td>{_e(entry['title'])}</td>"
        + "".join(f"<td class='n'>{_value(entry[key])}</td>" for key, _ in columns)
        + "</tr>"
        for entry in data.values()
    )
    return f"<div class='wide'><table>{head}{rows}</table></div>"


def _leaks(data: list[dict[str, Any]]) -> str:
    rows = "".join(
        f"<tr><td>{_e(leak['question'])}</td><td class='n'>{leak['accuracy']:.2f}</td>"
        f"<td class='n'>{leak['chance']:.2f}</td>"
        f"<td class='n'>{leak['p_value']:.2f}</td><td>{_met(leak['p_value'] > 0.05)}</td></tr>"
        for leak in data
    )
    head = "<tr><th>question</th><th>balanced accuracy</th><th>by chance</th><th>p</th><th>at chance</th></tr>"
    return f"<table>{head}{rows}</table>" if data else "<p>Too few cases.</p>"


def _cases(checked: Checked, out: Path) -> str:
    rows = "".join(_case(o, checked.folders[o.case.number], out) for o in checked.outcomes)
    head = "<tr><th>case</th><th>kind</th><th>logs</th><th>hidden</th><th>said</th><th>S</th><th></th></tr>"
    return f"<details open><summary>{len(checked.outcomes)} cases</summary><table>{head}{rows}</table></details>"


def _case(o: Outcome, folder: Path, out: Path) -> str:
    report = folder / "report.html"
    number = str(o.case.number)
    if report.exists():
        number = f"<a href='{_e(os.path.relpath(report, out))}'>{number}</a>"
    hidden = "<br>".join(_e(fault_words(f)) for f in o.truth.faults) or "nothing"
    size = " (large)" if is_large(o) else ""
    said = "; ".join(f"{'/'.join(e.group or (e.name,))} {e.probability:.2f}" for e in o.effects)
    s = "" if o.shrink is None or o.shrink.s is None else f"{o.shrink.s:.2f}"
    words = verdict_words(o)
    colour = "met" if words.startswith("right") else "not"
    lacks = f", without {', '.join(o.case.missing)}" if o.case.missing else ""
    return (
        f"<tr><td class='n'>{number}</td><td>{_e(WORDS[o.case.kind])}</td><td>{_e(o.case.policy)}, "
        f"3 x {o.case.repeats}{_e(lacks)}</td><td>{hidden}{size}</td><td>{_e(o.status)}<br>{_e(said)}</td>"
        f"<td class='n'>{s}</td><td class='{colour}'>{_e(words)}</td></tr>"
    )
