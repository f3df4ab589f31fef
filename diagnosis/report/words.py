"""The verdict in sentences. Each is made from figures of the verdict, and says no more than they do.

A change whose interval holds 0 is *not shown*; a share that is null is not told; a gap closes only if it is smaller
afterwards. ``tests/diagnosis/test_words.py`` reads the sentences back and compares them with the figures.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

import numpy as np

from diagnosis.channels import CHANNEL_TITLES
from diagnosis.decision_constants import RUNS_APART
from diagnosis.document import (
    CalibratedNumber,
    Consequences,
    Difference,
    GapChange,
    GapLeft,
    GapName,
    Number,
    QuantityChange,
    UnknownEffect,
    Verdict,
)
from diagnosis.library.registry import LIBRARY
from diagnosis.library.repairs import size_of
from spot_model.robot.facts import JOINT_NAMES, JOINT_TYPES

PLACES: Final = {"hx": "sideways hips (hx)", "hy": "forward hips (hy)", "kn": "knees"}
NOTICED: Final = {"m/s": 0.1, "rad": 0.1}
"""Changes that a person notices, by unit; of others :data:`NOTICED_SHARE`."""
NOTICED_SHARE: Final = 0.05
LIKELY: Final = 0.5
LARGEST_GROUP: Final = 3
"""Effects that are named as alternatives; of more it is said what they have in common."""
MUCH: Final = 1.0 / 3.0
"""Share of a gap whose closing is told first, whatever closes it."""
MOST_KINDS: Final = 2
"""Kinds of the robot's own numbers that the first sentence names."""
UNIT: Final = re.compile(r"(_(per|cycles|nm2?|kg|m2?|s2?|rad|ohm|w|v|k))+$")
"""At the end of a parameter's name."""


def plain(name: str) -> str:
    """What an effect is called among people; the name as words where it is none of the library's."""
    return LIBRARY[name].title if name in LIBRARY else name.replace("_", " ")


def parameter(name: str) -> str:
    """A parameter's name as words, without the unit at its end: that stands beside the value."""
    return UNIT.sub("", name).replace("_", " ")


def number(value: float, unit: str = "") -> str:
    """Three digits and the unit; angles in degrees."""
    value, unit = (float(np.degrees(value)), "°") if unit == "rad" else (value, unit)
    return f"{float(f'{value:.3g}') + 0.0:g} {unit}".rstrip()


def percent(share: float) -> str:
    """A share of one."""
    return f"{round(100.0 * share):d} %"


def joints_in_short(joints: Sequence[str]) -> str:
    """Joints in few words."""
    if set(joints) == set(JOINT_NAMES):
        return "all joints"
    by_type = {kind: {n for n in JOINT_NAMES if n.endswith(kind)} for kind in JOINT_TYPES}
    whole = [kind for kind, members in by_type.items() if members <= set(joints)]
    rest = [j for j in joints if not any(j in by_type[kind] for kind in whole)]
    return ", ".join([f"all {PLACES[kind]}" for kind in whole] + rest)


def is_shown(low: float | None, high: float | None) -> bool:
    """Whether an interval leaves out 0; without one the figure stands for itself."""
    return low is None or high is None or low > 0.0 or high < 0.0


def closes(g: GapChange) -> bool:
    """Whether a share of the gap closes that can be told."""
    return max(g.after, g.floor) < g.before and (g.share or 0.0) >= 0.005 and (g.low is None or g.low > 0.0)


def grows(g: GapChange) -> bool:
    """Whether the gap is shown to be larger afterwards."""
    return g.after > g.before and (g.high is None or g.high < 0.0)


def gap_told(g: GapChange) -> str:
    """What becomes of a gap, in a few words."""
    if closes(g):
        known = g.low is not None and g.high is not None
        within = f" (90 %: {percent(g.low or 0.0)} to {percent(g.high or 0.0)})" if known else ""
        return f"{percent(g.share or 0.0)} of the {g.gap} gap closes{within}"
    if grows(g):
        return f"the {g.gap} gap grows"
    if g.before <= g.floor:
        return f"the {g.gap} gap was within its floor"
    return f"a change of the {g.gap} gap is not shown"


def gap_in_units(g: GapChange) -> str:
    """The distances before and after, then what becomes of the gap."""
    return f"from {number(g.before)} to {number(g.after)} {g.unit}: {gap_told(g)}"


def change_told(c: QuantityChange) -> str:
    """What becomes of a quantity; empty where it is not known on both sides."""
    if c.before is None or c.after is None:
        return ""
    title, before, after = c.title.split(",")[0], c.before, c.after
    if c.quantity == "fall_share":
        if percent(before) == percent(after):
            return f"falls in {percent(after)} of runs, as without"
        shown = "" if is_shown(c.low, c.high) else ", a change that is not shown"
        return f"falls in {percent(after)} of runs instead of {percent(before)}{shown}"
    if before == after or not is_shown(c.low, c.high) or float(f"{abs(after - before):.3g}") == 0.0:
        return f"a change of the {title} is not shown"
    size = number(abs(after - before), c.unit)
    if c.quantity in ("top_speed", "mean_speed"):
        return f"{'slower' if after < before else 'faster'} by {size} ({title})"
    return f"the {title} {'falls' if after < before else 'rises'} by {size}"


def largest_change(consequences: Sequence[Consequences]) -> QuantityChange | None:
    """Falls if their share changes, else the largest change that a person notices; None if none is shown."""
    shown = [c for part in consequences for c in part.changes if is_shown(c.low, c.high)]
    found = max(shown, key=_noticed, default=None)
    return found if found is not None and _noticed(found) >= 1.0 else None


def _noticed(c: QuantityChange) -> float:
    """How many times what a person notices; 0 where it is not known on both sides."""
    if c.before is None or c.after is None:
        return 0.0
    if c.quantity == "fall_share":
        return np.inf if percent(c.before) != percent(c.after) else 0.0
    return abs(c.after - c.before) / NOTICED.get(c.unit, max(NOTICED_SHARE * abs(c.before), 1e-12))


def left_told(g: GapLeft) -> str:
    """What is left of a gap, and how many times its floor that is."""
    times = "" if g.ratio is None else f", {g.ratio:.1f} times its floor"
    return f"{g.gap} {number(g.left)} {g.unit}{times}"


def found(d: Difference) -> str:
    """A difference and where it is."""
    return called(d) + (f" at {joints_in_short(d.joints)}" if d.joints and len(d.joints) < len(JOINT_NAMES) else "")


def called(d: Difference) -> str:
    """The effects of a difference, or what a large group of them has in common.

    One that takes away from the nominal model is *less* of the effect.
    """
    less = "less " if is_less(d) else ""
    if len(d.group) <= LARGEST_GROUP:
        return less + (" or ".join(map(plain, d.group)) if len(d.group) > 1 else d.title or plain(d.name))
    families = [LIBRARY[n].family if n in LIBRARY else "" for n in d.group]
    shared = LIBRARY[d.name].family if d.name in LIBRARY else ""
    if shared and families.count(shared) > len(families) / 2:
        return f"something like {less}{shared}"
    return f"one of {len(d.group)} effects, {less}{d.title or plain(d.name)} among them"


def is_less(d: Difference) -> bool:
    """Whether the robot has less of the effect than the nominal model, rather than more."""
    p = size_of(LIBRARY[d.name]) if d.name in LIBRARY else None
    return p is not None and p.name in d.parameters and d.parameters[p.name].value < p.low


def size_told(name: str, p: Number) -> str:
    """A fitted number with its interval."""
    unit = "" if p.unit == "1" else p.unit
    return f"{parameter(name)} {p.value:.3g} ({p.low:.3g} to {p.high:.3g}) {unit}".rstrip()


def place(where: str) -> str:
    """Joint type, leg or body in words."""
    return PLACES.get(where, where)


def calibration_told(numbers: Sequence[CalibratedNumber]) -> str:
    """The numbers that stand out, in a phrase."""
    out = [n for n in numbers if n.stands_out]
    return _numbers_told(out) if out else f"no number of the robot's own {'stands out' if numbers else 'is known'}"


def _numbers_told(numbers: Sequence[CalibratedNumber]) -> str:
    """The torque gains among some numbers, since they are what a person asks for, else the first number."""
    gains = [n for n in numbers if (n.effect, n.parameter) == ("torque_gain", "gain")]
    if gains:
        first, *rest = sorted(gains, key=lambda n: n.value)
        told = f"{place(first.where)} give {percent(first.value)} of the torque asked"
        return ", ".join([told, *(f"{place(n.where)} {percent(n.value)}" for n in rest)])
    n = numbers[0]
    unit = "" if n.unit in ("", "1") else f" {n.unit}"
    return f"{n.title} of {place(n.where)} is {n.value:.3g}{unit}, nominal {n.nominal:.3g}"


def closing_kinds(v: Verdict) -> dict[str, GapChange]:
    """Kinds of the robot's own numbers that close much of a gap, by effect, with that gap; what closes most first."""
    named = {d.name for d in v.differences}
    best = {
        effect: max(filter(closes, c.gaps), key=lambda g: g.share or 0.0, default=None)
        for effect, c in v.calibration.effects.items()
        if effect not in named
    }
    found = {effect: g for effect, g in best.items() if g is not None and (g.share or 0.0) >= MUCH}
    return dict(sorted(found.items(), key=lambda item: -(item[1].share or 0.0))[:MOST_KINDS])


def kinds_told(v: Verdict) -> list[str]:
    """What each of these kinds is on this robot, and what it closes."""
    return [
        f"{_kind_told(v, effect)}, which closes {percent(g.share or 0.0)} of the {g.gap} gap"
        for effect, g in closing_kinds(v).items()
    ]


def _kind_told(v: Verdict, effect: str) -> str:
    """Numbers of one kind that stand out, else the one that is farthest off."""
    own = [n for n in v.calibration.numbers if n.effect == effect]
    shown = [n for n in own if n.stands_out] or own[:1]
    return _numbers_told(shown) if shown else plain(effect)


def own_told(v: Verdict) -> str:
    """The robot's calibration: what closes much of a gap, and what else stands out."""
    kinds = closing_kinds(v)
    others = [n for n in v.calibration.numbers if n.stands_out and n.effect not in kinds]
    rest = [] if kinds and not others else [calibration_told(others or v.calibration.numbers)]
    return "; ".join([*kinds_told(v), *rest])


def unknown_told(u: UnknownEffect) -> str:
    """What is left that no effect explains: where, how much, and beside what is usual."""
    where = f" at {joints_in_short(u.joints)}" if u.joints else ""
    where += f", largest in {u.regime}" if u.regime else ""
    left, usual = number(u.left, u.unit), number(u.usual, u.unit)
    times = f": {u.left / u.usual:.1f} times as much" if u.usual > 0.0 else ""
    most = f"corrected models of faultless robots leave at most {usual} there (95 in 100){times}"
    return f"{CHANNEL_TITLES.get(u.channel, u.channel)}{where}: {left} is left; {most}"


def whole(v: Verdict) -> Consequences | None:
    """What the corrected model changes."""
    return v.consequences or v.calibration.consequences


def all_gaps(v: Verdict) -> tuple[GapChange, ...]:
    """What it does to each gap; empty where that was not measured."""
    all_ = whole(v)
    return () if all_ is None else all_.gaps


def is_far(v: Verdict) -> list[GapLeft]:
    """Gaps of which more is left than runs of a right model leave, largest first."""
    return sorted((g for g in v.remainder if (g.ratio or 0.0) > RUNS_APART), key=lambda g: -(g.ratio or 0.0))


def is_good(v: Verdict) -> bool:
    """Whether the corrected model is shown to be nearer to the robot, in no gap farther, and nothing warns of it."""
    gaps = all_gaps(v)
    return not v.warnings and any(map(closes, gaps)) and all(g.after <= g.before for g in gaps)


def headline(v: Verdict) -> str:
    """The largest consequence and what to do next, in a sentence."""
    since = f"since {v.since}: " if v.since and v.status != "cannot_tell" else ""
    told = f"{since}{_answer(v)}; next: {next_step(v)}"
    return told[:1].upper() + told[1:]


def _answer(v: Verdict) -> str:
    if v.status == "cannot_tell":
        return "these logs cannot tell"
    if v.status == "no_gap":
        return _no_gap(v)
    own = "".join(f"; calibration: {told}" for told in ["; ".join(kinds_told(v))] if told)
    if v.status == "unknown_effect" or (v.status == "calibration" and v.probability_unknown > LIKELY):
        return f"something {_acts(v)} that no effect of the library explains (P {v.probability_unknown:.2f}){own}"
    if is_unchanged(v):
        far = [f"; the {gap} gap of that model is above its floor" for gap in _above_floors(v)]
        return "".join(["no change is shown", *far[:1], own])
    if not v.differences:
        return f"calibration: {own_told(v)}{_closed(v)}"
    names = " and ".join(found(d) for d in v.differences[:2])
    names += f" and {len(v.differences) - 2} more" if len(v.differences) > 2 else ""
    change = largest_change([d.consequences for d in v.differences[:2] if d.consequences is not None])
    does = f": {change_told(change)}" if change is not None else ""
    return f"{names}{does}{own}{_closed(v)}{_rest(v)}"


def is_unchanged(v: Verdict) -> bool:
    """Whether a diagnosis of a history shows nothing that its model of the date before lacks."""
    shown = [*v.differences, *(n for n in v.calibration.numbers if n.stands_out)]
    return bool(v.since) and v.status in ("no_gap", "calibration") and not shown and v.probability_unknown <= LIKELY


def is_near(v: Verdict) -> bool:
    """Whether the nominal model itself is as near to the robot as floors allow."""
    return bool(all_gaps(v)) and not _above_floors(v)


def _above_floors(v: Verdict) -> list[GapName]:
    """Gaps of the nominal model that a right one would not have."""
    return [g.gap for g in all_gaps(v) if g.before > RUNS_APART * g.floor]


def _no_gap(v: Verdict) -> str:
    if v.differences:
        return f"{found(v.differences[0])}{_closed(v)}"
    if is_near(v):
        near = _listed([g.gap for g in all_gaps(v)])
        model = f"the model of {v.since}" if v.since else "the nominal model"
        return f"no gap: {model} is as near to the robot in {near} as floors allow"
    far = [f"; the {gap} gap of the nominal model is above its floor" for gap in _above_floors(v)]
    return "".join(["no difference is shown", *far[:1]])


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _where(v: Verdict) -> str:
    return f" at {joints_in_short(v.unknown.joints)}" if v.unknown is not None and v.unknown.joints else ""


def _acts(v: Verdict) -> str:
    return f"{'acts' if v.probability_unknown > LIKELY else 'may act'}{_where(v)}"


def _closed(v: Verdict) -> str:
    """The gap of which the corrected model closes most, or that none is shown to close."""
    gaps = all_gaps(v)
    best = max(filter(closes, gaps), key=lambda g: g.share or 0.0, default=None)
    if best is None:
        return "; the corrected model is not shown to close a gap" if gaps else ""
    return f"; corrected, {percent(best.share or 0.0)} of the {best.gap} gap closes"


def _rest(v: Verdict) -> str:
    """What is there beside the differences."""
    if v.status != "partly_explained":
        return ""
    if v.probability_unknown > LIKELY:
        return f"; something else {_acts(v)} (P {v.probability_unknown:.2f})"
    far = is_far(v)
    return f"; what is left: {left_told(far[0])}" if far else ""


def next_step(v: Verdict) -> str:
    """What to do next."""
    splits = [(d.split, d.group) for d in v.differences if len(d.group) > 1 and d.split is not None]
    if v.warnings:
        return "read the warnings"
    if v.status == "cannot_tell":
        off = v.channels.get("set_point_to_load", "").removeprefix("off: ")
        from_motion = "; with 'load: from_motion' and an MJCF, --robot computes loads" if v.no_model else ""
        return f"see why no channel shows forces ({off}){from_motion}" if off not in ("", "used") else "record more"
    if is_unchanged(v):
        return f"keep the model of {v.since}"
    if v.status == "no_gap" and not v.differences:
        use = "keep your simulator as it is" if v.no_model else "train on the nominal model"
        return use if is_near(v) else "record more"
    if splits:
        split, group = splits[0]
        what = split.text.split(":")[0].rstrip(".")
        which = _listed([plain(n) for n in group]) if len(group) <= LARGEST_GROUP else f"these {len(group)} effects"
        return f"{what[:1].lower()}{what[1:]} and record it, to tell {which} apart"
    if v.probability_unknown > LIKELY or v.status == "unknown_effect":
        return f"look at the robot{_where(v)}"
    if is_good(v):
        use = "take the numbers over into your simulator" if v.no_model else "train on the corrected model"
        return use + (", and look further" if is_far(v) else "")
    return f"record more before {'these numbers are used' if v.no_model else 'training on the corrected model'}"


def probabilities(v: Verdict) -> str:
    """Probabilities, each by itself, and that they are no shares of one whole."""
    named = [f"{found(d)} {d.probability:.2f}" for d in v.differences]
    rest = f"an effect that the library lacks {v.probability_unknown:.2f}"
    none = f"Probability that there is nothing beside the robot's own calibration: {v.probability_none:.2f}."
    told = f"Probability that it is there: {'; '.join([*named, rest])}. {none}"
    return f"{told} Effects can act together, so these numbers do not add up to 1." if named else told


def sentence(told: str) -> str:
    """With a capital and a full stop."""
    return f"{told[:1].upper()}{told[1:].rstrip('.')}."
