"""The page of the next experiment: what is still possible, what is proposed; and, after runs, the story."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from diagnosis.next.design import Design, Proposal
from diagnosis.next.rounds import OTHERS, SURE, Round, Story
from diagnosis.report.output import NAMES
from spot_log.page.look import Html, boxed, facts, framed, headed
from spot_log.page.svg import esc, legend

NAMED: Final = 0.12
"""A part of a bar that is at least so wide says its number."""
STYLE: Final = """
.odds { display: flex; height: 26px; border-radius: 6px; overflow: hidden; background: var(--empty); }
.odds div { color: #fff; font-size: 13px; line-height: 26px; text-indent: 6px; white-space: nowrap; overflow: hidden; }
.stage { margin: 12px 0 3px; } h3 + table th { width: 90px; } th { max-width: 300px; }
"""
SHADES: Final = ("#4e79a7", "#f28e2b", "#76b7b2", "#e15759", "#b07aa1", "#9c755f", "#59a14f", "#edc948", "#2f4b7c")
GREY: Final = "#bab0ab"


def ranking_page(design: Design, commands: Mapping[str, str]) -> str:
    """The page of a ranking, as text; ``commands`` by the experiment's name."""
    offered = [p for p in design.proposals if not p.refused]
    about = (
        "Ranked by information about the cause per second of robot time. The information is simulated on robots that "
        "agree with the logs. An experiment without a command tells too little."
    )
    body = [
        f"<section><h1>What to run next</h1><p class='lead'>{esc(_lead(design))}</p></section>",
        boxed(
            "Possible causes",
            "From the logs so far. One of these is taken to be right, so the shares add up to 100 %.",
            _moves([("", design.odds)]),
        ),
        boxed("Experiments", about, "".join(_offered(p, design, commands.get(p.candidate.name, "")) for p in offered)),
    ]
    refused = [(p.candidate.title, "; ".join(p.refused) + ".") for p in design.proposals if p.refused]
    body += [boxed("Refused", "Do not run these on a robot.", facts(refused))] if refused else []
    return framed("Next experiment", body, STYLE)


def _offered(proposal: Proposal, design: Design, command: str) -> str:
    rows = {
        "information": proposal.information,
        "separates": proposal.decides(design.causes, design.weights),
        "settings": proposal.values,
        "loads": proposal.burden,
        "needs": proposal.candidate.needs,
        "run": Html(f"<code>{esc(command)}</code>" if command else ""),
    }
    title = proposal.candidate.title
    return f"<h3>{esc(title[0].upper() + title[1:])}</h3>{facts((k, v) for k, v in rows.items() if v)}"


def story_page(story: Story) -> str:
    """The page of a story, as text."""
    cause, odds = next(iter(story.odds.items()))
    is_sure = odds >= SURE
    stages = [("First logs", story.first.odds)]
    stages += [
        (f"{number}. {r.title}, {r.robot_s:.0f} s{'' if r.found else ', not diagnosed yet'}", r.after)
        for number, r in enumerate(story.rounds, start=1)
    ]
    ending = f"Ended: {story.ending}." if story.ending else "Not finished."
    n = len(story.rounds)
    meta = f"{n} experiment{'s' if n != 1 else ''}, {story.robot_s:.0f} s of robot time. {ending}"
    badge, kind = ("One cause is left", "good") if is_sure else ("Several causes are possible", "fair")
    parts = [
        headed(badge, kind, f"{cause[0].upper()}{cause[1:]}: {_percent(odds)}", [story.sentence], meta),
        boxed(
            "Probabilities after each experiment",
            "From all logs until then. One of these is taken to be right, so the shares of a bar add up to 100 %.",
            _moves(stages),
        ),
    ]
    return framed("Experiments", [*parts, *map(_round, range(1, len(story.rounds) + 1), story.rounds)], STYLE)


def _round(number: int, asked: Round) -> str:
    moved = [
        f"{name} {_percent(asked.before.get(name, 0.0))} → {_percent(p)}"
        for name, p in {**dict.fromkeys(asked.before, 0.0), **asked.after}.items()
        if abs(p - asked.before.get(name, 0.0)) >= 0.01
    ] or ["changed by less than 1 %"]
    bits = f"{asked.came_bits:.2f} bits of information; {asked.expected_bits:.2f} were expected"
    rows = {
        "experiment": asked.title + (f" ({asked.values})" if asked.values else ""),
        "separates": asked.parts,
        "outcome": _lines(f"{asked.outcome}, {asked.robot_s:.0f} s of robot time", Path(asked.log).name),
        "probabilities": _lines(*moved, bits) if asked.found else "not diagnosed yet",
        "verdict": Html(esc(asked.sentence) + _report(asked)),
    }
    return boxed(f"Experiment {number}: {asked.name.replace('_', ' ')}", "", facts(rows.items()))


def _lines(*texts: str) -> Html:
    return Html("<br>".join(esc(text) for text in texts if text))


def _report(asked: Round) -> str:
    """A link to the round's diagnosis, from the story beside the rounds' folders."""
    if not asked.found:
        return ""
    report = (Path(asked.found) / NAMES["report"]).relative_to(Path(asked.folder).parent)
    return f"<br><a href='{esc(report.as_posix())}'>diagnosis of all logs so far</a>"


def _moves(stages: Sequence[tuple[str, Mapping[str, float]]]) -> str:
    """A bar for each stage, divided among the causes."""
    names = dict.fromkeys(name for _, odds in stages for name in odds)
    colours = {name: GREY if name == OTHERS else SHADES[i % len(SHADES)] for i, name in enumerate(names)}
    bars = []
    for label, odds in stages:
        parts = "".join(
            f"<div data-t='{esc(name)}: {_percent(p)}' style='background:{colours[name]};width:{100.0 * p:.1f}%'>"
            f"{_percent(p) if p >= NAMED else ''}</div>"
            for name, p in odds.items()
        )
        bars.append(f"<p class='note stage'>{esc(label)}</p><div class='odds'>{parts}</div>")
    return legend((colour, name) for name, colour in colours.items()) + "".join(bars)


def _percent(p: float) -> str:
    return f"{100.0 * p:.0f} %"


def _lead(design: Design) -> str:
    if len(design.causes) < 2:
        return f"One cause is left: {next(iter(design.odds))}. No experiment is needed."
    if not design.worthwhile:
        return "No experiment that is safe in simulation would tell enough more."
    best = design.worthwhile[0]
    title = best.candidate.title
    return (
        f"{title[0].upper()}{title[1:]}. This is expected to give {best.told.bits:.2f} of the {best.told.of_bits:.2f} "
        f"bits that decide between the causes, in {best.robot_s:.0f} s of robot time. One bit decides between two "
        "equally likely causes."
    )
