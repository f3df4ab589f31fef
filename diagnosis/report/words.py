"""The verdict in sentences. Each is made from figures of the verdict, and says no more than they do.

A change whose interval holds 0 *may be chance*; a share that is null is not told; a gap closes only if it is smaller
afterwards. ``tests/diagnosis/test_words.py`` reads the sentences back and compares them with the figures.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from diagnosis.channels import CHANNEL_TITLES
from diagnosis.document import (
    CalibratedNumber,
    Consequences,
    Difference,
    GapChange,
    GapLeft,
    Number,
    QuantityChange,
    UnknownEffect,
    Verdict,
)
from diagnosis.library import Location
from diagnosis.library.registry import LIBRARY
from diagnosis.library.repairs import size_of
from spot_model.effects.base import Parameter
from spot_model.robot.facts import JOINT_NAMES, JOINT_TYPES
from spot_model.text import parameter_words

FLOOR: Final = "repeats or noise explain"
"""What a gap is at least, even of the right model."""
BODY: Final = "body"
PLACES: Final = {"hx": "sideways hips (hx)", "hy": "forward hips (hy)", "kn": "knees"}
NOTICED: Final = {"m/s": 0.1, "rad": 0.1}
"""Changes that a person notices, by unit; of others :data:`NOTICED_SHARE`."""
NOTICED_SHARE: Final = 0.05
LARGEST_GROUP: Final = 3
"""Effects that are named as alternatives; of more it is said what they have in common."""
MUCH: Final = 1.0 / 3.0
"""Share of a gap whose closing is told first, whatever closes it."""
SMALL: Final = frozenset({"s", "m"})
LEAST_WHOLE: Final = 0.1
"""Times and lengths below this are told in thousandths."""
MOST_KINDS: Final = 2
"""Kinds of the robot's own numbers that the first sentence names."""


def plain_name(name: str) -> str:
    """What an effect is called among people; the name as words where it is none of the library's."""
    return LIBRARY[name].title if name in LIBRARY else name.replace("_", " ")


def number(value: float, unit: str = "", low: float | None = None, high: float | None = None) -> str:
    """Three digits, those of its interval in brackets, and the unit: angles in degrees, small ones in thousandths."""
    known = [x for x in (value, low, high) if x is not None]
    factor, name = (float(np.degrees(1.0)), "°") if unit == "rad" else (1.0, "" if unit == "1" else unit)
    if unit in SMALL and max(map(abs, known)) < LEAST_WHOLE:
        factor, name = 1e3, f"m{unit}"
    told, *ends = [f"{float(f'{factor * x:.3g}') + 0.0:g}" for x in known]
    within = f" ({' to '.join(ends)})" if len(ends) > 1 else ""
    return f"{told}{name if name == '°' else f' {name}'}".rstrip() + within


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


def closes_most(gaps: Sequence[GapChange]) -> GapChange | None:
    """The gap of which the largest share closes."""
    return max(filter(closes, gaps), key=lambda g: g.share or 0.0, default=None)


def grows(g: GapChange) -> bool:
    """Whether the gap is shown to be larger afterwards."""
    return g.after > g.before and (g.high is None or g.high < 0.0)


def gap_phrase(g: GapChange) -> str:
    """What becomes of a gap, in a few words; no more than all of it can close."""
    if closes(g):
        within = ""
        if g.low is not None and g.high is not None and percent(g.low) != percent(1.0):
            ends = f"at least {percent(g.low)}" if g.high >= 1.0 else f"{percent(g.low)} to {percent(g.high)}"
            within = f" (90 % interval: {ends})"
        return f"{percent(g.share or 0.0)} of the {g.gap} gap closes{within}"
    if grows(g):
        return f"the {g.gap} gap grows"
    if g.before <= g.floor:
        return f"the {g.gap} gap was no larger than {FLOOR}"
    return f"the change of the {g.gap} gap may be chance"


def change_phrase(c: QuantityChange) -> str:
    """What becomes of a quantity; empty where it is not known on both sides."""
    if c.before is None or c.after is None:
        return ""
    title, before, after = c.title.split(",")[0], c.before, c.after
    if c.quantity == "fall_share":
        if percent(before) == percent(after):
            return f"falls in {percent(after)} of runs, as without"
        shown = "" if is_shown(c.low, c.high) else ", which may be chance"
        return f"falls in {percent(after)} of runs instead of {percent(before)}{shown}"
    if before == after or not is_shown(c.low, c.high) or float(f"{abs(after - before):.3g}") == 0.0:
        return f"the change of the {title} may be chance"
    size = number(abs(after - before), c.unit)
    if c.quantity in ("top_speed", "mean_speed"):
        return f"{'slower' if after < before else 'faster'} by {size} ({title})"
    return f"the {title} {'falls' if after < before else 'rises'} by {size}"


def does(c: Consequences | None) -> str:
    """The gap of which it closes most, and the shown change of the walk that a person notices most, if any."""
    gap = closes_most(c.gaps if c is not None else ())
    shown = [q for q in (c.changes if c is not None else ()) if is_shown(q.low, q.high) and _noticed(q) >= 1.0]
    return "; ".join(
        [*([gap_phrase(gap)] if gap is not None else []), *map(change_phrase, sorted(shown, key=_noticed)[-1:])]
    )


def _noticed(c: QuantityChange) -> float:
    """How many times what a person notices; 0 where it is not known on both sides."""
    if c.before is None or c.after is None:
        return 0.0
    if c.quantity == "fall_share":
        return np.inf if percent(c.before) != percent(c.after) else 0.0
    return abs(c.after - c.before) / NOTICED.get(c.unit, max(NOTICED_SHARE * abs(c.before), 1e-12))


def left_phrase(g: GapLeft) -> str:
    """What is left of a gap, and how many times what a right model leaves that is."""
    times = "" if g.ratio is None else f", {g.ratio:.1f} times what {FLOOR}"
    return f"{g.gap} {number(g.left)} {g.unit}{times}"


def found(d: Difference) -> str:
    """A difference, or what may be one, and where it is."""
    where = f" at {joints_in_short(joints_of(d))}" if joints_of(d) else ""
    return f"{'' if d.is_found else 'possibly '}{called(d)}{where}"


def joints_of(d: Difference) -> tuple[str, ...]:
    """The joints that an effect is local to; none of one of the whole robot."""
    is_whole = d.name in LIBRARY and LIBRARY[d.name].location is Location.ROBOT
    return () if is_whole else d.joints


def found_in_full(d: Difference) -> str:
    """A difference with its place, its size and its probability: of several numbers the farthest from no effect."""
    known, p = _size(d)
    null = {p.name: p.null for p in LIBRARY[d.name].effect.parameters()} if d.name in LIBRARY else {}

    def distance(own: tuple[str, Number]) -> float:
        return abs(own[1].value - null.get(own[0], 0.0)) / max(own[1].high - own[1].low, 1e-12)

    farthest = [size_phrase(*own) for own in sorted(d.parameters.items(), key=distance)[-1:]]
    sizes = [number(p.value, p.unit, p.low, p.high)] if known and p else farthest
    if len(d.group) > 1:
        sizes = [f"{size} if it is {plain_name(d.name)}" for size in sizes]
    return ", ".join([": ".join([found(d), *sizes]), f"P {d.probability:.2f}"])


def called(d: Difference) -> str:
    """The effects of a difference, or what a large group of them has in common.

    One that takes away from the nominal model is *less* of the effect.
    """
    less = "less " if is_less(d) else ""
    if len(d.group) <= LARGEST_GROUP:
        return less + (" or ".join(map(plain_name, d.group)) if len(d.group) > 1 else d.title or plain_name(d.name))
    families = [LIBRARY[n].family if n in LIBRARY else "" for n in d.group]
    shared = LIBRARY[d.name].family if d.name in LIBRARY else ""
    if shared and families.count(shared) > len(families) / 2:
        return f"something like {less}{shared}"
    return f"one of {len(d.group)} effects, {less}{d.title or plain_name(d.name)} among them"


def is_less(d: Difference) -> bool:
    """Whether the robot has less of the effect than the nominal model, rather than more."""
    known, p = _size(d)
    return known is not None and p is not None and p.value < known.low


def _size(d: Difference) -> tuple[Parameter | None, Number | None]:
    """The one free number of an effect of joints, as a parameter and as it was found; None for other effects."""
    known = size_of(LIBRARY[d.name]) if d.name in LIBRARY else None
    return known, None if known is None else d.parameters.get(known.name)


def size_phrase(name: str, p: Number) -> str:
    """A fitted number with its interval."""
    return f"{parameter_words(name)} {number(p.value, p.unit, p.low, p.high)}"


def place(where: str) -> str:
    """Joint type, leg or body in words."""
    return PLACES.get(where, where)


def _numbers_phrase(numbers: Sequence[CalibratedNumber]) -> str:
    """The torque gains among some numbers, since they are what a person asks for, else the first number."""
    gains = [n for n in numbers if (n.effect, n.parameter) == ("torque_gain", "gain")]
    if gains:
        first, *rest = sorted(gains, key=lambda n: n.value)
        told = f"{place(first.where)} give {percent(first.value)} of the torque asked"
        return ", ".join([told, *(f"{place(n.where)} {percent(n.value)}" for n in rest)])
    n = numbers[0]
    of = "" if n.where == BODY else f" of {place(n.where)}"
    return f"{n.title}{of} is {number(n.value, n.unit)}, nominal {number(n.nominal, n.unit)}"


def closing_kinds(v: Verdict) -> dict[str, GapChange]:
    """Kinds of the robot's own numbers that close much of a gap, by effect, with that gap; what closes most first."""
    named = {d.name for d in v.differences}
    best = {effect: closes_most(c.gaps) for effect, c in v.calibration.effects.items() if effect not in named}
    found = {effect: g for effect, g in best.items() if g is not None and (g.share or 0.0) >= MUCH}
    return dict(sorted(found.items(), key=lambda item: -(item[1].share or 0.0))[:MOST_KINDS])


def kind_phrases(v: Verdict) -> list[str]:
    """What each of these kinds is on this robot, and what it closes: its numbers that stand out, else the farthest."""
    out = []
    for effect, g in closing_kinds(v).items():
        own = [n for n in v.calibration.numbers if n.effect == effect]
        shown = [n for n in own if n.stands_out] or own[:1]
        told = _numbers_phrase(shown) if shown else plain_name(effect)
        out.append(f"{told}, which closes {percent(g.share or 0.0)} of the {g.gap} gap")
    return out


def is_without_cause(v: Verdict) -> bool:
    """Whether neither a difference nor a number of the robot's own stands out."""
    return not v.differences and not closing_kinds(v) and not any(n.stands_out for n in v.calibration.numbers)


def own_phrase(v: Verdict) -> str:
    """The robot's calibration: what closes much of a gap, and what else stands out."""
    kinds = closing_kinds(v)
    told = {*kinds, *(d.name for d in v.differences)}
    others = [n for n in v.calibration.numbers if n.stands_out and n.effect not in told]
    none = f"no number of the robot's own {'stands out' if v.calibration.numbers else 'is known'}"
    rest = [_numbers_phrase(others)] if others else [] if kinds else [none]
    return "; ".join([*kind_phrases(v), *rest])


def unknown_phrase(u: UnknownEffect) -> str:
    """What is left that no effect explains: where, how much, and beside what is usual."""
    where = f" at {joints_in_short(u.joints)}" if u.joints else ""
    where += f", largest in {u.regime}" if u.regime else ""
    left, usual = number(u.left, u.unit), number(u.usual, u.unit)
    times = f": {u.left / u.usual:.1f} times as much" if u.usual > 0.0 else ""
    most = f"corrected models of faultless robots leave at most {usual} there (95 in 100){times}"
    return f"{CHANNEL_TITLES.get(u.channel, u.channel)}{where}: {left} is left; {most}"


def whole_change(v: Verdict) -> Consequences | None:
    """What the corrected model changes."""
    return v.consequences or v.calibration.consequences


def all_gaps(v: Verdict) -> tuple[GapChange, ...]:
    """What it does to each gap; empty where that was not measured."""
    all_ = whole_change(v)
    return () if all_ is None else all_.gaps


def otherwise(v: Verdict) -> str:
    """What could be there instead, or besides."""
    none = f"nothing is there beside the robot's own calibration, P {v.probability_none:.2f}"
    return f"{none}; an effect that the library lacks, P {v.probability_unknown:.2f}"


def sentence(told: str) -> str:
    """With a capital and a full stop."""
    return f"{told[:1].upper()}{told[1:].rstrip('.')}."
