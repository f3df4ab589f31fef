"""Right or wrong, case by case; no table yet."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from spot_model.effects.registry import BUILT_IN
from withheld.cases.source import CATALOGUES
from withheld.outcome import Outcome
from withheld.plan import Fault
from withheld.realities.fault_kind import BODY
from withheld.scoring.sizes import Size, is_named_by_library, is_outside, sizes
from withheld.verdict import EXPLAINS, Said, Verdict

MAX_GROUP: Final = 3
"""A larger group of rivals names nothing."""
UNKNOWN: Final = "unknown_effect"
ROBOT_WIDE: Final = frozenset(
    name
    for catalogue in CATALOGUES.values()
    for kind in catalogue.values()
    if kind.places == BODY
    for name in kind.names
)
"""Effects of the whole robot: their joints say nothing about where."""
NEGLIGIBLE: Final = 1e-12


def causes(verdict: Verdict | None) -> tuple[Said, ...]:
    """What a verdict names as causes of the gap."""
    return verdict.effects if verdict is not None and verdict.status in EXPLAINS else ()


@dataclass(frozen=True)
class Score:
    """How the causes that a verdict names fit the faults of its case."""

    named: frozenset[int]
    """Numbers of the faults that are named, alone or in a group of at most three."""
    n_wrong: int
    """Causes that are none of the faults."""
    is_silent: bool
    """Nothing is named, and nothing is called unknown."""
    is_unknown: bool

    @property
    def is_clean(self) -> bool:
        """Nothing is named that is not there, and nothing is called unknown."""
        return self.n_wrong == 0 and not self.is_unknown


def score(o: Outcome, round_number: int = 0) -> Score:
    """Score the verdict of a round; one that is missing is neither silent nor right."""
    verdict = o.rounds[round_number].verdict
    if verdict is None:
        return Score(frozenset(), 1, False, False)
    left = {i: f for i, f in enumerate(o.truth.faults) if is_named_by_library(f, o)}
    named, wrong = set[int](), 0
    for cause in causes(verdict):
        hit = next((i for i, f in left.items() if i not in named and cause.names & set(f.names)), None)
        if hit is None:
            wrong += 1
        elif len(cause.names) <= MAX_GROUP:
            named.add(hit)
    is_unknown = verdict.status == UNKNOWN
    return Score(frozenset(named), wrong, not causes(verdict) and not is_unknown, is_unknown)


def is_right(o: Outcome, round_number: int = 0) -> bool | None:
    """Whether the verdict is what a perfect diagnosis would say; None where the truth is in between.

    Every large fault is named and nothing else; an outside one is called unknown; where nothing matters, nothing is
    named. A small fault may be named beside a large one.
    """
    s, of = score(o, round_number), sizes(o)
    if Size.UNMEASURED in of:
        return None
    if not o.truth.faults or all(size is Size.SMALL for size in of):
        return s.is_silent
    large = {i for i, size in enumerate(of) if size is Size.LARGE}
    if not large:
        return None
    return s.is_unknown if is_outside(o) else large <= s.named and s.is_clean


def located(o: Outcome) -> set[str]:
    """Joints at which a verdict sees something: those of its causes, or of what it calls unknown."""
    joints = {j for e in causes(o.verdict) if e.name not in ROBOT_WIDE for j in e.joints}
    if o.verdict is not None and o.verdict.status == UNKNOWN and o.verdict.unknown is not None:
        joints |= set(o.verdict.unknown.joints)
    return joints


def true_joints(faults: Iterable[Fault]) -> set[str]:
    """Joints of all faults; empty where none is a matter of joints."""
    return {j for f in faults for j in f.joints}


def f1(said: set[str], true: set[str]) -> float:
    """2 · hits / (said + true)."""
    return 2 * len(said & true) / max(1, len(said) + len(true))


@dataclass(frozen=True)
class ParameterHit:
    """One stated parameter of a right cause; error and half-width are shares of the truth's distance from null."""

    name: str
    true: float
    said: float
    error: float
    half_width: float
    is_covered: bool


def parameters(o: Outcome) -> list[ParameterHit]:
    """Every parameter whose true value is known, of causes that were named right."""
    hits: list[ParameterHit] = []
    for cause in causes(o.verdict):
        fault = next((f for f in o.truth.faults if cause.name in f.names), None)
        if fault is None or cause.name not in BUILT_IN:
            continue
        nulls = {p.name: p.null for p in BUILT_IN[cause.name].parameters()}
        for name, number in cause.parameters.items():
            true = fault.parameters.get(f"{cause.name}.{name}")
            null = nulls.get(name, 0.0)
            if true is None:
                continue
            reach = abs(true - null) if abs(null) < 1e9 else abs(true)
            if reach < NEGLIGIBLE:
                continue
            hits.append(
                ParameterHit(
                    f"{cause.name}.{name}",
                    true,
                    number.value,
                    abs(number.value - true) / reach,
                    0.5 * (number.high - number.low) / reach,
                    number.low <= true <= number.high,
                )
            )
    return hits


Claim = tuple[float, bool]
"""A stated probability, and whether it was so."""


def claims(o: Outcome) -> list[Claim]:
    """Every probability of a verdict: of each cause with its group, of no gap, and of an unknown effect.

    Only of cases in which each fault clearly matters or clearly does not.
    """
    of = sizes(o)
    if o.verdict is None or any(size in (Size.BETWEEN, Size.UNMEASURED) for size in of):
        return []
    large = [f for f, size in zip(o.truth.faults, of, strict=True) if size is Size.LARGE]
    made = [(e.probability, any(e.names & set(f.names) for f in large)) for e in o.verdict.effects]
    made.append((o.verdict.probability_none, not large))
    made.append((o.verdict.probability_unknown, bool(large) and is_outside(o)))
    return made
