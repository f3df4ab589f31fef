"""The page of an improvement: what was found, what the new policy does better and worse, and how it was made."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from diagnosis.document import Verdict
from diagnosis.improve.improvement import Improvement
from diagnosis.report import words
from diagnosis.report.headline import headline
from spot_log.page.render import rendered
from spot_log.page.sections import Beside, Content, Fold, Head, Items, Legend, Mark, Section, Table
from spot_model.text import parameter_words
from trainer.evaluate.page import power_chart, speed_chart

COLOURS: Final = {"old": "var(--other)", "new": "var(--floor)"}
CHANGES: Final = {"better": Mark("better", "badge good"), "worse": Mark("worse", "badge bad")}
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
    told = verdict.headline or headline(verdict)
    parts: list[Content] = [
        Head(*BADGES[result.outcome], result.headline, result.sentences, "Simulated; the robot may differ."),
        Section("What the logs say", told, Items(_found(result, verdict))),
    ]
    if evaluations:
        both = [(colour, name, e) for (name, colour), e in zip(COLOURS.items(), evaluations, strict=True)]
        key = Legend([("var(--ink)", "commanded"), *((colour, name) for name, colour in COLOURS.items())])
        about = "Each forward speed is held for 10 s. "
        about += "Where a line is interrupted or ends, the robot fell or was not tried."
        charts = Beside([speed_chart("var(--ink)", both, height=240), power_chart(both, height=240)])
        parts += [
            Section("Old and new policy", "On the same robots, with the same draws.", _figures(result)),
            Section("Speed and power", about, [key, charts]),
        ]
    parts.append(Section("How it was made", "Each step is a command that can be repeated by hand.", _steps(result)))
    return rendered(f"{result.policy}: improvement", parts)


def _found(result: Improvement, verdict: Verdict) -> Iterator[Mark | str]:
    for d in verdict.differences:
        sizes = ", ".join(words.size_phrase(name, p) for name, p in d.parameters.items())
        yield f"{words.found(d)}, probability {d.probability:.2f}: {sizes}"
    if not verdict.differences:
        yield f"No difference is shown; the probability that there is none is {verdict.probability_none:.2f}."
    yield f"Probability of an effect that the library lacks: {verdict.probability_unknown:.2f}."
    for limit in result.limits:
        if limit.is_known:
            place = f"{limit.value:.4g} ({limit.low:.4g} to {limit.high:.4g}) {limit.unit}"
            yield f"{parameter_words(limit.parameter)} of the knees is {place}; nominal {limit.nominal:.4g}."
    yield from result.notes
    yield Mark("The whole diagnosis", link="diagnosis/report.html")


def _figures(result: Improvement) -> Table:
    rows = [
        (f.name, f"{f.old} {f.unit}".strip(), f"{f.new} {f.unit}".strip(), CHANGES.get(f.kind, "no clear difference"))
        for f in result.figures
    ]
    return Table(("measure", "old", "new", "judged"), rows)


def _steps(result: Improvement) -> Content:
    rows = [(s.about, f"{s.seconds:.0f} s" if s.seconds is not None else "done before") for s in result.steps]
    commands = [(Mark(s.command, "code"),) for s in result.steps]
    return [Table(("step", "took"), rows), Fold("The commands", commands)]
