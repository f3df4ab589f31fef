"""What of a robot changed over dated diagnoses: its numbers with their intervals, and what these say, in sentences.

Numbers are absolute, so that dates compare whatever model each started from. Two dates differ in a number if the
distance of the values, over the standard deviation that both intervals give, is significant among all numbers that
both dates know (Benjamini–Hochberg); or if the later diagnosis, which started from the earlier one's corrected model,
names a difference.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, Literal, NamedTuple

import numpy as np
from pydantic import Field
from scipy.stats import norm

from diagnosis.closed_loop.gap_map import benjamini_hochberg
from diagnosis.decision_constants import NAMED, SIGNIFICANT
from diagnosis.document import CalibratedNumber, Difference, Status, Verdict
from diagnosis.library import JointGroups
from diagnosis.library.registry import LIBRARY
from diagnosis.report import words
from diagnosis.report.history import Dated
from diagnosis.verdict.calibration import NEVER_MET, Z_90, in_model
from spot_model.io.settings import Settings
from spot_model.robot.facts import JOINT_NAMES, LEG_NAMES
from spot_model.text import parameter_words

SPOT: Final = JointGroups(JOINT_NAMES, np.repeat(np.arange(len(LEG_NAMES)), len(JOINT_NAMES) // len(LEG_NAMES)))
MOST: Final = 4
"""Numbers that a sentence tells."""


class DatedNumber(Settings):
    """A number at one date."""

    date: str
    """Name of the diagnosis."""
    value: float
    """Value in the corrected model of that date."""
    low: float | None = None
    """Lower end of the 90 % interval; null where the logs of that date do not tell the number."""
    high: float | None = None
    """Upper end."""


class NumberHistory(Settings):
    """A number over the dates."""

    effect: str
    """Name of the effect, as in a model file."""
    parameter: str
    """Name of its parameter."""
    title: str
    """Both in words."""
    where: str
    """Joint, joint type, leg, several joints, `body` or `floor`."""
    unit: str = ""
    """Unit of the values; empty for a share."""
    is_named: bool = False
    """Whether a diagnosis names its effect here as a difference from an earlier date."""
    has_changed: bool = False
    """Whether the first and the last date differ in it significantly."""
    points: tuple[DatedNumber, ...]
    """By date, oldest first; dates that say nothing of it are left out."""

    def at(self, date: str) -> DatedNumber | None:
        """The number at a date."""
        return next((p for p in self.points if p.date == date), None)


class Date(Settings):
    """One diagnosis."""

    date: str
    """Its folder's name."""
    status: Status
    """Its verdict in a word."""
    headline: str
    """Its verdict in a sentence."""
    nominal: str
    """The model that it started from."""
    since: str
    """Date of the diagnosis whose corrected model that is; empty for other models."""


class Drift(Settings):
    """What ``history.json`` holds."""

    schema_name: Literal["spot-rl/history/1"] = Field(default="spot-rl/history/1", alias="schema")
    robot: str
    """Serial number or name; empty where no log tells."""
    dates: tuple[Date, ...]
    """Oldest first."""
    outcome: Status | Literal["changed", "unchanged"]
    """From the date before the last to the last: ``changed``, ``unchanged``, ``unknown_effect`` if all that shows is
    something that no effect explains, or ``cannot_tell``. Of a single date its status."""
    since_last: tuple[str, ...]
    """What changed from the date before the last to the last, a sentence each; empty for a single date."""
    since_first: tuple[str, ...]
    """What changed from the first date to the last; empty for fewer than three dates."""
    tracks: tuple[NumberHistory, ...]
    """Numbers over the dates: those that were ever named first, then those that changed most."""


class Moved(NamedTuple):
    """A number at two dates."""

    track: NumberHistory
    before: DatedNumber
    after: DatedNumber
    distance: float
    """In standard deviations; NaN where neither date has any."""


def drift_of(history: Sequence[Dated]) -> Drift:
    """The history of a robot from its diagnoses, oldest first, at least one."""
    tracks = tuple(_tracks(history))
    first, last = history[0], history[-1]
    moved = significant(tracks, first.name, last.name) if len(history) > 1 else []
    far = {id(m.track): i for i, m in enumerate(moved)}
    ordered = sorted(tracks, key=lambda t: (not t.is_named, far.get(id(t), len(tracks))))
    return Drift(
        robot=next((d.verdict.robot for d in reversed(history) if d.verdict.robot), ""),
        dates=tuple(
            Date(date=d.name, **{k: getattr(d.verdict, k) for k in ("status", "headline", "nominal", "since")})
            for d in history
        ),
        outcome=_outcome(history, tracks),
        since_last=tuple(_sentences(history[-2], last, tracks)) if len(history) > 1 else (),
        since_first=tuple(_sentences(first, last, tracks)) if len(history) > 2 else (),
        tracks=tuple(t.model_copy(update={"has_changed": id(t) in far}) for t in ordered),
    )


def _outcome(history: Sequence[Dated], tracks: Sequence[NumberHistory]) -> Status | Literal["changed", "unchanged"]:
    v = history[-1].verdict
    if len(history) == 1 or v.status == "cannot_tell":
        return v.status
    if _named(*history[-2:]) or significant(tracks, history[-2].name, history[-1].name):
        return "changed"
    is_new = v.probability_unknown > NAMED >= history[-2].verdict.probability_unknown
    return "unknown_effect" if is_new else "unchanged"


def _named(before: Dated, after: Dated) -> tuple[Difference, ...]:
    """Differences of a date from the one before; none where it started from another model."""
    return after.verdict.differences if after.verdict.since == before.name else ()


def _tracks(history: Sequence[Dated]) -> Iterator[NumberHistory]:
    """Numbers that are measured with the calibration, then those of effects that are differences alone."""
    known: dict[tuple[str, str, str], list[tuple[CalibratedNumber, Dated]]] = {}
    for d in history:
        numbers = (*d.verdict.calibration.numbers, *d.verdict.calibration.units)
        for key, n in {(n.effect, n.parameter, n.where): n for n in numbers}.items():
            known.setdefault(key, []).append((n, d))
    for found in known.values():
        n = found[-1][0]
        yield NumberHistory(
            **{name: getattr(n, name) for name in ("effect", "parameter", "title", "where", "unit")},
            is_named=any(_names(d.verdict, n) for _, d in found),
            points=tuple(DatedNumber(date=d.name, value=n.value, low=n.low, high=n.high) for n, d in found),
        )
    measured = {effect for effect, _, _ in known}
    places = {(e.name, e.joints): e for d in history for e in d.verdict.differences if e.name not in measured}
    for (effect, joints), e in places.items():
        dates = [d.name for d in history if d.verdict.since and any(_is_same(o, e) for o in d.verdict.differences)]
        for name, number in e.parameters.items():
            yield NumberHistory(
                effect=effect,
                parameter=name,
                title=f"{e.title or words.plain_name(effect)}: {parameter_words(name)}",
                where=words.joints_in_short(joints),
                unit="" if number.unit == "1" else number.unit,
                is_named=bool(dates),
                points=tuple(filter(None, (_held(d, e, name) for d in history))),
            )


def _names(v: Verdict, n: CalibratedNumber) -> bool:
    """Whether a difference from an earlier date is of this number's effect, and at its joint, leg or body."""
    here = [(n.where in ("body", "floor", *e.joints), e) for e in v.differences if v.since and e.name == n.effect]
    return any(is_here or any(j.startswith(f"{n.where}_") for j in e.joints) for is_here, e in here)


def _is_same(one: Difference, other: Difference) -> bool:
    return (one.name, one.joints) == (other.name, other.joints)


def _held(d: Dated, e: Difference, name: str) -> DatedNumber | None:
    """A difference's number in the corrected model of a date, with an interval where that date measured it.

    None where the model does not have the number, as a limit that is never met.
    """
    n = next((o.parameters.get(name) for o in d.verdict.differences if _is_same(o, e)), None)
    effect = LIBRARY[e.name].effect if e.name in LIBRARY else None
    known = None if effect is None else next((p for p in effect.parameters() if p.name == name), None)
    if effect is None or known is None or abs(known.null) >= NEVER_MET:
        return None if n is None else DatedNumber(date=d.name, value=n.value, low=n.low, high=n.high)
    value = in_model(d.model, SPOT, effect, known, np.isin(JOINT_NAMES, e.joints))
    if n is None:
        return DatedNumber(date=d.name, value=value)
    # What the date measured came on top of the model that it started from: a factor, or a summand.
    factor = value / n.value if known.null == 1.0 and n.value != 0.0 else 1.0
    low, high = (value + factor * (x - n.value) for x in (n.low, n.high))
    return DatedNumber(date=d.name, value=value, low=low, high=high)


def significant(tracks: Sequence[NumberHistory], before: str, after: str) -> list[Moved]:
    """Numbers that two dates are significantly apart in, farthest first."""
    found = [m for m in _moved(tracks, before, after) if m.track.where not in words.PLACES and np.isfinite(m.distance)]
    if not found:
        return []
    p_values = benjamini_hochberg(2.0 * norm.sf(np.abs([m.distance for m in found])))
    kept = [m for m, p in zip(found, p_values, strict=True) if p <= SIGNIFICANT]
    return sorted(kept, key=lambda m: -abs(m.distance))


def _moved(tracks: Sequence[NumberHistory], before: str, after: str) -> Iterator[Moved]:
    """Numbers that both dates know."""
    for track in tracks:
        old, new = track.at(before), track.at(after)
        if old is not None and new is not None:
            deviation = float(np.hypot(_deviation(old), _deviation(new)))
            yield Moved(track, old, new, (new.value - old.value) / deviation if deviation > 0.0 else np.nan)


def _deviation(p: DatedNumber) -> float:
    """Standard deviation of a number, from the wider side: the other may end at a bound; infinite if not measured."""
    return np.inf if p.low is None or p.high is None else max(p.high - p.value, p.value - p.low) / Z_90


def _sentences(before: Dated, after: Dated, tracks: Sequence[NumberHistory]) -> Iterator[str]:
    """What changed between two dates."""
    v, named = after.verdict, _named(before, after)
    both = list(_moved(tracks, before.name, after.name))
    for e in named:
        places = (*e.joints, words.joints_in_short(e.joints), "body", "floor")
        own = [m for m in both if m.track.effect == e.name and m.track.where in places]
        told = _moves(own).replace(f"{e.title}: ", "") or "; ".join(words.size_phrase(*p) for p in e.parameters.items())
        yield words.sentence(f"{words.found(e)}, P {e.probability:.2f}: {told}".removesuffix(": "))
    others = {e.name for e in named}
    rest = [m for m in significant(tracks, before.name, after.name) if m.track.effect not in others]
    if rest:
        yield words.sentence(f"{'also ' if named else ''}changed, beyond what the intervals allow: {_moves(rest)}")
    if not named and not rest and v.status != "cannot_tell":
        measured = [[(p := t.at(d.name)) is not None and p.low is not None for t in tracks] for d in (before, after)]
        compared = f"{sum(map(min, *measured))} of its {sum(measured[0])} numbers are measured on both dates"
        yield f"No number is shown to have changed since {before.name}; {compared}."
    if v.status == "cannot_tell":
        yield f"The logs of {after.name} cannot tell."
    elif v.probability_unknown > NAMED:
        as_before = f", as on {before.name}" if before.verdict.probability_unknown > NAMED else ""
        yield f"Something acts that no effect of the library explains (P {v.probability_unknown:.2f}){as_before}."


def _moves(moved: Sequence[Moved]) -> str:
    """Numbers with where they came from; empty without any."""
    told = [
        f"{m.track.title}{of_place(m.track)} {words.number(m.before.value, m.track.unit)} → "
        f"{words.number(m.after.value, m.track.unit, m.after.low, m.after.high)}"
        for m in moved[:MOST]
    ]
    return "; ".join([*told, *([f"{len(moved) - MOST} more numbers"] if len(moved) > MOST else [])])


def of_place(track: NumberHistory) -> str:
    """Where a number is, behind its title; nothing for the body's."""
    return "" if track.where == "body" else f" of {words.place(track.where)}"
