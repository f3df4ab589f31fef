"""One self-contained page of a diagnosis: opens from disk, needs no network, light or dark."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from diagnosis.channels.channel import CHANNEL_TITLES
from diagnosis.document import FoundEffect, GapCell, Verdict
from diagnosis.report import bars, words
from diagnosis.report.effect_file import formula_text
from diagnosis.report.gap_map import gap_map_figure, note
from diagnosis.report.lines import dependence
from diagnosis.report.robot_picture import picture
from diagnosis.report.scale import has_floor, share_of, told
from diagnosis.report.strips import strips
from diagnosis.report.trace_choice import trace_figure
from diagnosis.terminal import joints_in_short
from diagnosis.verdict.diagnose import Diagnosis
from spot_log.page.cells import facts
from spot_log.page.look import boxed, framed
from spot_log.page.svg import esc, legend
from spot_model.robot.facts import JOINT_NAMES
from spot_model.text import counted

COLOURS = (
    ("var(--real)", "real"),
    ("var(--nominal)", "nominal model"),
    ("var(--corrected)", "corrected model"),
)


MOST_NAMED: Final = 6
"""Effects that were left out and are named on the page; the verdict lists all."""
TERMS: Final = (
    ("nominal model", "your simulator, before any correction"),
    ("corrected model", "the simulator with the effects found, in corrected_model.yaml"),
    ("gap", "distance between real and simulated runs of the same commands"),
    ("floor", "the same distance between two real runs, or, where none was repeated, between two simulated ones"),
    ("closed loop", "a simulated run in which the policy controls the simulated robot"),
    ("ordinary errors", "small errors of gains, masses, friction and sensors that every robot has; no finding"),
    ("channel", "one relation between signals of a log, such as set-point to load"),
    ("held out", "not used for fitting, so that it tests the fit"),
    ("nats", "evidence: the natural logarithm of the odds; 3 nats are odds of 20 to 1"),
)


def page(result: Diagnosis) -> str:
    """The page as text.

    Args:
        result: The diagnosis.
    """
    v = result.verdict
    cells = result.map.cells if result.map is not None else ()
    named = frozenset(j for e in v.effects for j in e.joints) | frozenset(v.unknown.joints if v.unknown else ())
    by_joint = _by_joint(cells)
    body = [
        _head(result),
        "<div class='two'>",
        _where(result, by_joint, named),
        boxed("Which effect", _which_note(v), bars.ranking(v)),
        "</div>",
        _shrink(v),
        _effects(v),
        _seen(v),
        _unknown(v),
        _traces(result, by_joint, named),
    ]
    if cells:
        body.append(boxed("Gap map", note(cells), gap_map_figure(cells, result.board.robot.joint_names)))
    body += [_limits(v), _channels(v), _timeline(result)]
    if v.notes:
        body.append(boxed("Notes", "", _list(v.notes)))
    body.append(boxed("Terms", "", f"<details><summary>What the words mean</summary>{facts(TERMS)}</details>"))
    return framed("Diagnosis", body)


def _list(items: Iterable[str], tag: str = "ul") -> str:
    return f"<{tag}>" + "".join(f"<li>{esc(i)}</li>" for i in items) + f"</{tag}>"


def _head(result: Diagnosis) -> str:
    v = result.verdict
    names = sorted({run.header.command_sequence or "unnamed" for run in result.runs})
    seconds = sum(run.duration_s for run in result.runs)
    more = f" and {len(v.without) - MOST_NAMED} more" if len(v.without) > MOST_NAMED else ""
    left_out = f" · left out of the library: {', '.join(v.without[:MOST_NAMED])}{more}" if v.without else ""
    return (
        f"<section><span class='badge {_colour(v)}'>{esc(words.BADGES[v.status])}</span>"
        f"<h1>{esc(words.headline(v))}</h1><p class='lead'>{esc(words.second_line(v))}</p>"
        f"<p class='meta' style='margin-top:12px'>{counted(len(v.logs), 'log')}, {seconds:.0f} s, of "
        f"{counted(len(names), 'command sequence')} ({esc(', '.join(names))}) · nominal model: "
        f"{esc(v.nominal or 'given')}{esc(left_out)}</p></section>"
    )


def _colour(v: Verdict) -> str:
    """Class of the badge: an explanation is green only if it is probable and closes the gap."""
    return "partly_explained" if v.status == "explained" and not words.is_green(v) else v.status


def _by_joint(cells: tuple[GapCell, ...]) -> dict[str, GapCell]:
    """The cell that colours a joint: all regimes, of the load's error, else the load, else the velocity."""
    for signal in ("load error", "load", "velocity"):
        found = {c.joint: c for c in cells if c.signal == signal and c.regime == "all"}
        if found:
            return found
    return {}


def _where(result: Diagnosis, by_joint: dict[str, GapCell], named: frozenset[str]) -> str:
    largest = max((c.gap for c in by_joint.values()), default=0.0)
    shares = {j: share_of(c, largest) for j, c in by_joint.items()}
    ringed = " A blue ring marks a joint that the verdict names." if named else ""
    if not by_joint:
        listed = f"<p>The verdict names {esc(joints_in_short(tuple(sorted(named))))}.</p>" if named else ""
        return boxed("Where", "The nominal model was not run in closed loop, so the gap has no figures.", listed)
    signal = next(iter(by_joint.values())).signal
    about = f"Gap of the {signal} over the whole motion.{ringed}"
    if tuple(result.board.robot.joint_names) == JOINT_NAMES:
        tips = {j: told(c) for j, c in by_joint.items()}
        figure = picture(shares, tips, named, in_floors=has_floor(tuple(by_joint.values())))
        return boxed("Where", about, figure)
    gaps = {j: c.ratio if c.ratio is not None else c.gap for j, c in by_joint.items()}
    return boxed("Where", about, bars.by_joint(gaps, shares, named))


def _which_note(v: Verdict) -> str:
    if not v.effects:
        return "Nothing in the library is found."
    drawn = {colour for _, _, colour in bars.ranked(v)}
    told = [words for colour, words in bars.MEANING.items() if colour in drawn]
    return f"{' '.join(told)} Several can be there at once, so these need not add up to 1."


def _shrink(v: Verdict) -> str:
    s = v.shrink
    if s is None:
        return ""
    fitted = (
        f"For each command sequence ({', '.join(s.held_out)}), the sizes of the effects were fitted to the other ones; "
        "which effects act was chosen on all, and corrected_model.yaml is fitted to all."
        if s.held_out
        else "The corrected model was fitted to these same logs."
    )
    own = bars.FLOORS[s.floor_of]
    alone = "" if s.floor_of == "robot" else " (the robot repeated no command sequence)"
    about = (
        f"The policy runs in closed loop on the nominal model and on the corrected one. {fitted} 100 % means that the "
        f"simulator is as close to the robot as {own} are to each other{alone}."
    )
    left = bars.shrink_line(s) or "<p>The gap does not exceed its floor: there is nothing to shrink.</p>"
    placebo = ""
    if s.placebo is not None:
        placebo = (
            f"<p class='note'>For comparison, {esc(words.plain(s.placebo.name))} close {100 * s.placebo.s:.0f} %.</p>"
        )
    key = legend(
        (
            ("var(--nominal)", "nominal"),
            ("var(--corrected)", "with the effects"),
            ("var(--floor)", own),
        )
    )
    content = f"<div class='two' style='margin:0'><div>{left}{placebo}</div><div>{key}{bars.gap_bars(s)}</div></div>"
    return boxed("How much of the gap closes", about, content)


def _effects(v: Verdict) -> str:
    return boxed("The effects found", "", "".join(_effect(e) for e in v.effects)) if v.effects else ""


def _effect(e: FoundEffect) -> str:
    group = ""
    if len(e.group) > 1:
        hand = f" Besides: {esc(e.split.by_hand)}." if e.split is not None and e.split.by_hand else ""
        command = f"<pre>{esc(e.split.command)}</pre>" if e.split is not None and e.split.command else ""
        group = (
            f"<p>These logs cannot rule out <b>{esc(', '.join(words.plain(n) for n in e.group[1:]))}</b>. "
            f"To distinguish them: {esc(e.split_by)}{hand}</p>{command}"
        )
    total = sum(g for g in e.channels.values() if g > 0.0)
    channels = ", ".join(
        f"{CHANNEL_TITLES.get(c, c)} {100 * g / total:.0f} %"
        for c, g in sorted(e.channels.items(), key=lambda x: -x[1])
        if g > 0.005 * total
    )
    evidence = f"<p class='note'>Where it shows: {esc(channels)}</p>" if channels else ""
    return (
        f"<h3>{esc(e.title or words.plain(e.name))} <code>{esc(e.name)}</code> at {esc(joints_in_short(e.joints))}, "
        f"probability {e.probability:.2f}</h3>{bars.parameters(e)}{group}{evidence}"
    )


def _unknown(v: Verdict) -> str:
    u = v.unknown
    if u is None or not u.joints:
        return ""
    about = (
        f"At {joints_in_short(u.joints)}, largest in {u.regime or 'all regimes'}; {100 * u.predictable_share:.0f} % of "
        f"the rest is predictable from {' and '.join(u.depends_on)}."
    )
    told = "<p>Write it as an effect, and diagnose again with <code>--add-effect module:Class</code>.</p>"
    if u.formula is not None:
        told = (
            f"<p><b>{esc(formula_text(u.formula))}</b> (q angle in rad, v speed in rad/s, τ torque) predicts "
            f"{100 * u.formula.predicted_share:.0f} % of it, in runs that it was not fitted to. Diagnose again with "
            "<code>--add-effect unknown_effect:UnknownTorque</code>.</p>"
        )
    figures = "".join(f"<div>{dependence(c, u.unit)}</div>" for c in u.curves)
    return boxed("What no effect explains", about, f"{told}<div class='two' style='margin:0'>{figures}</div>")


def _seen(v: Verdict) -> str:
    if not v.seen:
        return ""
    told = []
    for s in v.seen:
        values = ", ".join(f"{words.parameter(n)} {p.value:.3g} {p.unit}".strip() for n, p in s.parameters.items())
        told.append(f"{s.title or words.plain(s.name)} at {joints_in_short(s.joints)}: {values}.")
    about = "The logs show these, but they hardly change the simulated motion."
    return boxed("Seen, does not matter here", about, _list(told))


def _traces(result: Diagnosis, by_joint: dict[str, GapCell], named: frozenset[str]) -> str:
    found = trace_figure(result, {j: c.ratio or c.gap for j, c in by_joint.items()}, named)
    if found is None:
        return ""
    where, figure, shift = found
    has_corrected = bool(result.simulated.get("corrected"))
    key = legend(COLOURS if has_corrected else COLOURS[:2])
    return boxed("Traces", f"{where}. {shift}", key + figure)


def _limits(v: Verdict) -> str:
    content = "<h3>Record next</h3>" + _list(v.log_advice, "ol") if v.log_advice else ""
    if v.invisible:
        chips = "".join(f"<span class='chip off'>{esc(words.plain(n))}</span>" for n in v.invisible)
        content += f"<h3>Invisible in these logs</h3><p class='note'>No signal shows these effects.</p>{chips}"
    return boxed("What these logs cannot tell, and what to record next", "", content) if content else ""


def _channels(v: Verdict) -> str:
    rows = []
    total = sum(max(0.0, g) for e in v.effects for g in e.channels.values())
    for name, state in v.channels.items():
        gain = sum(max(0.0, e.channels.get(name, 0.0)) for e in v.effects)
        evidence = f"{100 * gain / total:.0f} % of the evidence for what was found" if gain > 0.005 * total else ""
        mark = "<b style='color:var(--good)'>on</b>" if state == "used" else f"<span>{esc(state)}</span>"
        title = esc(CHANNEL_TITLES.get(name, name))
        rows.append(f"<tr><th>{title}</th><td>{mark}</td><td>{evidence}</td></tr>")
    return boxed("Channels", "", f"<table>{''.join(rows)}</table>")


def _timeline(result: Diagnosis) -> str:
    key = legend(
        (
            ("var(--corrected)", "used"),
            ("var(--nominal)", "carries much of the gap"),
            ("var(--empty)", "cut out: no command, start, fall, not following"),
        )
    )
    return boxed("Logs over time", "", key + strips(result.runs, result.verdict.timeline))
