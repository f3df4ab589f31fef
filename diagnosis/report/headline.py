"""The verdict in one sentence: what is there, where, how large, how sure, what closes, and what to do next."""

from __future__ import annotations

from typing import Final

from diagnosis.decision_constants import NAMED, RUNS_APART
from diagnosis.document import Verdict
from diagnosis.report import words
from spot_model.text import counted

MOST_NAMED: Final = 2
"""Differences that are told in full."""
NEXT: Final = "; next: "
"""Before what to do next."""


def headline(v: Verdict) -> str:
    """What is there, where, how large, how sure, what closes, and what to do next, in a sentence."""
    since = f"since {v.since}: " if v.since and v.status != "cannot_tell" else ""
    told = f"{since}{_answer(v)}{NEXT}{next_step(v)}"
    return told[:1].upper() + told[1:]


def _answer(v: Verdict) -> str:
    if v.status == "cannot_tell":
        possible = f"; {words.found_in_full(v.differences[0])}" if v.differences else ""
        return f"these logs cannot tell{', since they hold no measured loads' if possible else ''}{possible}"
    if v.status == "no_gap":
        return _no_gap(v)
    own = "".join(f"; calibration: {told}" for told in ["; ".join(words.kind_phrases(v))] if told)
    if v.status == "unknown_effect" or (v.status == "calibration" and v.probability_unknown > NAMED):
        return f"something {_acts(v)} that no effect of the library explains (P {v.probability_unknown:.2f}){own}"
    if is_unchanged(v):
        return f"no change is shown{_far(v, 'that model')}{own}"
    if not v.differences:
        return f"{'no cause found' if words.is_without_cause(v) else 'calibration'}: {words.own_phrase(v)}{_closed(v)}"
    names = "; ".join(words.found_in_full(d) for d in v.differences[:MOST_NAMED])
    names += (
        f"; {counted(len(v.differences) - MOST_NAMED, 'more difference')}" if len(v.differences) > MOST_NAMED else ""
    )
    return f"{names}{own}{_closed(v)}{_rest(v)}"


def is_unchanged(v: Verdict) -> bool:
    """Whether a diagnosis of a history shows nothing that its model of the date before lacks."""
    shown = [*v.differences, *(n for n in v.calibration.numbers if n.stands_out)]
    return bool(v.since) and v.status in ("no_gap", "calibration") and not shown and v.probability_unknown <= NAMED


def is_near(v: Verdict) -> bool:
    """Whether the nominal model itself is as near to the robot as a right one is."""
    return bool(words.all_gaps(v)) and not _far(v, "")


def _far(v: Verdict, model: str) -> str:
    """A gap of the nominal model that a right one would not have; empty without any."""
    far = [g.gap for g in words.all_gaps(v) if g.before > RUNS_APART * g.floor]
    return f"; the {far[0]} gap of {model} is larger than {words.FLOOR}" if far else ""


def _no_gap(v: Verdict) -> str:
    if is_near(v):
        near = ", ".join(g.gap for g in words.all_gaps(v))
        model = f"the model of {v.since}" if v.since else "the nominal model"
        return f"no gap: {model} is as near to the robot as repeats and noise let it be, in {near}"
    return f"no difference is shown{_far(v, 'the nominal model')}"


def _where(v: Verdict) -> str:
    return f" at {words.joints_in_short(v.unknown.joints)}" if v.unknown is not None and v.unknown.joints else ""


def _acts(v: Verdict) -> str:
    return f"{'acts' if v.probability_unknown > NAMED else 'may act'}{_where(v)}"


def _closed(v: Verdict) -> str:
    """The gap of which the corrected model closes most, or that none is shown to close."""
    gaps = words.all_gaps(v)
    best = words.closes_most(gaps)
    if best is None:
        return "; the corrected model is not shown to close a gap" if gaps else ""
    return f"; corrected, {words.percent(best.share or 0.0)} of the {best.gap} gap closes"


def _rest(v: Verdict) -> str:
    """What is there beside the differences."""
    if v.status != "partly_explained":
        return ""
    if v.probability_unknown > NAMED:
        return f"; something else {_acts(v)} (P {v.probability_unknown:.2f})"
    left = max(v.remainder, key=lambda g: g.ratio or 0.0, default=None)
    is_far = left is not None and (left.ratio or 0.0) > RUNS_APART
    return f"; what is left: {words.left_phrase(left)}" if left is not None and is_far else ""


def next_step(v: Verdict) -> str:
    """What to do next."""
    splits = [(d.split, d.group) for d in v.differences if len(d.group) > 1 and d.split is not None]
    if v.warnings:
        return "read the warnings"
    if v.differences and not all(d.is_found for d in v.differences):
        return "record the joint loads: without them a drive and what it moves look alike"
    if v.status == "cannot_tell":
        off = v.channels.get("set_point_to_load", "").removeprefix("off: ")
        from_motion = "; with 'load: from_motion' and an MJCF, --robot computes loads" if v.no_model else ""
        if unlike := next((note for note in v.notes if "loads computed from" in note), ""):
            return f"see why the loads are not used ({unlike})"
        return f"see why no channel shows forces ({off}){from_motion}" if off not in ("", "used") else "record more"
    if is_unchanged(v):
        return f"keep the model of {v.since}"
    if v.status == "no_gap":
        use = "keep your simulator as it is" if v.no_model else "train on the nominal model"
        return use if is_near(v) else "record more"
    if splits:
        split, group = splits[0]
        what = split.text.split(":")[0].rstrip(".")
        which = (
            " and ".join(map(words.plain_name, group))
            if len(group) <= words.LARGEST_GROUP
            else f"these {len(group)} effects"
        )
        return f"{what[:1].lower()}{what[1:]} and record it, to tell {which} apart"
    if v.probability_unknown > NAMED or v.status == "unknown_effect":
        return f"look at the robot{_where(v)}"
    has_loads = v.channels.get("set_point_to_load", "used") == "used"
    if is_good(v) and has_loads:
        return "take the numbers over into your simulator" if v.no_model else "train on the corrected model"
    if words.is_without_cause(v):
        return "record more" if has_loads else "record the joint loads"
    before = "these numbers are used" if v.no_model else "training on the corrected model"
    return f"record {'more' if has_loads else 'the joint loads'} before {before}"


def is_good(v: Verdict) -> bool:
    """Whether the corrected model is shown to be nearer to the robot, in no gap farther, and nothing warns of it."""
    gaps = words.all_gaps(v)
    return not v.warnings and any(map(words.closes, gaps)) and all(g.after <= g.before for g in gaps)
