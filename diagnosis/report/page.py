"""One self-contained page of a diagnosis: opens from disk, needs no network, light or dark."""

from __future__ import annotations

from typing import Final

import numpy as np

from diagnosis.channels import CHANNEL_TITLES
from diagnosis.document import CalibratedNumber, Consequences, Difference, Verdict
from diagnosis.report import figures, words
from diagnosis.report.headline import MOST_NAMED, NEXT, headline, is_good
from diagnosis.verdict.diagnose import Diagnosis
from spot_log.page.render import rendered
from spot_log.page.sections import Beside, Content, Fold, Head, Items, Legend, Mark, Section, SpotMap, Table
from spot_model.robot.facts import JOINT_NAMES
from spot_model.text import counted

BADGES: Final = {
    "explained": ("Cause found", "good"),
    "partly_explained": ("Cause found, more is left", "fair"),
    "unknown_effect": ("Something unknown", "unknown"),
    "calibration": ("Calibration", "none"),
    "no_gap": ("No gap", "none"),
    "cannot_tell": ("Cannot tell", ""),
}
"""A word and its kind."""
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
    maps = Beside(figures.gap_maps(cells, result.board.robot.joint_names))
    notes = Items((*map(words.sentence, v.held), *v.notes))
    parts = [
        Section("Read this first", "", Items(map(words.sentence, v.warnings)), "warning"),
        _head(result),
        Beside([_where(result), _gaps(v)]),
        Section("Differences", words.sentence(words.otherwise(v)), _differences(v)),
        _unknown(v),
        _walk(v),
        _calibration(v),
        Section("Gap map", figures.note(cells), maps) if cells else None,
        Section("Limits", "", _limits(v)),
        Section("Logs over time", "What was cut out, and seconds that carry much of the gap.", _timeline(v)),
        Section("Notes", "", notes),
        Section("Terms", "", Fold("What the words mean", Table((), TERMS))),
    ]
    return rendered("Diagnosis", parts)


def _head(result: Diagnosis) -> Head:
    v = result.verdict
    names = sorted({run.header.command_sequence or "unnamed" for run in result.runs})
    seconds = sum(run.duration_s for run in result.runs)
    meta = f"{counted(len(v.logs), 'log')}, {seconds:.0f} s ({', '.join(names)}) · nominal: {v.nominal or 'given'}"
    meta += f" · {counted(len(v.without), 'effect')} left out of the library" if v.without else ""
    badge, kind = BADGES[v.status]
    kind = "fair" if v.status == "explained" and not is_good(v) else kind
    answer, _, step = (v.headline or headline(v)).partition(NEXT)
    parts, n_first = answer.split("; "), max(1, min(len(v.differences), MOST_NAMED))
    lead = [*parts[n_first:], *([] if v.differences else [words.otherwise(v)])]
    lines = [" ".join(map(words.sentence, lead)), words.sentence(f"next: {step}")]
    if v.status == "calibration" and words.is_without_cause(v):
        badge = "No cause found"
    elif any(len(d.group) > 1 for d in v.differences):
        badge = badge.replace("found", "narrowed down")
    return Head(badge, kind, "; ".join(parts[:n_first]), lines, meta)


def _where(result: Diagnosis) -> Content:
    """The gap of each joint, of the first signal that has one."""
    v, robot = result.verdict, tuple(result.board.robot.joint_names)
    named = {j for d in v.differences for j in words.joints_of(d) or (words.BODY,)}
    named |= set(v.unknown.joints if v.unknown is not None else ())
    whole = [c for c in result.cells or v.where if c.regime == "all" and c.joint in robot]
    signal = next((s for s in figures.SIGNALS if any(c.signal == s for c in whole)), "")
    cells = [c for c in whole if c.signal == signal]
    if not cells or v.status == "no_gap":
        return None  # Of a right model, colours would show differences that are none.
    about = f"Colour: the nominal model's gap in {signal}, {figures.meaning(cells)}."
    if robot != JOINT_NAMES:
        return Section("Where", about, figures.gap_maps(cells, robot))
    about += " What the verdict names is framed in blue." if named else ""
    coloured = {c.joint: figures.coloured(c, cells) for c in cells}
    return Section("Where", about, SpotMap(coloured, named, figures.scale(cells)))


def _gaps(v: Verdict) -> Content:
    """What the corrected model makes of each gap."""
    c = words.whole_change(v)
    if c is None or not c.gaps:
        return None
    repeats = "two simulated runs" if v.shrink is not None and v.shrink.floor_of == "model" else "two runs of the robot"
    least = repeats if c.loop == "closed" else "what noise and formulas leave"
    key = Legend(zip(figures.COLOURS, ("nominal model", "corrected model", least), strict=True))
    told = Items(words.sentence(words.gap_phrase(g)) for g in c.gaps)
    return Section("Distance from the robot", _measured_on(v, c), [key, figures.gap_bars(c), told])


def _measured_on(v: Verdict, c: Consequences) -> str:
    """How consequences were measured."""
    if c.loop == "open":
        return "Logged signals are predicted from each other, in folds that nothing was fitted to."
    if v.shrink is not None and not v.shrink.held_out:
        return "The policy runs on both models, with the commands to which the corrected one was fitted."
    return "The policy runs on both models, on command sequences that nothing was fitted to."


def _differences(v: Verdict) -> Content:
    """A row each; below, what could stand in its place and where the evidence is."""
    rows: list[tuple[object, ...]] = []
    for d in v.differences:
        sizes = {place: "; ".join(words.size_phrase(*n) for n in own.items()) for place, own in d.by_type.items()}
        whole = "; ".join(words.size_phrase(*n) for n in d.parameters.items())
        where, does = words.joints_in_short(words.joints_of(d)), words.does(d.consequences)
        rows.append((words.called(d), where, whole, Mark(f"{d.probability:.2f}", "number"), does))
        rows += [("", words.place(place), size, "", "") for place, size in sizes.items()]
    head = ("what", "where", "size (90 % interval)", "P", "what it does")
    return [Table(head, rows), *(_group(d) for d in v.differences)]


def _group(d: Difference) -> Content:
    """Rivals, how to part them, and where the evidence is."""
    parts: list[Content] = []
    if len(d.group) > 1:
        hand = f" Besides: {d.split.by_hand}." if d.split is not None and d.split.by_hand else ""
        others = ", ".join(f"{words.plain_name(n)} (P {d.rivals.get(n, 0.0):.2f})" for n in d.group[1:])
        about = f"In place of {d.title or words.plain_name(d.name)}, these logs allow "
        parts.append((about, Mark(others), f". To tell them apart: {d.split_by}{hand}"))
        parts.append(Mark(d.split.command if d.split is not None else "", "pre"))
    total = sum(g for g in d.channels.values() if g > 0.0)
    shown = [(c, g) for c, g in sorted(d.channels.items(), key=lambda x: -x[1]) if g > 0.005 * total]
    evidence = ", ".join(f"{CHANNEL_TITLES.get(c, c)} {100 * g / total:.0f} %" for c, g in shown)
    return [*parts, Mark(words.sentence(f"{d.title} shows in {evidence}") if evidence else "", "note")]


def _unknown(v: Verdict) -> Content:
    if v.unknown is None:
        return None
    about = f"Probability of an effect that the library lacks: {v.probability_unknown:.2f}. "
    about += "Sizes are root mean squares."
    add = ("Write it as an effect, and diagnose again with ", Mark("--add-effect module:Class", "code"), ".")
    return Section("What no effect explains", about, [words.sentence(words.unknown_phrase(v.unknown)), add])


def _walk(v: Verdict) -> Section:
    """What the corrected model changes in the walk."""
    c, rows = words.whole_change(v), []
    for q in c.changes if c is not None else ():
        unit, scale = {"rad": ("°", float(np.degrees(1.0)))}.get(q.unit, (q.unit, 1.0))
        unit, scale = ("%", 100.0) if q.quantity == "fall_share" else (unit, scale)
        values = ("—" if x is None else words.number(scale * x) for x in (q.before, q.after, q.robot))
        rows.append((f"{q.title}, {unit}", *(Mark(x, "number") for x in values), words.change_phrase(q)))
    head = ("quantity", "nominal model", "corrected model", "robot", "change from nominal to corrected")
    about = "The policy on both models and on the robot, with the same commands; compare/compare.html shows one log."
    return Section("How the walk changes", about, Table(head, rows))


def _calibration(v: Verdict) -> Section:
    numbers = sorted(v.calibration.numbers, key=lambda n: not n.stands_out)
    n_out = sum(n.stands_out for n in numbers)
    first = max(n_out, MOST_NUMBERS)
    about = f"{counted(len(numbers), 'number')} of the robot's own beside the nominal ones; "
    about += f"{n_out} {'stands' if n_out == 1 else 'stand'} out."
    more = Fold(f"{len(numbers) - first} more", _numbers(numbers[first:]))
    kinds = [
        f"{words.plain_name(effect)}: {does}" for effect, c in v.calibration.effects.items() if (does := words.does(c))
    ]
    what = Section("What each kind of number does", "", Items(kinds))
    return Section("Calibration", about, [_numbers(numbers[:first]), more, what])


def _numbers(numbers: list[CalibratedNumber]) -> Table:
    rows = []
    for n in numbers:
        nominal, own = words.number(n.nominal, n.unit), words.number(n.value, n.unit, n.low, n.high)
        rows.append((n.title, words.place(n.where), nominal, own, f"{n.probability:.2f}"))
    head = ("number", "where", "nominal", "robot (90 % interval)", "P(out of the ordinary)")
    return Table(head, rows, ["out" if n.stands_out else "" for n in numbers])


def _limits(v: Verdict) -> list[Section]:
    chips = tuple(Mark(words.plain_name(n), "chip") for n in v.invisible)
    off = [(CHANNEL_TITLES.get(n, n), why.removeprefix("off: ")) for n, why in v.channels.items() if why != "used"]
    return [
        Section("Record next", "", Items(v.log_advice, is_numbered=True)),
        Section("Invisible in these logs", "No signal shows these effects.", chips),
        Section("Channels that are off", "", Table((), off)),
    ]


def _timeline(v: Verdict) -> Fold:
    rows = [(s.log, f"{s.start_s:.1f} to {s.end_s:.1f} s", s.reason) for s in v.timeline]
    return Fold(f"{len(rows)} parts of logs", Table(("log", "when", "why"), rows))
