"""What each case scores, for the diagnosis and for each baseline; no table yet."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Final

from diagnosis.library.base import Location
from diagnosis.library.registry import LIBRARY
from withheld.plan import Fault
from withheld.scoring.outcome import Answer, Outcome, Said

LARGE: Final = 2.0
"""Large effects move the headline gap by at least this many times its floor; the figures asked for are of those."""
FULL_REPEATS: Final = 5
PARAMETER_ERROR: Final = 0.20
MAX_GROUP: Final = 3
UNKNOWN: Final = frozenset({"unknown_effect"})
SILENT: Final = frozenset({"no_gap", "cannot_tell"})
EXPLAINS: Final = frozenset({"explained", "partly_explained"})
"""A verdict of any other status lists what it thought of, and names nothing."""


@dataclass(frozen=True)
class CaseScore:
    """Right or wrong, by question; None where the question does not arise."""

    top1: bool | None
    """Exactly the true effects are named first in their groups."""
    group: bool | None
    """The gap is called explained, every true effect is in a group of at most three, and there are not more groups."""
    found: int
    """True effects that are in some group of at most three, whatever the status."""
    joint_f1: float | None
    false_alarm: bool | None
    missed: bool | None
    """There is an effect, and the verdict is none."""
    unknown: bool | None
    unknown_joints: bool | None
    """Of those answered unknown: at least half of the named joints are true, and at least one true one is named."""
    first: bool | None = None
    """Of one effect: the first that the verdict lists, or its group of at most three, is right, whatever the status."""


def score(o: Outcome) -> CaseScore:
    """Score the verdict of a case."""
    faults = o.truth.faults
    groups = [e.group or (e.name,) for e in o.effects]
    firsts = [e.name for e in o.effects]
    if not faults:
        return CaseScore(None, None, 0, None, o.status not in (*SILENT, "failed"), None, None, None)
    if is_foreign(o):
        says = o.status in UNKNOWN
        true = true_joints(faults)
        joints = _joints_right(o.unknown_joints, true) if says and true else None
        return CaseScore(None, None, 0, None, None, o.status in SILENT, says, joints)
    found = sum(any(set(f.names) & set(g) and len(g) <= MAX_GROUP for g in groups) for f in faults)
    is_explained = o.status in EXPLAINS
    top = is_explained and len(firsts) == len(faults) and all(any(n in f.names for n in firsts) for f in faults)
    first = bool(groups) and bool(set(faults[0].names) & set(groups[0])) and len(groups[0]) <= MAX_GROUP
    return CaseScore(
        top1=top,
        group=is_explained and found == len(faults) and len(groups) <= len(faults),
        found=found,
        joint_f1=f1(located(o), true_joints(faults)) if true_joints(faults) else None,
        false_alarm=None,
        missed=o.status in SILENT,
        unknown=None,
        unknown_joints=None,
        first=first if len(faults) == 1 else None,
    )


def score_answer(o: Outcome, a: Answer) -> CaseScore:
    """Score a baseline: it names one effect at most, and knows no groups and no unknown."""
    faults = o.truth.faults
    if not faults:
        return CaseScore(None, None, 0, None, a.has_gap, None, None, None)
    if is_foreign(o):
        return CaseScore(None, None, 0, None, None, not a.has_gap, False, None)
    right = [f for f in faults if a.has_gap and a.effect in f.names]
    true = true_joints(faults)
    said = set(a.joints) if a.has_gap else set()
    return CaseScore(
        top1=len(right) == len(faults) == 1,
        group=len(right) == len(faults) == 1,
        found=len(right),
        joint_f1=f1(said, true) if true else None,
        false_alarm=None,
        missed=not a.has_gap,
        unknown=None,
        unknown_joints=None,
    )


def is_foreign(o: Outcome) -> bool:
    """Whether none of the case's effects can be named with the library that it was given."""
    left = set(LIBRARY) - set(o.case.without)
    return bool(o.truth.faults) and not any(set(f.names) & left for f in o.truth.faults)


def is_large(o: Outcome) -> bool:
    """Whether the faults move the headline gap by at least twice its floor."""
    return o.moved is not None and o.moved >= LARGE


def is_full(o: Outcome) -> bool:
    """Whether the logs are what the figures of the diagnosis ask for: five repeats of three sequences, all signals."""
    return o.case.repeats >= FULL_REPEATS and not o.case.missing


def true_joints(faults: Iterable[Fault]) -> set[str]:
    """Joints of all faults; empty where none is a matter of joints."""
    return {j for f in faults for j in f.joints}


def said_joints(effects: Iterable[Said]) -> set[str]:
    """Joints of effects that are local to joints in the library; the rest names all twelve by form alone."""
    return {j for e in effects if not _is_of_robot(e) for j in e.joints}


def located(o: Outcome) -> set[str]:
    """Joints at which a verdict sees something: those of its effects, or of what it calls unknown."""
    return said_joints(o.effects) | (set(o.unknown_joints) if o.status in UNKNOWN else set())


def f1(said: set[str], true: set[str]) -> float:
    """2 · hits / (said + true)."""
    return 2 * len(said & true) / max(1, len(said) + len(true))


def _is_of_robot(e: Said) -> bool:
    return e.name in LIBRARY and LIBRARY[e.name].location is Location.ROBOT


def _joints_right(said: Iterable[str], true: set[str]) -> bool:
    named = set(said)
    return bool(named & true) and len(named & true) >= len(named) / 2


@dataclass(frozen=True)
class ParameterHit:
    """One stated parameter of a right effect."""

    name: str
    true: float
    said: float
    error: float
    """Relative to how far the truth is from the parameter's null."""
    covered: bool


def parameters(o: Outcome) -> list[ParameterHit]:
    """Every parameter whose true value is known, of effects that were named right."""
    hits: list[ParameterHit] = []
    for effect in o.effects:
        fault = next((f for f in o.truth.faults if effect.name in f.names), None)
        if fault is None or effect.name not in LIBRARY:
            continue
        nulls = {p.name: p.null for p in LIBRARY[effect.name].effect.parameters()}
        for name, number in effect.parameters.items():
            true = fault.parameters.get(f"{effect.name}.{name}")
            null = nulls.get(name, 0.0)
            reach = abs(true - null) if true is not None and abs(null) < 1e9 else abs(true or 0.0)
            if true is None or reach < 1e-12:
                continue
            error = abs(number.value - true) / reach
            hits.append(
                ParameterHit(f"{effect.name}.{name}", true, number.value, error, number.low <= true <= number.high)
            )
    return hits


@dataclass(frozen=True)
class Stated:
    """Stated probabilities and whether they came true, for the reliability diagram."""

    said: list[float] = field(default_factory=list)
    true: list[bool] = field(default_factory=list)


def stated(outcomes: Iterable[Outcome]) -> Stated:
    """Every probability of a verdict: of each effect (with its group), of none, and of unknown."""
    made = Stated()
    for o in outcomes:
        if o.status == "failed":
            continue
        names = {n for f in o.truth.faults for n in f.names}
        claims: list[tuple[float, bool]] = [
            (o.probability_none, not o.truth.faults),
            (o.probability_unknown, is_foreign(o)),
        ]
        claims += [(e.probability, e.name in names) for e in o.effects]
        for p, was in claims:
            made.said.append(p)
            made.true.append(was)
    return made


Select = Callable[[Outcome], bool]
