"""The scored table: every figure of the protocol with its bounds, for the diagnosis and the baselines."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal

from withheld.baselines import LEAST_SQUARES, PAPER, TWO_SAMPLE
from withheld.cases.draw import POWER_EFFECTS, RIVALS
from withheld.scoring.outcome import Outcome, ShrinkSaid
from withheld.scoring.scores import (
    EXPLAINS,
    MAX_GROUP,
    PARAMETER_ERROR,
    CaseScore,
    ParameterHit,
    is_foreign,
    is_full,
    is_large,
    parameters,
    score,
    score_answer,
    stated,
)
from withheld.scoring.statistics import Average, Share, brier

DIAGNOSIS: Final = "diagnosis"
METHODS: Final = (DIAGNOSIS, PAPER, TWO_SAMPLE, LEAST_SQUARES)
SINGLE: Final = ("known", "power", "own")


@dataclass(frozen=True)
class Row:
    """One figure."""

    key: str
    title: str
    value: Share | Average
    asked: str = ""
    """What the issue asks for."""
    is_met: bool | None = None

    def to_data(self) -> dict[str, Any]:
        """For JSON."""
        return {"key": self.key, "title": self.title, "asked": self.asked, "met": self.is_met, **self.value.to_data()}


@dataclass(frozen=True)
class Table:
    """Figures on one set of cases."""

    title: str
    rows: list[Row] = field(default_factory=list)
    n_cases: int = 0

    def to_data(self) -> dict[str, Any]:
        """For JSON."""
        return {"title": self.title, "cases": self.n_cases, "rows": [r.to_data() for r in self.rows]}


def table(title: str, outcomes: Sequence[Outcome]) -> Table:
    """All figures of the diagnosis on these cases."""
    scored = [(o, score(o)) for o in outcomes]
    singles = [s for o, s in scored if s.top1 is not None and len(o.truth.faults) == 1]
    several = [(o, s) for o, s in scored if s.top1 is not None and len(o.truth.faults) > 1]
    pairs = [s.found == 2 for o, s in several if len(o.truth.faults) == 2]
    triples = [s.found == 3 for o, s in several if len(o.truth.faults) == 3]
    alarms = _flags([s for _, s in scored], "false_alarm")
    hits = [h for o in outcomes for h in parameters(o)]
    made = stated(outcomes)
    b = brier(made.said, made.true)
    rows = [
        _at_least(
            "group",
            "one effect: called explained by it, or by its group of at most three",
            _flags(singles, "group"),
            0.90,
        ),
        _at_least(
            "first",
            "one effect: listed first, or in the first's group, whatever else the verdict says",
            _flags(singles, "first"),
            0.90,
        ),
        Row("top1", "one effect: named first, no group, and no other", Share.of(_flags(singles, "top1"))),
        Row("missed", "one effect: called no gap", Share.of(_flags(singles, "missed"))),
        _mean_at_least("joint_f1", "joint F1", [s.joint_f1 for _, s in scored if s.joint_f1 is not None], 0.9),
        _at_most("false_alarm", "false alarms where there is no effect", alarms, 0.05),
        _unknown("unknown", "effect not in its library: answered unknown", scored, None),
        _unknown("left_out", "of those, left out for the case", scored, True),
        _unknown("never", "of those, never had", scored, False),
        Row(
            "unknown_joints",
            "of those answered unknown: the right joints",
            Share.of([s.unknown_joints for _, s in scored if s.unknown_joints is not None]),
        ),
        _at_least("two", "two at once: both found", pairs, 0.75),
        Row("three", "three at once: all found", Share.of(triples)),
        *_parameter_rows(hits),
        *_shrink_rows(scored),
        Row("brier", "Brier score of all stated probabilities", Average(() if b is None else (b,))),
        Row("failed", "ended without a verdict", Share.of([o.status == "failed" for o in outcomes])),
    ]
    return Table(title, rows, len(outcomes))


def _parameter_rows(hits: Sequence[ParameterHit]) -> list[Row]:
    return [
        _at_least(
            "parameter",
            "parameters of a right effect: within 20 % of the truth",
            [h.error <= PARAMETER_ERROR for h in hits],
            0.90,
            named="within 20 %",
        ),
        _at_least(
            "coverage",
            "parameters of a right effect: 90 % interval holds the truth",
            [h.covered for h in hits],
            0.90,
            named="90 %",
        ),
    ]


def _shrink_rows(scored: Sequence[tuple[Outcome, CaseScore]]) -> list[Row]:
    right = [o for o, s in scored if s.group and o.shrink is not None and o.shrink.s is not None]
    shrinks = [o.shrink for o in right if o.shrink is not None]
    said = [s.s for s in shrinks if s.s is not None]
    true = [s for s in shrinks if s.true_s is not None and s.low is not None and s.high is not None]
    held = [
        s.low <= s.true_s <= s.high for s in true if s.low is not None and s.high is not None and s.true_s is not None
    ]
    truths = tuple(s.true_s for s in true if s.true_s is not None)
    pairs = [(s.placebo, s.s) for s in shrinks if s.placebo is not None and s.s is not None]
    return [
        _mean_at_least("s", "held-out S where the diagnosis is right", said, 0.8),
        Row("s_share", "of those, S at least 0.8", Share.of([s >= 0.8 for s in said])),
        _at_least("s_coverage", "90 % interval of S holds the true S", held, 0.90, named="90 %"),
        Row("true_s", "true S of the stated model, new sequences", Average(truths)),
        Row("placebo", "S of the best wrong effect", Average(tuple(p for p, _ in pairs))),
        Row("placebo_below", "of those, below S by 0.1 or more", Share.of([p < s - 0.1 for p, s in pairs])),
    ]


def _unknown(key: str, title: str, scored: Sequence[tuple[Outcome, CaseScore]], left_out: bool | None) -> Row:
    flags = [
        s.unknown
        for o, s in scored
        if s.unknown is not None and (left_out is None or any(f.names for f in o.truth.faults) == left_out)
    ]
    return _at_least(key, title, flags, 0.80)


def comparison(outcomes: Sequence[Outcome]) -> dict[str, dict[str, Any]]:
    """By figure and method, on the cases where all methods that can answer were run."""
    made: dict[str, dict[str, Any]] = {}
    for key, title, pick in _QUESTIONS:
        entry: dict[str, Any] = {"title": title}
        for method in METHODS:
            values = [v for o in outcomes if (s := _scored(o, method)) is not None and (v := pick(s)) is not None]
            can = not (method == TWO_SAMPLE and key in ("group", "found"))
            whole: Share | Average = (
                Average(tuple(float(v) for v in values)) if key == "joint_f1" else Share.of([bool(v) for v in values])
            )
            entry[method] = whole.to_data() if can else None
        same = [o for o in outcomes if PAPER in o.baselines]
        values = [v for o in same if (v := pick(score(o))) is not None]
        entry["diagnosis_where_paper_ran"] = (
            Average(tuple(float(v) for v in values)) if key == "joint_f1" else Share.of([bool(v) for v in values])
        ).to_data()
        made[key] = entry
    return made


_QUESTIONS: Final[tuple[tuple[str, str, Callable[[CaseScore], float | bool | None]], ...]] = (
    ("group", "effect or effects named, in groups of at most three, and no other", lambda s: s.group),
    ("found", "at least one true effect named", lambda s: None if s.group is None else s.found > 0),
    ("joint_f1", "joint F1", lambda s: s.joint_f1),
    ("false_alarm", "false alarms where there is no effect", lambda s: s.false_alarm),
    ("unknown", "effect not in its library: answered unknown", lambda s: s.unknown),
)


def _scored(o: Outcome, method: str) -> CaseScore | None:
    if method == DIAGNOSIS:
        return score(o)
    return score_answer(o, o.baselines[method]) if method in o.baselines else None


def tables(outcomes: Sequence[Outcome]) -> dict[str, Table]:
    """All sets of cases that are scored by themselves."""
    large = [o for o in outcomes if not o.truth.faults or is_large(o)]
    power = [o for o in outcomes if o.case.kind == "power"]
    full = [o for o in outcomes if is_full(o) and o.case.kind != "power"]
    fitting = [o for o in full if not o.truth.faults or is_large(o)]
    return {
        "all": table("all cases", outcomes),
        "issue": table("as asked: five repeats, all signals, effects that move the gap by twice its floor", fitting),
        "large": table("effects that move the gap by twice its floor, any logs", large),
        "full": table("five repeats of three sequences, all signals, every size", full),
        "power": _power_table(power),
    }


def _power_table(outcomes: Sequence[Outcome]) -> Table:
    answers = [power_answer(o) for o in outcomes]
    right = [o.shrink for o, a in zip(outcomes, answers, strict=True) if a == "named" and o.shrink is not None]
    rows = [
        Row(
            "power_named", "the limit of power or bus is named as the cause", Share.of([a == "named" for a in answers])
        ),
        Row(
            "power_told",
            "or called one of a group that these logs cannot tell apart, with the recording that would",
            Share.of([a == "told" for a in answers]),
        ),
        _at_least("power_answered", "one of the two", [a in ("named", "told") for a in answers], 0.90),
        Row(
            "power_listed",
            "neither, but it is listed among what was thought of",
            Share.of([a == "listed" for a in answers]),
        ),
        Row("rival", "a rival named in its place: armature or friction", Share.of([a == "rival" for a in answers])),
        Row("power_d0", "where it is named: gap of the nominal model, in floors", Average(_in_floors(right, "d0"))),
        Row("power_d1", "gap of the model with it, in floors", Average(_in_floors(right, "d1"))),
    ]
    title = "power-distribution limit at 4 to 6 m/s, armature and friction as rivals"
    return Table(title, [*table(title, outcomes).rows, *rows], len(outcomes))


PowerAnswer = Literal["named", "told", "listed", "rival", "other"]


def power_answer(o: Outcome) -> PowerAnswer:
    """What a verdict says of a hidden limit of power: POWER_EFFECTS alone count here, no equivalent of theirs."""
    groups = [set(e.group) | {e.name} for e in o.effects]
    if o.status in EXPLAINS and any(e.name in POWER_EFFECTS and len(e.group) <= 1 for e in o.effects):
        return "named"
    undecided = [e for e, g in zip(o.effects, groups, strict=True) if g & POWER_EFFECTS and 1 < len(g) <= MAX_GROUP]
    if o.status in (*EXPLAINS, "cannot_tell") and any(e.split_by for e in undecided):
        return "told"
    if any(g & POWER_EFFECTS for g in groups):
        return "listed"
    return "rival" if o.status in EXPLAINS and any(g & RIVALS for g in groups) else "other"


def _in_floors(shrinks: Sequence[ShrinkSaid], name: str) -> tuple[float, ...]:
    return tuple(getattr(s, name) / s.floor for s in shrinks if s.floor > 0.0)


def breakdown(outcomes: Sequence[Outcome]) -> dict[str, dict[str, Share]]:
    """Single effects in their library, named in a group: by repeats, signals, policy, place and family."""
    singles = [(o, bool(score(o).group)) for o in outcomes if len(o.truth.faults) == 1 and not is_foreign(o)]
    cuts: dict[str, Callable[[Outcome], str]] = {
        "repeats": lambda o: str(o.case.repeats),
        "signals": lambda o: "without " + ", ".join(o.case.missing) if o.case.missing else "all",
        "policy": lambda o: o.case.policy,
        "place": lambda o: o.case.requests[0].place if o.case.requests else "own",
        "family": lambda o: o.truth.faults[0].family,
        "moves the gap": lambda o: "by twice its floor" if is_large(o) else "by less",
    }
    made: dict[str, dict[str, Share]] = {}
    for name, cut in cuts.items():
        values = sorted({cut(o) for o, _ in singles})
        made[name] = {v: Share.of([hit for o, hit in singles if cut(o) == v]) for v in values}
    return made


def confusion(outcomes: Sequence[Outcome]) -> dict[str, dict[str, int]]:
    """What was hidden against what was said, one count a case of at most one effect."""
    made: dict[str, dict[str, int]] = {}
    for o in outcomes:
        if len(o.truth.faults) > 1:
            continue
        hidden = "none" if not o.truth.faults else _name_of(o)
        made.setdefault(hidden, {})
        said = _said(o)
        made[hidden][said] = made[hidden].get(said, 0) + 1
    return made


def power_curve(outcomes: Sequence[Outcome]) -> list[tuple[float, Share, Share]]:
    """By size on the ladder, of single effects in their library: named in a group, and not called none."""
    singles = [(o, score(o)) for o in outcomes if len(o.truth.faults) == 1 and not is_foreign(o)]
    sizes = sorted({o.truth.faults[0].size for o, _ in singles})
    return [
        (
            size,
            Share.of([bool(s.group) for o, s in singles if o.truth.faults[0].size == size]),
            Share.of([not s.missed for o, s in singles if o.truth.faults[0].size == size]),
        )
        for size in sizes
    ]


def _name_of(o: Outcome) -> str:
    fault = o.truth.faults[0]
    if not fault.names:
        return "never had"
    return f"{fault.names[0]} (left out)" if is_foreign(o) else fault.names[0]


def _said(o: Outcome) -> str:
    if o.status == "failed":
        return "no verdict"
    if o.status in ("no_gap", "cannot_tell"):
        return "none"
    if o.status == "unknown_effect":
        return "unknown"
    return o.effects[0].name if len(o.effects) == 1 else "several"


def _flags(scores: Sequence[CaseScore], name: str) -> list[bool]:
    return [getattr(s, name) for s in scores if getattr(s, name) is not None]


def _at_least(key: str, title: str, flags: Sequence[bool | None], asked: float, *, named: str = "") -> Row:
    share = Share.of([bool(f) for f in flags])
    met = None if share.value is None else share.value >= asked
    return Row(key, title, share, named or f"at least {100 * asked:.0f} %", met)


def _at_most(key: str, title: str, flags: Sequence[bool], asked: float) -> Row:
    share = Share.of(flags)
    return Row(key, title, share, f"at most {100 * asked:.0f} %", None if share.value is None else share.value <= asked)


def _mean_at_least(key: str, title: str, values: Sequence[float], asked: float) -> Row:
    mean = Average(tuple(values))
    return Row(key, title, mean, f"at least {asked:g}", None if mean.value is None else mean.value >= asked)
