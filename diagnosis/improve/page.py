"""The page of an improvement: what was found, what the new policy does better and worse, and how it was made."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from diagnosis.document import Verdict
from diagnosis.improve.improvement import Improvement
from diagnosis.report import words
from diagnosis.report.headline import headline
from spot_log.page.chart import Series, chart
from spot_log.page.look import Html, beside, boxed, folded, framed, headed, listed, table
from spot_log.page.svg import HALF, esc, legend

OLD: Final = "var(--other)"
NEW: Final = "var(--floor)"
ABOUT_SPEED: Final = (
    "Each forward speed is held for 10 s. Where a line is interrupted or ends, the robot fell or was not tried."
)
BADGES: Final = {
    "improved": ("Improved", "good"),
    "kept": ("Keep the old policy", "fair"),
    "nothing": ("Nothing to correct", "good"),
    "unknown": ("Not trained", "fair"),
}


def improvement_page(result: Improvement, verdict: Verdict, evaluations: Sequence[Mapping[str, Any]]) -> str:
    """The page's text.

    Args:
        result: What came out.
        verdict: Of the diagnosis.
        evaluations: Of the old and of the new policy; none where nothing was trained.
    """
    badge, kind = BADGES[result.outcome]
    body = [
        headed(badge, kind, result.headline, result.sentences, "Simulated; the robot may differ."),
        boxed("What the logs say", verdict.headline or headline(verdict), listed(_found(result, verdict))),
    ]
    if evaluations:
        body += [
            boxed("Old and new policy", "On the same robots, with the same draws.", _figures(result)),
            boxed("Speed and power", ABOUT_SPEED, _speed(evaluations)),
        ]
    body.append(boxed("How it was made", "Each step is a command that can be repeated by hand.", _steps(result)))
    return framed(f"{result.policy}: improvement", body)


def _found(result: Improvement, verdict: Verdict) -> Iterator[Html | str]:
    for d in verdict.differences:
        sizes = ", ".join(words.size_told(name, p) for name, p in d.parameters.items())
        yield f"{words.found(d)}, probability {d.probability:.2f}: {sizes}"
    if not verdict.differences:
        yield f"No difference is shown; the probability that there is none is {verdict.probability_none:.2f}."
    yield f"Probability of an effect that the library lacks: {verdict.probability_unknown:.2f}."
    for limit in result.limits:
        if limit.is_known:
            place = f"{limit.value:.4g} ({limit.low:.4g} to {limit.high:.4g}) {limit.unit}"
            yield f"{words.parameter(limit.parameter)} of the knees is {place}; nominal {limit.nominal:.4g}."
    yield from result.notes
    yield Html('<a href="diagnosis/report.html">The whole diagnosis</a>')


def _figures(result: Improvement) -> str:
    rows = [(f.name, f"{f.old} {f.unit}".strip(), f"{f.new} {f.unit}".strip(), _change(f.kind)) for f in result.figures]
    return table(("measure", "old", "new", "judged"), rows)


def _change(kind: str) -> Html:
    css = {"better": "badge good", "worse": "badge bad"}.get(kind, "note")
    return Html(f'<span class="{css}">{"no clear difference" if kind == "same" else kind}</span>')


def _speed(evaluations: Sequence[Mapping[str, Any]]) -> str:
    lines = []
    for colour, name, evaluation in zip((OLD, NEW), ("old", "new"), evaluations, strict=True):
        curve = evaluation["top_speed"]["curve"]
        held = [c[1] if c[2] else np.nan for c in curve]
        lines.append(Series(colour, [c[0] for c in curve], held, has_points=True, name=name))
    longest = max((e["top_speed"]["curve"] for e in evaluations), key=lambda curve: float(curve[-1][0]))
    asked = [c[0] for c in longest]
    lines.insert(0, Series("var(--ink)", asked, asked, is_dotted=True))
    key = legend([("var(--ink)", "commanded"), (OLD, "old"), (NEW, "new")])
    picture = chart(lines, "held, m/s", x_title="commanded forward, m/s", width=HALF, height=240)
    power = [_power(c, n, e) for c, n, e in zip((OLD, NEW), ("old", "new"), evaluations, strict=True)]
    return key + beside(
        picture, chart(power, "power, W", x_title="commanded forward, m/s", width=HALF, height=240, zero=True)
    )


def _power(colour: str, name: str, evaluation: Mapping[str, Any]) -> Series:
    points = [p for p in evaluation["tracking"]["points"] if p["command"][1:] == [0.0, 0.0] and not p["fell"]]
    points.sort(key=lambda p: float(p["command"][0]))
    return Series(colour, [p["command"][0] for p in points], [p["power_w"] for p in points], has_points=True, name=name)


def _steps(result: Improvement) -> str:
    rows = [(s.about, f"{s.seconds:.0f} s" if s.seconds is not None else "done before") for s in result.steps]
    commands = "".join(f"<p><code>{esc(s.command)}</code></p>" for s in result.steps)
    return table(("step", "took"), rows) + folded("The commands", commands)
