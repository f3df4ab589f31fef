"""One self-contained page of a diagnosis: opens from disk, needs no network, light or dark."""

from __future__ import annotations

from typing import Final

import numpy as np

from diagnosis.channels import CHANNEL_TITLES
from diagnosis.document import CalibratedNumber, Consequences, Difference, Verdict
from diagnosis.report import figures, words
from diagnosis.report.headline import MOST_NAMED, NEXT, headline, is_good
from diagnosis.verdict.diagnose import Diagnosis
from spot_log.page.look import Html, beside, boxed, facts, folded, framed, headed, listed, table
from spot_log.page.svg import esc, legend
from spot_model.robot.facts import JOINT_NAMES
from spot_model.text import counted

BADGES: Final = {
    "explained": "Cause found",
    "partly_explained": "Cause found, more is left",
    "unknown_effect": "Something unknown",
    "calibration": "Calibration",
    "no_gap": "No gap",
    "cannot_tell": "Cannot tell",
}
STYLE: Final = """
.calibration { background: #2f6fb5; } .warning { border: 2px solid var(--bad); }
section > svg:not(.wide) { max-width: 480px; margin: 0 auto; }
.out td { font-weight: 600; } td.number { text-align: left; }
"""
MOST_NUMBERS: Final = 12
"""Numbers of the robot's own that are shown unfolded, if not more stand out."""
TERMS: Final = (
    ("nominal model", "your simulator, before any correction; in a history the corrected model of the date before"),
    ("corrected model", "the simulator with differences and calibration, in corrected_model.yaml"),
    ("gap", "distance between robot and simulator; its share that closes counts from what repeats or noise explain"),
    (
        "what repeats or noise explain",
        "distance of two of its runs, or 2 % of the signal's spread; of predictions what noise and formulas leave",
    ),
    ("P", "probability that it is there; effects can act together, so that these do not add up to 1"),
    ("may be chance", "the 90 % interval of the change includes 0"),
    ("stands out", "more probably than not farther from the nominal number than robots usually are"),
)


def page(result: Diagnosis) -> str:
    """The page as text."""
    v, cells = result.verdict, result.cells
    body = [
        _warnings(v),
        _head(result),
        beside(_where(result), _gaps(v)),
        boxed("Differences", words.sentence(words.otherwise(v)), _differences(v)),
        _unknown(v),
        _walk(v),
        _calibration(v),
    ]
    if cells:
        maps = figures.gap_maps(cells, result.board.robot.joint_names)
        body.append(boxed("Gap map", figures.note(cells), beside(*maps)))
    body += [_limits(v), _timeline(v)]
    notes = listed((*map(words.sentence, v.held), *v.notes))
    body += [boxed("Notes", "", notes), boxed("Terms", "", folded("What the words mean", facts(TERMS)))]
    return framed("Diagnosis", body, STYLE)


def _warnings(v: Verdict) -> str:
    told = listed(map(words.sentence, v.warnings))
    return f"<section class='warning'><h2>Read this first</h2>{told}</section>" if v.warnings else ""


def _head(result: Diagnosis) -> str:
    v = result.verdict
    names = sorted({run.header.command_sequence or "unnamed" for run in result.runs})
    seconds = sum(run.duration_s for run in result.runs)
    meta = f"{counted(len(v.logs), 'log')}, {seconds:.0f} s ({', '.join(names)}) · nominal: {v.nominal or 'given'}"
    meta += f" · {counted(len(v.without), 'effect')} left out of the library" if v.without else ""
    colour = "partly_explained" if v.status == "explained" and not is_good(v) else v.status
    answer, _, step = (v.headline or headline(v)).partition(NEXT)
    parts, n_first = answer.split("; "), max(1, min(len(v.differences), MOST_NAMED))
    lead = [*parts[n_first:], *([] if v.differences else [words.otherwise(v)])]
    lines = [" ".join(map(words.sentence, lead)), words.sentence(f"next: {step}")]
    badge = BADGES[v.status]
    if v.status == "calibration" and words.is_without_cause(v):
        badge = "No cause found"
    elif any(len(d.group) > 1 for d in v.differences):
        badge = badge.replace("found", "narrowed down")
    return headed(badge, colour, "; ".join(parts[:n_first]), filter(None, lines), meta)


def _where(result: Diagnosis) -> str:
    """The gap of each joint, of the first signal that has one."""
    v, robot = result.verdict, tuple(result.board.robot.joint_names)
    named = {j for d in v.differences for j in words.joints_of(d) or (words.BODY,)}
    named |= set(v.unknown.joints if v.unknown is not None else ())
    whole = [c for c in result.cells or v.where if c.regime == "all" and c.joint in robot]
    signal = next((s for s in figures.SIGNALS if any(c.signal == s for c in whole)), "")
    by_joint = {c.joint: c for c in whole if c.signal == signal}
    cells = tuple(by_joint.values())
    if not cells or v.status == "no_gap":
        return ""  # Of a right model, colours would show differences that are none.
    about = f"Colour: the nominal model's gap in {signal}, {figures.meaning(cells)}."
    if robot != JOINT_NAMES:
        return boxed("Where", about, "".join(figures.gap_maps(cells, robot)))
    about += " What the verdict names is framed in blue." if named else ""
    return boxed("Where", about, figures.picture(by_joint, named))


def _gaps(v: Verdict) -> str:
    """What the corrected model makes of each gap."""
    c = words.whole(v)
    if c is None or not c.gaps:
        return ""
    repeats = "two simulated runs" if v.shrink is not None and v.shrink.floor_of == "model" else "two runs of the robot"
    floor = repeats if c.loop == "closed" else "what noise and formulas leave"
    key = legend(zip(figures.COLOURS, ("nominal model", "corrected model", floor), strict=True))
    told = listed(words.sentence(words.gap_told(g)) for g in c.gaps)
    return boxed("Distance from the robot", _measured_on(v, c), f"{key}{figures.gap_bars(c)}{told}")


def _measured_on(v: Verdict, c: Consequences) -> str:
    """How consequences were measured."""
    if c.loop == "open":
        return "Logged signals are predicted from each other, in folds that nothing was fitted to."
    if v.shrink is not None and not v.shrink.held_out:
        return "The policy runs on both models, with the commands to which the corrected one was fitted."
    return "The policy runs on both models, on command sequences that nothing was fitted to."


def _differences(v: Verdict) -> str:
    """A row each; below, what could stand in its place and where the evidence is."""
    rows: list[tuple[object, ...]] = []
    for d in v.differences:
        sizes = {place: "; ".join(words.size_told(*n) for n in own.items()) for place, own in d.by_type.items()}
        whole = "; ".join(words.size_told(*n) for n in d.parameters.items())
        where, does = words.joints_in_short(words.joints_of(d)), words.does(d.consequences)
        rows.append((words.called(d), where, whole, _unbroken(f"{d.probability:.2f}"), does))
        rows += [("", words.place(place), size, "", "") for place, size in sizes.items()]
    head = ("what", "where", "size (90 % interval)", "P", "what it does")
    return f"{table(head, rows)}{''.join(map(_group, v.differences))}" if rows else ""


def _group(d: Difference) -> str:
    """Rivals, how to part them, and where the evidence is."""
    out = ""
    if len(d.group) > 1:
        hand = f" Besides: {d.split.by_hand}." if d.split is not None and d.split.by_hand else ""
        command = f"<pre>{esc(d.split.command)}</pre>" if d.split is not None and d.split.command else ""
        others = ", ".join(f"{words.plain(n)} (P {d.rivals.get(n, 0.0):.2f})" for n in d.group[1:])
        told = f"<p>In place of {esc(d.title or words.plain(d.name))}, these logs allow <b>{esc(others)}</b>."
        out += f"{told} To tell them apart: {esc(d.split_by + hand)}</p>{command}"
    total = sum(g for g in d.channels.values() if g > 0.0)
    shown = [(c, g) for c, g in sorted(d.channels.items(), key=lambda x: -x[1]) if g > 0.005 * total]
    evidence = ", ".join(f"{CHANNEL_TITLES.get(c, c)} {100 * g / total:.0f} %" for c, g in shown)
    return out + (f"<p class='note'>{esc(words.sentence(f'{d.title} shows in {evidence}'))}</p>" if evidence else "")


def _unknown(v: Verdict) -> str:
    if v.unknown is None:
        return ""
    about = (
        f"Probability of an effect that the library lacks: {v.probability_unknown:.2f}. Sizes are root mean squares."
    )
    add = "<p>Write it as an effect, and diagnose again with <code>--add-effect module:Class</code>.</p>"
    return boxed("What no effect explains", about, f"<p>{esc(words.sentence(words.unknown_told(v.unknown)))}</p>{add}")


def _walk(v: Verdict) -> str:
    """What the corrected model changes in the walk."""
    c = words.whole(v)
    rows = []
    for q in c.changes if c is not None else ():
        unit, scale = {"rad": ("°", float(np.degrees(1.0)))}.get(q.unit, (q.unit, 1.0))
        unit, scale = ("%", 100.0) if q.quantity == "fall_share" else (unit, scale)
        values = (_unbroken("—" if x is None else words.number(scale * x)) for x in (q.before, q.after, q.robot))
        rows.append((f"{q.title}, {unit}", *values, words.change_told(q)))
    head = ("quantity", "nominal model", "corrected model", "robot", "change from nominal to corrected")
    about = "The policy on both models and on the robot, with the same commands; compare/compare.html shows one log."
    return boxed("How the walk changes", about, table(head, rows))


def _unbroken(told: str) -> Html:
    return Html(f"<span style='white-space:nowrap'>{esc(told)}</span>")


def _calibration(v: Verdict) -> str:
    numbers = sorted(v.calibration.numbers, key=lambda n: not n.stands_out)
    n_out = sum(n.stands_out for n in numbers)
    first = max(n_out, MOST_NUMBERS)
    about = f"{counted(len(numbers), 'number')} of the robot's own beside the nominal ones; "
    about += f"{n_out} {'stands' if n_out == 1 else 'stand'} out."
    shown = _numbers(numbers[:first])
    if numbers[first:]:
        shown += folded(f"{len(numbers) - first} more", _numbers(numbers[first:]))
    kinds = [f"{words.plain(effect)}: {does}" for effect, c in v.calibration.effects.items() if (does := words.does(c))]
    shown += f"<h3>What each kind of number does</h3>{listed(kinds)}" if kinds else ""
    return boxed("Calibration", about, shown)


def _numbers(numbers: list[CalibratedNumber]) -> str:
    rows = [
        (
            n.title,
            words.place(n.where),
            words.number(n.nominal, n.unit),
            words.number(n.value, n.unit, n.low, n.high),
            f"{n.probability:.2f}",
        )
        for n in numbers
    ]
    css = ["out" if n.stands_out else "" for n in numbers]
    head = ("number", "where", "nominal", "robot (90 % interval)", "P(out of the ordinary)")
    return table(head, rows, row_classes=css)


def _limits(v: Verdict) -> str:
    content = "<h3>Record next</h3>" + listed(v.log_advice, "ol") if v.log_advice else ""
    if v.invisible:
        chips = "".join(f"<span class='chip off'>{esc(words.plain(n))}</span>" for n in v.invisible)
        content += f"<h3>Invisible in these logs</h3><p class='note'>No signal shows these effects.</p>{chips}"
    off = [(CHANNEL_TITLES.get(n, n), why.removeprefix("off: ")) for n, why in v.channels.items() if why != "used"]
    content += f"<h3>Channels that are off</h3>{facts(off)}" if off else ""
    return boxed("Limits", "", content)


def _timeline(v: Verdict) -> str:
    rows = [(s.log, f"{s.start_s:.1f} to {s.end_s:.1f} s", s.reason) for s in v.timeline]
    told = folded(f"{len(rows)} parts of logs", table(("log", "when", "why"), rows)) if rows else ""
    return boxed("Logs over time", "What was cut out, and seconds that carry much of the gap.", told)
