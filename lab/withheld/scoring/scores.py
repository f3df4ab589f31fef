"""Right or wrong, case by case: which faults matter, what is named, and what is said of it; no table yet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from spot_model.effects.registry import BUILT_IN
from withheld.outcome import Change, Consequences, Difference, Number, Outcome, Verdict
from withheld.plan import Fault

LARGE: Final = 2.0
"""A fault matters that moves the headline gap by at least this many times its floor."""
SPEED_M_S: Final = 0.1
"""And one that costs so much of the top or mean speed."""
POWER: Final = 0.05
"""And one that costs so large a share of the power more."""
FALL: Final = 1.0 / 15.0
"""And one by which so large a share of the runs more ends in a fall: one of fifteen."""


def is_costly(own: Consequences | None) -> bool:
    """Whether a fault costs speed, power, or a fall."""
    if own is None:
        return False
    lost = (own.top_speed.of, own.mean_speed.of)
    power = own.power.of
    return (
        any(change is not None and change <= -SPEED_M_S for change in lost)
        or (power is not None and power >= POWER * (own.power.before or 0.0))
        or (own.fall_share.of or 0.0) >= FALL
    )


def matters(o: Outcome, number: int) -> bool:
    """Whether one of a case's faults does."""
    moved = o.moved[number] if number < len(o.moved) else None
    own = o.consequences[number] if number < len(o.consequences) else None
    return (moved is not None and moved >= LARGE) or is_costly(own)


def does(o: Outcome, number: int) -> str:
    """What one of a case's faults does, in words."""
    moved = o.moved[number] if number < len(o.moved) else None
    own = o.consequences[number] if number < len(o.consequences) else None
    words = ["" if moved is None else f"moves the robot by {moved:.1f} times what repeats explain"]
    if own is not None:
        units = (("top speed", own.top_speed, "m/s"), ("mean speed", own.mean_speed, "m/s"), ("power", own.power, "W"))
        words += [f"{name} {c.of:+.2g} {unit}" for name, c, unit in units if c.of is not None]
        words += [f"falls {100 * own.fall_share.of:+.0f} %"] if own.fall_share.of else []
    told = ", ".join(filter(None, words)) or "not measured"
    return f"{told}; {'matters' if matters(o, number) else 'does not matter'}"


def is_named_by_library(fault: Fault, o: Outcome) -> bool:
    """Whether the case's library holds an effect that is a right answer."""
    return bool(set(fault.names) - set(o.case.without))


def inside(o: Outcome) -> list[int]:
    """Numbers of the faults that the case's library could name."""
    return [i for i, f in enumerate(o.truth.faults) if is_named_by_library(f, o)]


def outside(o: Outcome) -> list[int]:
    """Numbers of those that it could not."""
    return [i for i, f in enumerate(o.truth.faults) if not is_named_by_library(f, o)]


MAX_GROUP: Final = 3
"""A larger group of rivals names nothing."""
NEGLIGIBLE: Final = 1e-12


def differences(verdict: Verdict | None) -> tuple[Difference, ...]:
    """What a verdict names, whatever its status."""
    return verdict.differences if verdict is not None else ()


@dataclass(frozen=True)
class Score:
    """How the differences that a verdict names fit the faults of its case."""

    named: Mapping[int, Difference]
    """By number of the fault, the difference that names it, alone or in a group of at most three."""
    n_wrong: int
    """Differences that are none of the faults."""
    is_unknown: bool
    """Something is called unknown."""

    @property
    def is_clean(self) -> bool:
        """Nothing is named that is not there, and nothing is called unknown."""
        return self.n_wrong == 0 and not self.is_unknown

    @property
    def is_outside_seen(self) -> bool:
        """An effect that the library lacks is called unknown, and by no wrong name."""
        return self.n_wrong == 0 and self.is_unknown


def score(o: Outcome) -> Score:
    """Score a verdict; a missing one names nothing and is not clean."""
    verdict = o.verdict
    if verdict is None:
        return Score({}, 1, False)
    named, wrong = dict[int, Difference](), 0
    for difference in verdict.differences:
        hits = [i for i in inside(o) if i not in named and difference.names & {*o.truth.faults[i].names}]
        if not hits:
            wrong += 1
        elif len(difference.names) <= MAX_GROUP:
            named[hits[0]] = difference
    return Score(named, wrong, verdict.is_unknown)


def is_right(o: Outcome) -> bool | None:
    """Whether the verdict is what a perfect diagnosis would say; None where nothing is asked.

    Every fault of the library is named and nothing else. Of one outside the library that matters, something is called
    unknown; one that does not matter may be seen or not.
    """
    s, known, lacking = score(o), inside(o), outside(o)
    if lacking and not known and not any(matters(o, i) for i in lacking):
        return None
    if s.n_wrong or s.named.keys() != {*known}:
        return False
    return not s.is_unknown if not lacking else s.is_outside_seen or not any(matters(o, i) for i in lacking)


def f1(said: set[str], true: set[str]) -> float:
    """2 · hits / (said + true)."""
    return 2 * len(said & true) / max(1, len(said) + len(true))


def joints_f1(o: Outcome) -> list[float]:
    """F1 of the joints of each fault that is named and is a matter of joints."""
    faults = ((o.truth.faults[i], difference) for i, difference in score(o).named.items())
    return [f1({*difference.joints}, {*fault.joints}) for fault, difference in faults if fault.joints]


@dataclass(frozen=True)
class ParameterHit:
    """One stated parameter of a right difference; error and half-width are shares of the truth's distance from null."""

    name: str
    true: float
    said: float
    error: float
    half_width: float
    is_covered: bool


def parameters(o: Outcome) -> list[ParameterHit]:
    """Every parameter whose true value is known, of effects that were named right, for each joint type of the fault."""
    hits: list[ParameterHit] = []
    for number, difference in score(o).named.items():
        fault = o.truth.faults[number]
        if difference.name not in fault.names or difference.name not in BUILT_IN:
            continue
        nulls = {p.name: p.null for p in BUILT_IN[difference.name].parameters()}
        for where, said in _by_type(difference, fault).items():
            for name, number_said in said.items():
                true = fault.parameters.get(f"{difference.name}.{name}")
                null = nulls.get(name, 0.0)
                if true is None:
                    continue
                reach = abs(true - null) if abs(null) < 1e9 else abs(true)
                if reach >= NEGLIGIBLE:
                    hits.append(
                        _hit(" ".join(filter(None, (f"{difference.name}.{name}", where))), true, number_said, reach)
                    )
    return hits


def _by_type(difference: Difference, fault: Fault) -> dict[str, Mapping[str, Number]]:
    """Stated numbers of each type of joint at which a fault acts; under no name where it is no matter of joints."""
    types = dict.fromkeys(joint.rpartition("_")[2] for joint in fault.joints) or {"": None}
    return {kind: {**difference.parameters, **difference.by_type.get(kind, {})} for kind in types}


def _hit(name: str, true: float, said: Number, reach: float) -> ParameterHit:
    return ParameterHit(
        name,
        true,
        said.value,
        abs(said.value - true) / reach,
        0.5 * (said.high - said.low) / reach,
        said.low <= true <= said.high,
    )


Claim = tuple[float, bool]
"""A stated probability, and whether it was so."""


def claims(o: Outcome) -> list[Claim]:
    """P(it is there) of each stated difference, and of each fault of the library that none of them names.

    A fault that is not stated counts at the probability that a difference gives it as a rival, or at 0.
    """
    stated = stated_claims(o)
    all_names = frozenset[str]().union(*(d.names for d in differences(o.verdict)))
    missed = [o.truth.faults[i] for i in inside(o) if not all_names & {*o.truth.faults[i].names}]
    rivals = [d.rivals for d in differences(o.verdict)]
    return [*stated, *((max((r.get(n, 0.0) for r in rivals for n in f.names), default=0.0), True) for f in missed)]


def stated_claims(o: Outcome) -> list[Claim]:
    """Claims of the stated differences alone."""
    there = {name for i in inside(o) for name in o.truth.faults[i].names}
    return [(d.probability, bool(d.names & there)) for d in differences(o.verdict)]


STATED_SPEED_M_S: Final = 0.05
STATED_SHARE: Final = 0.3
"""Of the true change of a speed or of the power; and of the runs, for falls."""
SPEEDS: Final = ("top_speed", "mean_speed")


def speeds_right(o: Outcome) -> list[bool]:
    """Whether each stated change of top and mean speed is within 0.05 m/s or 30 % of the true one."""
    return [
        stated is not None and abs(stated - true) <= max(STATED_SPEED_M_S, STATED_SHARE * abs(true))
        for quantity in SPEEDS
        for true, stated in _changes(o, quantity)
    ]


def power_right(o: Outcome) -> list[bool]:
    """Whether each change of the power, as a share of it, is within 30 % of the true one; where either is 5 % or more.

    As a share: what a robot draws beside the work of its joints is none of the model's.
    """
    return [
        stated is not None and abs(stated - true) <= STATED_SHARE * abs(true)
        for true, stated in _changes(o, "power", is_share=True)
        if max(abs(true), abs(stated or 0.0)) >= POWER
    ]


def falls_right(o: Outcome) -> list[bool]:
    """Whether the stated change of the share of runs that fall is within 0.3 of the true one."""
    return [stated is not None and abs(stated - true) <= STATED_SHARE for true, stated in _changes(o, "fall_share")]


def _changes(o: Outcome, quantity: str, *, is_share: bool = False) -> list[tuple[float, float | None]]:
    """True and stated change, or its share of what was before, by each named fault whose true one is known."""
    found = []
    for number, difference in score(o).named.items():
        own = o.consequences[number] if number < len(o.consequences) else None
        stated = difference.consequences.changes if difference.consequences is not None else ()
        true = _size(getattr(own, quantity, None), is_share)
        if true is not None:
            found.append((true, _size(next((c for c in stated if c.quantity == quantity), None), is_share)))
    return found


def _size(change: Change | None, is_share: bool) -> float | None:
    if change is None or change.of is None or not is_share:
        return None if change is None else change.of
    return change.of / change.before if change.before else None
