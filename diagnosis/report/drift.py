"""What of a robot changed over dated diagnoses: a row of numbers for each date, and what the rows say, in sentences.

Numbers are absolute, so that dates compare whatever model each started from. Two dates differ in a number if the
distance of the values, over the standard deviation that both intervals give, is significant among all numbers that
both dates know (Benjamini–Hochberg); or if the later diagnosis, which started from the earlier one's corrected model,
names a difference.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Final, Literal, NamedTuple

import numpy as np
from scipy.stats import norm

from diagnosis.closed_loop.gap_map import benjamini_hochberg
from diagnosis.decision_constants import NAMED, SIGNIFICANT
from diagnosis.document import Difference, Status
from diagnosis.library import JointGroups
from diagnosis.library.registry import LIBRARY
from diagnosis.report import words
from diagnosis.report.history import Dated
from diagnosis.verdict.calibration import NEVER_MET, Z_90, in_model
from spot_model.robot.facts import JOINT_NAMES, LEG_NAMES
from spot_model.text import parameter_words

SPOT: Final = JointGroups(JOINT_NAMES, np.repeat(np.arange(len(LEG_NAMES)), len(JOINT_NAMES) // len(LEG_NAMES)))
MOST: Final = 4
"""Numbers that a sentence tells."""
SCHEMA: Final = "spot-rl/history/2"
KEY: Final = ("effect", "parameter", "where")
Key = tuple[str, str, str]
"""What a number is called by on every date; where is a joint, joint type, leg, several joints, "body" or "floor"."""
Outcome = Status | Literal["changed", "unchanged"]


@dataclass(frozen=True)
class DatedNumber:
    """A number of one date's corrected model."""

    title: str
    """Effect and parameter in words."""
    unit: str
    """Empty for a share."""
    value: float
    low: float | None = None
    """Lower end of the 90 % interval; None where the logs of that date do not tell the number."""
    high: float | None = None

    @property
    def deviation(self) -> float:
        """Standard deviation, from the wider side: the other may end at a bound; infinite if not measured."""
        if self.low is None or self.high is None:
            return np.inf
        return max(self.high - self.value, self.value - self.low) / Z_90


@dataclass(frozen=True)
class Row:
    """One date: its diagnosis, and the numbers of its corrected model.

    Those that are measured with the calibration come first, then those of effects that are differences alone.
    """

    dated: Dated
    numbers: Mapping[Key, DatedNumber]


@dataclass(frozen=True)
class Drift:
    """What the rows of all dates say."""

    rows: tuple[Row, ...]
    """Oldest first."""
    changed: tuple[Key, ...]
    """Numbers that a date names as a difference from an earlier one, then those in which the first and the last date
    differ significantly, farthest first."""
    outcome: Outcome
    """From the date before the last to the last: ``changed``, ``unchanged``, ``unknown_effect`` if all that shows is
    something that no effect explains, or ``cannot_tell``. Of a single date its status."""
    since_last: tuple[str, ...]
    """What changed from the date before the last to the last, a sentence each; empty for a single date."""
    since_first: tuple[str, ...]
    """What changed from the first date to the last; empty for fewer than three dates."""

    @property
    def robot(self) -> str:
        """Serial number or name; empty where no log tells."""
        return next((row.dated.verdict.robot for row in reversed(self.rows) if row.dated.verdict.robot), "")

    def to_json(self) -> str:
        """The text of ``history.json``."""
        names = ("status", "headline", "nominal", "since")
        rows = [
            {"date": row.dated.name, **{name: getattr(row.dated.verdict, name) for name in names}}
            | {"numbers": [dict(zip(KEY, key, strict=True)) | asdict(n) for key, n in row.numbers.items()]}
            for row in self.rows
        ]
        own = {name: getattr(self, name) for name in ("robot", "outcome", "since_last", "since_first", "changed")}
        return json.dumps({"schema": SCHEMA, **own, "rows": rows}, indent=1, ensure_ascii=False) + "\n"


class Moved(NamedTuple):
    """A number at two dates."""

    key: Key
    before: DatedNumber
    after: DatedNumber
    distance: float
    """In standard deviations; NaN where neither date has any."""


def drift_of(history: Sequence[Dated]) -> Drift:
    """The history of a robot from its diagnoses, oldest first, at least one."""
    rows = tuple(_rows(history))
    since = [e for d in history if d.verdict.since for e in d.verdict.differences]
    named = [key for row in rows for key in row.numbers if any(_is_of(key, e) for e in since)]
    far = [m.key for m in significant(rows[0], rows[-1])] if len(rows) > 1 else []
    changed = tuple(dict.fromkeys((*(key for key in far if key in named), *named, *far)))
    outcome, since_last = _told(*rows[-2:]) if len(rows) > 1 else (history[0].verdict.status, ())
    return Drift(rows, changed, outcome, since_last, _told(rows[0], rows[-1])[1] if len(rows) > 2 else ())


def _rows(history: Sequence[Dated]) -> Iterator[Row]:
    own = [
        {
            (n.effect, n.parameter, n.where): DatedNumber(n.title, n.unit, n.value, n.low, n.high)
            for n in (*d.verdict.calibration.numbers, *d.verdict.calibration.units)
        }
        for d in history
    ]
    effects = {effect for numbers in own for effect, _, _ in numbers}
    others = {(e.name, e.joints): e for d in history for e in d.verdict.differences if e.name not in effects}
    for d, numbers in zip(history, own, strict=True):
        for e in others.values():
            held = {name: n for name in e.parameters if (n := _held(d, e, name)) is not None}
            numbers |= {(e.name, name, words.joints_in_short(e.joints)): n for name, n in held.items()}
        yield Row(d, numbers)


def _held(d: Dated, e: Difference, name: str) -> DatedNumber | None:
    """A difference's number in the corrected model of a date, with an interval where that date measured it.

    None where the model does not have the number, as a limit that is never met.
    """
    same = [o for o in d.verdict.differences if (o.name, o.joints) == (e.name, e.joints)]
    n = next((o.parameters.get(name) for o in same), None)
    effect = LIBRARY[e.name].effect if e.name in LIBRARY else None
    known = None if effect is None else next((p for p in effect.parameters() if p.name == name), None)
    unit = "" if e.parameters[name].unit == "1" else e.parameters[name].unit
    title = f"{e.title or words.plain_name(e.name)}: {parameter_words(name)}"
    if effect is None or known is None or abs(known.null) >= NEVER_MET:
        return None if n is None else DatedNumber(title, unit, n.value, n.low, n.high)
    value = in_model(d.model, SPOT, effect, known, np.isin(JOINT_NAMES, e.joints))
    if n is None:
        return DatedNumber(title, unit, value)
    # What the date measured came on top of the model that it started from: a factor, or a summand.
    factor = value / n.value if known.null == 1.0 and n.value != 0.0 else 1.0
    return DatedNumber(title, unit, value, *(value + factor * (x - n.value) for x in (n.low, n.high)))


def _is_of(key: Key, e: Difference) -> bool:
    """Whether a number is of a difference's effect, and at its joints, leg or body."""
    effect, _, where = key
    is_leg = any(joint.startswith(f"{where}_") for joint in e.joints)
    return effect == e.name and (is_leg or where in ("body", "floor", words.joints_in_short(e.joints), *e.joints))


def significant(before: Row, after: Row) -> list[Moved]:
    """Numbers that two dates are significantly apart in, farthest first."""
    found = [m for m in _moved(before, after) if m.key[2] not in words.PLACES and np.isfinite(m.distance)]
    if not found:
        return []
    p_values = benjamini_hochberg(2.0 * norm.sf(np.abs([m.distance for m in found])))
    kept = [m for m, p in zip(found, p_values, strict=True) if p <= SIGNIFICANT]
    return sorted(kept, key=lambda m: -abs(m.distance))


def _moved(before: Row, after: Row) -> Iterator[Moved]:
    """Numbers that both dates know."""
    for key, old in before.numbers.items():
        if (new := after.numbers.get(key)) is not None:
            deviation = float(np.hypot(old.deviation, new.deviation))
            yield Moved(key, old, new, (new.value - old.value) / deviation if deviation > 0.0 else np.nan)


def _told(before: Row, after: Row) -> tuple[Outcome, tuple[str, ...]]:
    """What changed between two dates, in a word and in sentences."""
    v, date, told = after.dated.verdict, before.dated.name, list[str]()
    # None where it started from another model.
    named = v.differences if v.since == date else ()
    for e in named:
        own = _moves([m for m in _moved(before, after) if _is_of(m.key, e)]).replace(f"{e.title}: ", "")
        size = own or "; ".join(words.size_phrase(*p) for p in e.parameters.items())
        told.append(words.sentence(f"{words.found(e)}, P {e.probability:.2f}: {size}".removesuffix(": ")))
    others = {e.name for e in named}
    rest = [m for m in significant(before, after) if m.key[0] not in others]
    if rest:
        also = "also " if named else ""
        told.append(words.sentence(f"{also}changed, beyond what the intervals allow: {_moves(rest)}"))
    if v.status == "cannot_tell":
        return v.status, (*told, f"The logs of {after.dated.name} cannot tell.")
    if not told:
        first, second = ({k for k, n in row.numbers.items() if n.low is not None} for row in (before, after))
        compared = f"{len(first & second)} of its {len(first)} numbers are measured on both dates"
        told.append(f"No number is shown to have changed since {date}; {compared}.")
    was_unknown = before.dated.verdict.probability_unknown > NAMED
    if v.probability_unknown > NAMED:
        p, as_before = f"{v.probability_unknown:.2f}", f", as on {date}" if was_unknown else ""
        told.append(f"Something acts that no effect of the library explains (P {p}){as_before}.")
        return "changed" if named or rest else "unchanged" if was_unknown else "unknown_effect", tuple(told)
    return "changed" if named or rest else "unchanged", tuple(told)


def _moves(moved: Sequence[Moved]) -> str:
    """Numbers with where they came from; empty without any."""
    told = [
        f"{called(m.key, new)} {words.number(old.value, new.unit)} → "
        f"{words.number(new.value, new.unit, new.low, new.high)}"
        for m in moved[:MOST]
        for old, new in [(m.before, m.after)]
    ]
    return "; ".join([*told, *([f"{len(moved) - MOST} more numbers"] if len(moved) > MOST else [])])


def called(key: Key, n: DatedNumber) -> str:
    """What a number is, and where; the body's has no place."""
    return n.title if key[2] == "body" else f"{n.title} of {words.place(key[2])}"
