"""The page of the next experiment: what is still possible, what is proposed; and, after runs, the story."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from diagnosis.next.choose.design import Design, in_words
from diagnosis.next.files import Offer
from diagnosis.next.rounds import Story
from spot_log.page.look import boxed, framed
from spot_log.page.svg import esc

SHADES = ("#4e79a7", "#f28e2b", "#76b7b2", "#e15759", "#b07aa1", "#9c755f", "#bab0ab")


def ranking_page(design: Design, offers: Sequence[Offer]) -> str:
    """The page of a ranking, as text."""
    odds = {in_words(c): float(w) for c, w in zip(design.causes, design.weights, strict=True)}
    commands = {id(o.proposal): o.command for o in offers}
    rows = []
    for p in design.proposals:
        if p.refused:
            told = f"<td colspan='4'>refused: {esc('; '.join(p.refused))}</td>"
        else:
            cells = (
                f"{p.told.bits:.2f}",
                f"{p.robot_s:.0f}",
                esc(p.decides(design.causes, design.weights)),
                f"{esc(p.burden)}; needs {esc(p.candidate.needs)}<br><code>{esc(commands.get(id(p), ''))}</code>",
            )
            told = "".join(f"<td>{cell}</td>" for cell in cells)
        rows.append(f"<tr><td>{esc(p.candidate.title)}</td>{told}</tr>")
    head = "<tr><th>experiment</th><th>bits</th><th>robot s</th><th>parts</th><th>loads, needs, command</th></tr>"
    about = "The most bits of the cause a second of robot time first. All were simulated on robots that the logs allow."
    body = [
        f"<section><h1>What to run next</h1><p class='lead'>{esc(_lead(design))}</p></section>",
        boxed("Still possible", "Probabilities of causes by the logs so far.", _bars(odds, _colours([odds]))),
        boxed("Experiments", about, f"<table>{head}{''.join(rows)}</table>"),
    ]
    return framed("Next experiment", body)


def story_page(story: Story) -> str:
    """The page of a story, as text."""
    colours = _colours([story.first.odds, *(r.after for r in story.rounds)])
    cause, odds = next(iter(story.odds.items()))
    lead = f"{len(story.rounds)} experiments, {story.robot_s:.0f} s of robot time. {story.ending}."
    parts = [
        f"<section><h1>{esc(cause)}: {odds:.2f}</h1><p class='lead'>{esc(lead)}</p></section>",
        boxed("First logs", esc(story.first.sentence), _bars(story.first.odds, colours)),
    ]
    for number, asked in enumerate(story.rounds, start=1):
        about = (
            f"<p>Asked: {esc(asked.title)}, to part {esc(asked.parts)}; expected: {asked.expected_bits:.2f} bits.</p>"
            f"<p>Came: {esc(asked.outcome)}, {asked.robot_s:.0f} s, log <code>{esc(asked.log)}</code>.</p>"
            f"<p>{esc(asked.sentence)}</p>"
        )
        parts.append(boxed(f"Experiment {number}", "", about + _bars(asked.after, colours)))
    return framed("The robot was asked", parts)


def _lead(design: Design) -> str:
    if len(design.causes) < 2:
        return f"One cause is left: {in_words(design.causes[0])}. There is nothing to part."
    if not design.worthwhile:
        return "No experiment that is safe tells more."
    best = design.worthwhile[0]
    return f"{best.candidate.title}: {best.told.bits:.2f} of {best.told.of_bits:.2f} bits in {best.robot_s:.0f} s."


def _colours(all_odds: Sequence[Mapping[str, float]]) -> dict[str, str]:
    names = list(dict.fromkeys(name for odds in all_odds for name in odds))
    return {name: SHADES[i % len(SHADES)] for i, name in enumerate(names)}


def _bars(odds: Mapping[str, float], colours: Mapping[str, str]) -> str:
    lines = [
        f"<tr><td>{esc(name)}</td><td style='width:50%'><div style='background:{colours[name]};height:12px;"
        f"width:{100.0 * p:.1f}%'></div></td><td>{p:.2f}</td></tr>"
        for name, p in odds.items()
    ]
    return f"<table>{''.join(lines)}</table>"
