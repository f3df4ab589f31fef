"""One self-contained page of a diagnosis: opens from disk, needs no network, light or dark."""

from __future__ import annotations

from typing import Final

import numpy as np

from diagnosis.channels import CHANNEL_TITLES
from diagnosis.document import CalibratedNumber, Consequences, Difference, GapCell, Verdict
from diagnosis.report import figures, words
from diagnosis.report.figures import picture
from diagnosis.report.traces import trace_figures
from diagnosis.verdict.diagnose import Diagnosis
from spot_log.page.look import Html, beside, boxed, facts, folded, framed, headed, listed, table
from spot_log.page.svg import esc, legend
from spot_model.robot.facts import JOINT_NAMES
from spot_model.text import counted

COLOURS: Final = (
    ("var(--real)", "real"),
    ("var(--nominal)", "nominal model"),
    ("var(--corrected)", "corrected model"),
)
STYLE: Final = """
.calibration { background: #2f6fb5; } .warning { border: 2px solid var(--bad); }
section > svg:not(.wide) { max-width: 576px; margin: 0 auto; }
td svg { width: 200px; } .out td { font-weight: 600; } td.number { text-align: left; }
"""
MOST_NAMED: Final = 6
"""Effects that were left out and are named on the page; the verdict lists all."""
MOST_NUMBERS: Final = 12
"""Numbers of the robot's own that are shown unfolded, if not more stand out."""
TERMS: Final = (
    ("nominal model", "your simulator, before any correction; in a history the corrected model of the date before"),
    ("corrected model", "the simulator with differences and calibration, in corrected_model.yaml"),
    ("gap", "distance between robot and simulator: in torque, in joint motion and in body motion"),
    (
        "floor",
        "the distance between two runs of the robot, or 2 % of the signal's spread if more; else what formulas leave",
    ),
    ("closed loop", "a simulated run in which the policy controls the simulated robot"),
    ("open loop", "logged signals are predicted from each other"),
    ("not shown", "the 90 % interval of the change includes 0"),
    ("channel", "one relation between signals of a log, such as set-point to load"),
    ("held out", "not used for fitting, so that it tests the fit"),
    ("out of the ordinary", "farther from the nominal number than robots usually are"),
    ("stands out", "more probably out of the ordinary than not"),
)


def page(result: Diagnosis) -> str:
    """The page as text."""
    v = result.verdict
    cells = result.cells
    named = frozenset(j for d in v.differences for j in d.joints) | frozenset(v.unknown.joints if v.unknown else ())
    by_joint = _by_joint(cells or v.where)
    body = [
        _warnings(v),
        _head(result),
        beside(_where(result, by_joint, named), _together(v)),
        _changes_of_all(v),
        boxed("Differences", words.probabilities(v), "".join(map(_difference, v.differences))),
        _calibration(v),
        _remains(v),
        _traces(result, by_joint, named),
    ]
    if cells:
        body.append(
            boxed("Gap map", figures.note(cells), beside(*figures.gap_maps(cells, result.board.robot.joint_names)))
        )
    body += [_limits(v), beside(_channels(v), _timeline(result))]
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
    more = f" and {len(v.without) - MOST_NAMED} more" if len(v.without) > MOST_NAMED else ""
    left_out = f" · left out of the library: {', '.join(v.without[:MOST_NAMED])}{more}" if v.without else ""
    meta = f"{counted(len(v.logs), 'log')}, {seconds:.0f} s, of {counted(len(names), 'command sequence')} "
    meta += f"({', '.join(names)}) · nominal model: {v.nominal or 'given'}{left_out}"
    colour = "partly_explained" if v.status == "explained" and not words.is_good(v) else v.status
    lead = [] if v.differences else [words.probabilities(v)]
    badge = v.status.replace("_", " ").capitalize()
    return headed(badge, colour, v.headline or words.headline(v), lead, meta)


def _by_joint(cells: tuple[GapCell, ...]) -> dict[str, GapCell]:
    """The cell that colours a joint: all regimes, of the load's error, else the load, else the velocity."""
    for signal in ("load error", "load", "velocity"):
        found = {c.joint: c for c in cells if c.signal == signal and c.regime == "all"}
        if found:
            return found
    return {}


def _where(result: Diagnosis, by_joint: dict[str, GapCell], named: frozenset[str]) -> str:
    cells = tuple(by_joint.values())
    if not cells:
        names = f"<p>The verdict names {esc(words.joints_in_short(sorted(named)))}.</p>" if named else ""
        return boxed("Where", "The gap has no figures by joint.", names)
    shares = {j: figures.share_of(c, max(c.gap for c in cells)) for j, c in by_joint.items()}
    ringed = " A blue ring marks a joint that the verdict names." if named else ""
    if tuple(result.board.robot.joint_names) == JOINT_NAMES:
        drawn = picture(shares, {j: figures.told(c) for j, c in by_joint.items()}, named, figures.scale(cells))
    else:
        drawn = figures.by_joint(by_joint, shares, named)
    return boxed("Where", f"Gap of the {cells[0].signal} over the whole motion.{ringed}", drawn)


def _together(v: Verdict) -> str:
    """What the corrected model changes as a whole."""
    c = words.whole(v)
    if c is None:
        return ""
    key = legend(zip(figures.COLOURS, ("nominal model", "corrected model", _floor_of(v, c)), strict=True))
    told = listed(words.sentence(words.gap_in_units(g)) for g in c.gaps)
    title, about = "What the corrected model does", _measured_on(v, c)
    return boxed(title, f"{about} Each gap has its own scale.", f"{key}{figures.gap_bars(c)}{told}" if c.gaps else "")


def _measured_on(v: Verdict, c: Consequences) -> str:
    """How consequences were measured."""
    if c.loop == "open":
        return "Logged signals are predicted from each other, in folds that nothing was fitted to."
    if v.shrink is not None and not v.shrink.held_out:
        return (
            "The policy runs on both models. The commands are those of the logs to which the corrected one was fitted."
        )
    return "The policy runs on both models, on command sequences that nothing was fitted to."


def _floor_of(v: Verdict, c: Consequences) -> str:
    """What a floor is."""
    if c.loop == "open":
        return "what formulas and noise leave"
    if v.shrink is None:
        return "floor"
    return "two runs of the robot" if v.shrink.floor_of == "robot" else "two simulated runs"


def _changes_of_all(v: Verdict) -> str:
    """What the corrected model changes in the walk."""
    c = words.whole(v)
    if c is None:
        return ""
    same = "What the policy does on both models and on the robot, with the same commands."
    about = same if c.gaps else _measured_on(v, c)
    head = ("quantity", "nominal model", "corrected model", "robot", "change from nominal to corrected")
    return boxed("How the walk changes", about, table(head, _changes(c)))


def _changes(c: Consequences) -> list[tuple[str, ...]]:
    """Rows of speeds, power, torque, lean and falls."""
    rows = []
    for q in c.changes:
        unit, scale = {"rad": ("°", float(np.degrees(1.0)))}.get(q.unit, (q.unit, 1.0))
        unit, scale = ("%", 100.0) if q.quantity == "fall_share" else (unit, scale)
        values = (_figure(None if x is None else scale * x) for x in (q.before, q.after, q.robot))
        rows.append((f"{q.title}, {unit}", *values, words.change_told(q)))
    return rows


def _figure(value: float | None) -> Html:
    return Html("—" if value is None else f"<span style='white-space:nowrap'>{words.number(value)}</span>")


def _difference(d: Difference) -> str:
    rows = [
        (
            words.parameter(n),
            words.place(kind) or words.joints_in_short(d.joints),
            f"{p.value:.4g} {p.unit}",
            f"{p.low:.4g} to {p.high:.4g}",
        )
        for kind, numbers in {"": d.parameters, **d.by_type}.items()
        for n, p in numbers.items()
    ]
    title = (
        f"<h3>{esc(words.called(d))} <code>{esc(d.name)}</code> at "
        f"{esc(words.joints_in_short(d.joints))}, P {d.probability:.2f}</h3>"
    )
    c = d.consequences
    does = "<p class='note'>What it does could not be measured.</p>"
    if c is not None and (c.gaps or c.changes):
        gaps = [
            (f"{g.gap} gap, {g.unit}", *map(_figure, (g.before, g.after, g.floor)), words.gap_told(g)) for g in c.gaps
        ]
        last = "robot; of a gap, its floor" if gaps else "robot"
        head = ("quantity", "without it", "with it", last, "change")
        does = table(head, [*gaps, *_changes(c)])
    sizes = table(("size", "where", "value", "90 % interval"), rows)
    return f"{title}{sizes}{_group(d)}{does}"


def _group(d: Difference) -> str:
    """Rivals, how to part them, and where the evidence is."""
    out = ""
    if len(d.group) > 1:
        hand = f" Besides: {d.split.by_hand}." if d.split is not None and d.split.by_hand else ""
        command = f"<pre>{esc(d.split.command)}</pre>" if d.split is not None and d.split.command else ""
        others = ", ".join(words.plain(n) for n in d.group[1:])
        told = f"<p>These logs do not rule out <b>{esc(others)}</b> in its place."
        out += f"{told} To tell them apart: {esc(d.split_by + hand)}</p>{command}"
    likely = [(words.plain(n), p) for n, p in sorted(d.rivals.items(), key=lambda x: -x[1]) if p >= 0.005]
    if len(likely) > 1:
        rivals = "; ".join(f"{name} {p:.2f}" for name, p in likely)
        out += f"<p class='note'>Probability that it is this one: {esc(rivals)}.</p>"
    total = sum(g for g in d.channels.values() if g > 0.0)
    shown = [(c, g) for c, g in sorted(d.channels.items(), key=lambda x: -x[1]) if g > 0.005 * total]
    evidence = ", ".join(f"{CHANNEL_TITLES.get(c, c)} {100 * g / total:.0f} %" for c, g in shown)
    return out + (f"<p class='note'>Evidence by channel: {esc(evidence)}.</p>" if evidence else "")


def _calibration(v: Verdict) -> str:
    numbers = sorted(v.calibration.numbers, key=lambda n: not n.stands_out)
    n_out = sum(n.stands_out for n in numbers)
    first = max(n_out, MOST_NUMBERS)
    about = (
        f"{counted(len(numbers), 'number')} of the robot's own beside the nominal ones; {n_out} "
        f"{'stands' if n_out == 1 else 'stand'} out. The axis counts published standard deviations. The shade is "
        "two of them, and the red line is the nominal number."
    )
    shown = _numbers(numbers[:first])
    if numbers[first:]:
        shown += folded(f"{len(numbers) - first} more", _numbers(numbers[first:]))
    c = v.calibration.consequences
    if c is not None and shown and v.differences:
        told = "; ".join(map(words.gap_in_units, c.gaps))
        shown += f"<p>Without any difference, these numbers alone: {esc(told)}.</p>" if told else ""
    kinds = listed(f"{words.plain(effect)}: {_does(c)}" for effect, c in v.calibration.effects.items() if c.gaps)
    shown += f"<h3>What each kind of number does</h3>{kinds}" if kinds else ""
    return boxed("Calibration", about, shown)


def _does(c: Consequences) -> str:
    """What becomes of the gaps, and the change of the walk that a person notices most."""
    change = words.largest_change([c])
    return "; ".join([*map(words.gap_in_units, c.gaps), *([words.change_told(change)] if change is not None else [])])


def _numbers(numbers: list[CalibratedNumber]) -> str:
    rows = [
        (
            n.title,
            words.place(n.where),
            f"{n.nominal:.4g} {n.unit}".rstrip(),
            f"{n.value:.4g} ({n.low:.4g} to {n.high:.4g})",
            f"{n.probability:.2f}",
            Html(figures.interval(n)),
        )
        for n in numbers
    ]
    css = ["out" if n.stands_out else "" for n in numbers]
    head = ("number", "where", "nominal", "robot (90 % interval)", "P(out of the ordinary)", "")
    return table(head, rows, row_classes=css)


def _remains(v: Verdict) -> str:
    rows = [
        (
            g.gap,
            f"{words.number(g.left)} {g.unit}",
            f"{words.number(g.floor)} {g.unit}",
            "—" if g.ratio is None else f"{g.ratio:.1f}",
        )
        for g in v.remainder
    ]
    content = table(("gap", "left", "floor", "times its floor"), rows) + _unknown(v)
    return boxed("What remains", "What the corrected model leaves of each gap.", content)


def _unknown(v: Verdict) -> str:
    u = v.unknown
    if u is None:
        return ""
    return (
        f"<h3>What no effect explains</h3><p>{esc(words.sentence(words.unknown_told(u)))} Left and usual are root mean "
        f"squares. Probability of an effect that the library lacks: {v.probability_unknown:.2f}.</p>"
        "<p>Write it as an effect, and diagnose again with <code>--add-effect module:Class</code>.</p>"
    )


def _traces(result: Diagnosis, by_joint: dict[str, GapCell], named: frozenset[str]) -> str:
    found = trace_figures(result, {j: c.ratio or c.gap for j, c in by_joint.items()}, named)
    if found is None:
        return ""
    about, drawn = found
    key = legend(COLOURS if result.simulated.get("corrected") else COLOURS[:2])
    return boxed("Traces", about, key + beside(*drawn))


def _limits(v: Verdict) -> str:
    content = "<h3>Record next</h3>" + listed(v.log_advice, "ol") if v.log_advice else ""
    if v.invisible:
        chips = "".join(f"<span class='chip off'>{esc(words.plain(n))}</span>" for n in v.invisible)
        content += f"<h3>Invisible in these logs</h3><p class='note'>No signal shows these effects.</p>{chips}"
    return boxed("Limits", "", content)


def _channels(v: Verdict) -> str:
    rows = [
        (CHANNEL_TITLES.get(name, name), Html("<b style='color:var(--good)'>on</b>") if state == "used" else state)
        for name, state in v.channels.items()
    ]
    return boxed("Channels", "", facts(rows))


def _timeline(result: Diagnosis) -> str:
    kinds = {s.kind == "gap" for s in result.verdict.timeline}
    entries = [("var(--corrected)", "used")]
    entries += [("var(--nominal)", "carries much of the gap")] if True in kinds else []
    entries += [("var(--empty)", "cut out")] if False in kinds else []
    return boxed("Logs over time", "", legend(entries) + figures.strips(result.runs, result.verdict.timeline))
