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
from diagnosis.decision_constants import NAMED
from diagnosis.document import CalibratedNumber, Difference, Number, Status, Verdict
from diagnosis.library import Robot
from diagnosis.library.registry import LIBRARY
from diagnosis.report import words
from diagnosis.report.figures import SIGNIFICANT
from diagnosis.report.history import Dated
from diagnosis.verdict.calibration import NEVER_MET, Z_90, in_model
from spot_model.io.settings import Settings
from spot_model.robot.facts import JOINT_NAMES, LEG_NAMES

SPOT: Final = Robot(JOINT_NAMES, np.repeat(np.arange(len(LEG_NAMES)), len(JOINT_NAMES) // len(LEG_NAMES)))
MOST: Final = 4
"""Numbers that a sentence tells."""


class Point(Settings):
    """A number at one date."""

    date: str
    """Name of the diagnosis."""
    value: float
    """Value in the corrected model of that date."""
    low: float | None = None
    """Lower end of the 90 % interval; null where the logs of that date do not tell the number."""
    high: float | None = None
    """Upper end."""
    is_named: bool = False
    """Whether the diagnosis of that date names its effect here as a difference from an earlier date."""


class Track(Settings):
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
    has_changed: bool = False
    """Whether the first and the last date differ in it significantly."""
    points: tuple[Point, ...]
    """By date, oldest first; dates that say nothing of it are left out."""

    def at(self, date: str) -> Point | None:
        """The number at a date."""
        return next((p for p in self.points if p.date == date), None)

    @property
    def is_named(self) -> bool:
        """Whether a diagnosis ever named it."""
        return any(p.is_named for p in self.points)


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
    tracks: tuple[Track, ...]
    """Numbers over the dates: those that were ever named first, then those that changed most."""


class Moved(NamedTuple):
    """A number at two dates."""

    track: Track
    before: Point
    after: Point
    distance: float
    """In standard deviations."""


def drift_of(history: Sequence[Dated]) -> Drift:
    """The history of a robot from its diagnoses, oldest first, at least one."""
    tracks = tuple(_tracks(history))
    first, last = history[0], history[-1]
    moved = significant(tracks, first.name, last.name) if len(history) > 1 else []
    far = {id(m.track): -abs(m.distance) for m in moved}
    ordered = sorted(tracks, key=lambda t: (not t.is_named, far.get(id(t), 0.0)))
    return Drift(
        robot=next((d.verdict.robot for d in reversed(history) if d.verdict.robot), ""),
        dates=tuple(
            Date(
                date=d.name,
                status=d.verdict.status,
                headline=d.verdict.headline,
                nominal=d.verdict.nominal,
                since=d.verdict.since,
            )
            for d in history
        ),
        outcome=_outcome(history, tracks),
        since_last=tuple(_sentences(history[-2], last, tracks)) if len(history) > 1 else (),
        since_first=tuple(_sentences(first, last, tracks)) if len(history) > 2 else (),
        tracks=tuple(t.model_copy(update={"has_changed": id(t) in far}) for t in ordered),
    )


def _outcome(history: Sequence[Dated], tracks: Sequence[Track]) -> Status | Literal["changed", "unchanged"]:
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


def _tracks(history: Sequence[Dated]) -> Iterator[Track]:
    """Numbers that are measured with the calibration, then those of effects that are differences alone."""
    known: dict[tuple[str, str, str], list[tuple[CalibratedNumber, Point]]] = {}
    for d in history:
        own = {
            (n.effect, n.parameter, n.where): n for n in (*d.verdict.calibration.numbers, *d.verdict.calibration.units)
        }
        for key, n in own.items():
            point = Point(date=d.name, value=n.value, low=n.low, high=n.high, is_named=_names(d.verdict, n))
            known.setdefault(key, []).append((n, point))
    for found in known.values():
        n = found[-1][0]
        points = tuple(point for _, point in found)
        yield Track(effect=n.effect, parameter=n.parameter, title=n.title, where=n.where, unit=n.unit, points=points)
    measured = {effect for effect, _, _ in known}
    places = {(e.name, e.joints): e for d in history for e in d.verdict.differences if e.name not in measured}
    for e in places.values():
        for name, number in e.parameters.items():
            points = tuple(filter(None, (_held(d, e, name) for d in history)))
            title = f"{e.title or words.plain(e.name)}: {words.parameter(name)}"
            where = words.joints_in_short(e.joints)
            unit = "" if number.unit == "1" else number.unit
            yield Track(effect=e.name, parameter=name, title=title, where=where, unit=unit, points=points)


def _names(v: Verdict, n: CalibratedNumber) -> bool:
    """Whether a difference from an earlier date is of this number's effect, and at its joint, leg or body."""
    return bool(v.since) and any(
        e.name == n.effect and (n.where in e.joints or _is_leg(n.where, e)) for e in v.differences
    )


def _is_leg(where: str, e: Difference) -> bool:
    return where in ("body", "floor") or any(joint.rsplit("_", 1)[0] == where for joint in e.joints)


def _held(d: Dated, e: Difference, name: str) -> Point | None:
    """A difference's number in the corrected model of a date, with an interval where that date measured it.

    None where the model does not have the number, as a limit that is never met.
    """
    own = next((o for o in d.verdict.differences if o.name == e.name and o.joints == e.joints), None)
    number = None if own is None else own.parameters.get(name)
    effect = LIBRARY[e.name].effect if e.name in LIBRARY else None
    known = None if effect is None else next((p for p in effect.parameters() if p.name == name), None)
    if effect is None or known is None or abs(known.null) >= NEVER_MET:
        return None if number is None else _measured(d, number, 1.0, 0.0)
    value = in_model(d.model, SPOT, effect, known, np.isin(JOINT_NAMES, e.joints))
    if number is None:
        return Point(date=d.name, value=value)
    # What the date measured came on top of the model that it started from: a factor, or a summand.
    is_factor = known.null == 1.0 and number.value != 0.0
    return _measured(d, number, *((value / number.value, 0.0) if is_factor else (1.0, value - number.value)))


def _measured(d: Dated, n: Number, factor: float, summand: float) -> Point:
    value, low, high = (factor * x + summand for x in (n.value, n.low, n.high))
    return Point(date=d.name, value=value, low=low, high=high, is_named=bool(d.verdict.since))


def significant(tracks: Sequence[Track], before: str, after: str) -> list[Moved]:
    """Numbers that two dates are significantly apart in, farthest first."""
    found = []
    for track in tracks:
        old, new = track.at(before), track.at(after)
        if old is not None and new is not None and track.where not in words.PLACES:
            deviation = float(np.hypot(_deviation(old), _deviation(new)))
            if deviation > 0.0:
                found.append(Moved(track, old, new, (new.value - old.value) / deviation))
    if not found:
        return []
    p_values = benjamini_hochberg(2.0 * norm.sf(np.abs([m.distance for m in found])))
    kept = [m for m, p in zip(found, p_values, strict=True) if p <= SIGNIFICANT]
    return sorted(kept, key=lambda m: -abs(m.distance))


def _is_measured(p: Point | None) -> bool:
    return p is not None and p.low is not None


def _deviation(p: Point) -> float:
    """Standard deviation of a number, from the wider side: the other may end at a bound; infinite if not measured."""
    return np.inf if p.low is None or p.high is None else max(p.high - p.value, p.value - p.low) / Z_90


def _sentences(before: Dated, after: Dated, tracks: Sequence[Track]) -> Iterator[str]:
    """What changed between two dates."""
    v, moved = after.verdict, significant(tracks, before.name, after.name)
    named = _named(before, after)
    for e in named:
        places = (*e.joints, words.joints_in_short(e.joints), "body", "floor")
        own = [t for t in tracks if t.effect == e.name and t.where in places]
        both = [m for t in own if (m := _between(t, before, after)) is not None]
        told = _told(both, is_title_known=True) or f": {', '.join(words.size_told(*p) for p in e.parameters.items())}"
        yield words.sentence(f"{words.found(e)}, P {e.probability:.2f}{told.removesuffix(': ')}")
    rest = [m for m in moved if not any(m.track.effect == e.name for e in named)]
    if rest:
        yield words.sentence(f"{'also ' if named else ''}changed, beyond what the intervals allow{_told(rest)}")
    if not named and not rest and v.status != "cannot_tell":
        known = [[_is_measured(t.at(own.name)) for t in tracks] for own in (before, after)]
        both = sum(map(min, *known))
        compared = f"{both} of its {sum(known[0])} numbers are measured on both dates"
        yield f"No number is shown to have changed since {before.name}; {compared}."
    if v.status == "cannot_tell":
        yield f"The logs of {after.name} cannot tell."
    elif v.probability_unknown > NAMED:
        as_before = f", as on {before.name}" if before.verdict.probability_unknown > NAMED else ""
        yield f"Something acts that no effect of the library explains (P {v.probability_unknown:.2f}){as_before}."


def _between(track: Track, before: Dated, after: Dated) -> Moved | None:
    old, new = track.at(before.name), track.at(after.name)
    return None if old is None or new is None else Moved(track, old, new, 0.0)


def _told(moved: Sequence[Moved], *, is_title_known: bool = False) -> str:
    """Numbers with where they came from; empty without any."""
    told = [_change_told(m, is_title_known) for m in moved[:MOST]]
    more = f"; {len(moved) - MOST} more numbers" if len(moved) > MOST else ""
    return f": {'; '.join(told)}{more}" if told else ""


def _change_told(m: Moved, is_title_known: bool) -> str:
    title = words.parameter(m.track.parameter) if is_title_known else m.track.title
    title += of_place(m.track)
    within = "" if m.after.low is None else f" (90 %: {m.after.low:.3g} to {m.after.high:.3g})"
    return f"{title} {m.before.value:.3g} → {m.after.value:.3g}{within} {m.track.unit}".rstrip()


def of_place(track: Track) -> str:
    """Where a number is, behind its title; nothing for the body's."""
    return "" if track.where == "body" else f" of {words.place(track.where)}"
