"""The scored table: every figure that is asked of the diagnosis, with its interval."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from withheld.outcome import GAPS, Outcome, Shrink
from withheld.scoring.scores import (
    claims,
    differences,
    falls_right,
    inside,
    is_right,
    joints_f1,
    matters,
    outside,
    parameters,
    power_right,
    score,
    speeds_right,
    stated_claims,
)
from withheld.scoring.statistics import Estimate, Row, Share, between, calibration_error, estimate, mean, median, share

PARAMETER_ERROR: Final = 0.20
SURE: Final = 0.9
SCALES: Final = ((0.5, 1.0), (1.0, 2.0), (2.0, 4.0), (4.0, 5.0))
ASKED_SCALES: Final = (1.0, 4.0)
LIMITS: Final = frozenset({"power_limit", "bus_sag"})


def table(outcomes: Sequence[Outcome]) -> list[Row]:
    """All rows."""
    long = [o for o in outcomes if o.case.detail == "stream"]
    short = [o for o in outcomes if o.case.detail == "import"]
    known = [o for o in long if inside(o) and not outside(o)]
    return [
        *_faultless([o for o in long if not o.truth.faults]),
        *_named(known),
        *_outside([o for o in long if outside(o)]),
        *_numbers(known),
        *_consequences(known),
        *_shrinks([o for o in known if is_right(o)]),
        *_probabilities(outcomes, short),
        *_sprint([o for o in outcomes if o.case.kind == "sprint"]),
        share("failed", "ended without a verdict", [o.verdict is None for o in outcomes]),
    ]


def _faultless(none: Sequence[Outcome]) -> list[Row]:
    def silent(low: float, high: float) -> list[bool]:
        return [_is_silent(o) for o in none if low <= o.truth.error_scale <= high]

    title = "no fault, ordinary errors 1 to 4 times the usual: no difference named, nothing called unknown"
    rows = [share("faultless", title, silent(*ASKED_SCALES), 0.95)]
    rows += [
        share(f"faultless_{low:g}", f"of these, errors {low:g} to {high:g} times the usual", silent(low, high))
        for low, high in SCALES
    ]
    gaps = [s.d0 / s.floor for o in none if o.case.repeats > 1 and (s := _shrink(o)) and s.floor > 0.0]
    title = "no fault: gap of the nominal model, in times what repeats explain"
    rows.append(estimate("faultless_gap", title, Estimate.of(gaps, median)))
    called = [o.status == "no_gap" for o in none]
    return [*rows, share("no_gap", "no fault: called no gap, not calibration", called)]


def _is_silent(o: Outcome) -> bool:
    return not differences(o.verdict) and score(o).is_clean


def _named(known: Sequence[Outcome]) -> list[Row]:
    one, two = ([o for o in known if len(o.truth.faults) == n] for n in (1, 2))
    matter = [o for o in one if matters(o, 0)]
    both = [o for o in two if matters(o, 0) and matters(o, 1)]
    return [
        share("one", "one effect of the library, whatever it moves: named, and nothing else", _right(one), 0.80),
        share("one_matters", "of these that matter: named, and nothing else", _right(matter), 0.92),
        share("one_named", "one effect: named, whatever else is", [bool(score(o).named) for o in one]),
        share("one_wrong", "one effect: a wrong name, alone or beside it", [score(o).n_wrong > 0 for o in one]),
        share("one_unknown", "one effect: named, but something is called unknown", [_and_unknown(o) for o in one]),
        share("one_silent", "one effect: nothing named, nothing called unknown", [_is_silent(o) for o in one]),
        share("two", "two effects of the library: both named, and nothing else", _right(two), 0.80),
        share("two_matter", "of these, both of which matter", _right(both)),
        share("two_one", "two effects: at least one named", [bool(score(o).named) for o in two]),
    ]


def _and_unknown(o: Outcome) -> bool:
    return bool(score(o).named) and score(o).is_unknown


def _outside(lacking: Sequence[Outcome]) -> list[Row]:
    far = [o for o in lacking if any(matters(o, i) for i in outside(o))]
    title = "effect outside the library that matters: called unknown, and no wrong name"
    return [
        share("outside", title, [score(o).is_outside_seen for o in far], 0.85),
        share("outside_wrong", "of these: a wrong name", [score(o).n_wrong > 0 for o in far]),
    ]


def _right(outcomes: Sequence[Outcome]) -> list[bool]:
    return [bool(is_right(o)) for o in outcomes]


def _numbers(known: Sequence[Outcome]) -> list[Row]:
    """Joints and parameters of differences that were named right."""
    hits = [h for o in known for h in parameters(o)]
    widths = Estimate.of([h.half_width for h in hits], median)
    joints = Estimate.of([f for o in known for f in joints_f1(o)], mean)
    within = [h.error <= PARAMETER_ERROR for h in hits]
    return [
        estimate("joints", "joints of effects that were named, F1", joints, 0.95),
        share("parameter", "their parameters within 20 % of the truth, by joint type", within, 0.9),
        between("coverage", "their 90 % intervals hold the truth", [h.is_covered for h in hits], 0.85, 0.95),
        estimate("half_width", "half-width of these intervals", widths),
    ]


def _consequences(known: Sequence[Outcome]) -> list[Row]:
    speeds, power, falls = ([f for o in known for f in of(o)] for of in (speeds_right, power_right, falls_right))
    return [
        share("speed", "their change of top and mean speed within 0.05 m/s or 30 %", speeds, 0.85),
        share("power_change", "their change of power, where 5 % or more, within 30 %", power, 0.85),
        share("falls", "their change of the share of runs that fall, within 0.3", falls, 0.85),
    ]


def _shrinks(right: Sequence[Outcome]) -> list[Row]:
    true_s = [o.true_s for o in right if o.true_s is not None]
    off = [abs(o.true_s - s.s) for o in right if o.true_s is not None and (s := _shrink(o)) and s.s is not None]
    gaps = {gap: [o.true_gaps[gap] for o in right if gap in o.true_gaps] for gap in GAPS}
    return [
        *(
            estimate(
                f"shrink_{gap.replace(' ', '_')}",
                f"share of the gap in {gap} that the delivered model closes on new sequences, where right",
                Estimate.of(own, median),
                0.85,
            )
            for gap, own in gaps.items()
        ),
        estimate("true_s", "the same of the headline measure, S", Estimate.of(true_s, median)),
        estimate("s_off", "difference of that S from the stated one", Estimate.of(off, median)),
    ]


def _shrink(o: Outcome) -> Shrink | None:
    return o.verdict.shrink if o.verdict is not None else None


def _probabilities(outcomes: Sequence[Outcome], short: Sequence[Outcome]) -> list[Row]:
    def error(key: str, title: str, made: list[tuple[float, bool]], at_most: float = float("inf")) -> Row:
        return estimate(key, title, Estimate.of(made, calibration_error), at_most=at_most)

    judged = [(o, o.verdict) for o in outcomes if o.verdict is not None]
    sure = [was for o in short for p, was in stated_claims(o) if p >= SURE]
    clear = [(o, v) for o, v in judged if not outside(o) or any(matters(o, i) for i in outside(o))]
    return [
        error(
            "calibration",
            "expected calibration error of P(there): of stated differences, and of faults that are not stated",
            [claim for o in outcomes for claim in claims(o)],
            0.05,
        ),
        error(
            "calibration_stated",
            "the same of stated differences alone",
            [c for o in outcomes for c in stated_claims(o)],
        ),
        error("calibration_none", "the same of P(none)", [(v.probability_none, not o.truth.faults) for o, v in judged]),
        error(
            "calibration_unknown",
            "the same of P(unknown), where what is outside the library matters",
            [(v.probability_unknown, bool(outside(o))) for o, v in clear],
        ),
        share("sure", "a difference with P of 0.9 or more from one short foreign run: there", sure),
    ]


def _sprint(outcomes: Sequence[Outcome]) -> list[Row]:
    def blames(o: Outcome) -> bool:
        return any(d.names & LIMITS for d in differences(o.verdict))

    limited, others = (
        [o for o in outcomes if bool(LIMITS & {n for f in o.truth.faults for n in f.names}) == is_so]
        for is_so in (True, False)
    )
    return [
        share("power", "power or bus limit at 4 to 6 m/s: named, alone or in a group", [blames(o) for o in limited]),
        share(
            "power_blamed",
            "rotor, friction or heat there: a power or bus limit named instead",
            [blames(o) for o in others],
        ),
    ]


def breakdown(outcomes: Sequence[Outcome]) -> dict[str, dict[str, Share]]:
    """Cases of which something is asked that were judged right, by what may make them hard."""
    cuts: dict[str, Callable[[Outcome], str]] = {
        "kind": lambda o: o.case.kind,
        "runs of each sequence": lambda o: str(o.case.repeats),
        "policy": lambda o: o.case.policy,
        "missing": lambda o: ", ".join(o.case.missing) or "nothing",
        "family": lambda o: o.truth.faults[0].family if o.truth.faults else "none",
        "place": lambda o: o.case.requests[0].place if o.case.requests else "none",
        "error scale": lambda o: next(f"{a:g} to {b:g}" for a, b in SCALES if o.truth.error_scale <= b),
    }
    clear = [(o, bool(is_right(o))) for o in outcomes if is_right(o) is not None]
    return {
        name: {v: Share.of([hit for o, hit in clear if cut(o) == v]) for v in sorted({cut(o) for o, _ in clear})}
        for name, cut in cuts.items()
    }
