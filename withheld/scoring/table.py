"""The scored table: every figure that is asked of the diagnosis, with its interval."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from withheld.outcome import Outcome
from withheld.plan import Fault
from withheld.scoring.rows import Row, between, estimate, share
from withheld.scoring.scores import causes, claims, f1, is_right, located, parameters, score, true_joints
from withheld.scoring.sizes import Size, is_outside, sizes
from withheld.scoring.statistics import Estimate, Share, calibration_error, mean, median
from withheld.verdict import Shrink

PARAMETER_ERROR: Final = 0.20
SURE: Final = 0.9
SCALES: Final = ((0.5, 1.0), (1.0, 2.0), (2.0, 4.0), (4.0, 5.0))
ASKED_SCALES: Final = (1.0, 4.0)


def table(outcomes: Sequence[Outcome]) -> list[Row]:
    """All rows."""
    long = [o for o in outcomes if o.case.detail == "stream"]
    short = [o for o in outcomes if o.case.detail == "import"]
    return [
        *_faultless(long),
        *_named(long),
        *_quality([o for o in long if o.truth.faults and not is_outside(o) and is_right(o)]),
        *_probabilities(outcomes, short),
        *_sprint([o for o in outcomes if o.case.kind == "sprint"]),
        *_rounds(outcomes),
        share("failed", "ended without a verdict", [o.verdict is None for o in outcomes]),
    ]


def _faultless(outcomes: Sequence[Outcome]) -> list[Row]:
    none = [o for o in outcomes if not o.truth.faults]

    def silent(low: float, high: float) -> list[bool]:
        return [score(o).is_silent for o in none if low <= o.truth.error_scale <= high]

    rows = [
        share(
            "faultless", "no fault, ordinary errors 1 to 4 times the usual: nothing named", silent(*ASKED_SCALES), 0.95
        )
    ]
    rows += [
        share(f"faultless_{low:g}", f"of these, errors {low:g} to {high:g} times the usual", silent(low, high))
        for low, high in SCALES
    ]
    gaps = [s.d0 / s.floor for o in none if o.case.repeats > 1 and (s := _shrink(o)) and s.floor > 0.0]
    rows.append(estimate("faultless_gap", "no fault: gap of the nominal model, in floors", Estimate.of(gaps, median)))
    called = [o.status == "no_gap" for o in none]
    return [*rows, share("no_gap", "no fault: called no gap", called)]


def _named(outcomes: Sequence[Outcome]) -> list[Row]:
    inside = [o for o in outcomes if o.truth.faults and not is_outside(o)]
    one = [o for o in inside if sizes(o) == (Size.LARGE,)]
    two = [o for o in inside if sizes(o) == (Size.LARGE, Size.LARGE)]
    mixed = [o for o in inside if len(sizes(o)) == 2 and set(sizes(o)) == {Size.LARGE, Size.SMALL}]
    far = [o for o in outcomes if is_outside(o) and Size.LARGE in sizes(o)]
    small = [o for o in outcomes if o.truth.faults and set(sizes(o)) == {Size.SMALL}]
    grey = [o for o in outcomes if Size.BETWEEN in sizes(o)]
    placed = [o for o in inside if Size.LARGE in sizes(o) and true_joints(o.truth.faults)]
    return [
        share("one", "one effect that moves the gap by twice its floor: named, and nothing else", _right(one), 0.90),
        share("one_named", "of these: named, whatever else is", [bool(score(o).named) for o in one]),
        share("one_silent", "of these: nothing named", [score(o).is_silent for o in one]),
        share("two", "two such effects: both named, and nothing else", _right(two), 0.85),
        share("two_one", "of these: at least one named", [bool(score(o).named) for o in two]),
        share("mixed", "one such effect and one that does not matter: the first named, nothing wrong", _right(mixed)),
        estimate(
            "joints", "joints, F1", Estimate.of([f1(located(o), true_joints(_felt(o))) for o in placed], mean), 0.95
        ),
        share("outside", "effect outside the library that moves the gap so: called unknown", _right(far), 0.85),
        share("small", "effect that does not matter to the gap: nothing named", _right(small)),
        share("between", "effect in between: nothing wrong named", [score(o).is_clean for o in grey]),
    ]


def _felt(o: Outcome) -> list[Fault]:
    """Faults that matter, or may."""
    return [f for f, size in zip(o.truth.faults, sizes(o), strict=True) if size is not Size.SMALL]


def _right(outcomes: Sequence[Outcome]) -> list[bool]:
    return [bool(is_right(o)) for o in outcomes]


def _quality(right: Sequence[Outcome]) -> list[Row]:
    hits = [h for o in right for h in parameters(o)]
    true_s = [o.true_s for o in right if o.true_s is not None]
    off = [abs(o.true_s - s.s) for o in right if o.true_s is not None and (s := _shrink(o)) and s.s is not None]
    return [
        estimate("true_s", "S of the delivered model on new sequences, where right", Estimate.of(true_s, median), 0.85),
        estimate("s_off", "difference of that S from the stated one", Estimate.of(off, median)),
        share("parameter", "parameters of a right effect within 20 %", [h.error <= PARAMETER_ERROR for h in hits], 0.9),
        between("coverage", "their 90 % intervals hold the truth", [h.is_covered for h in hits], 0.85, 0.95),
        estimate(
            "half_width",
            "half-width of these intervals",
            Estimate.of([h.half_width for h in hits], median),
            at_most=0.2,
        ),
    ]


def _shrink(o: Outcome) -> Shrink | None:
    return o.verdict.shrink if o.verdict is not None else None


def _probabilities(outcomes: Sequence[Outcome], short: Sequence[Outcome]) -> list[Row]:
    stated = [claim for o in outcomes for claim in claims(o)]
    sure = [
        any(cause.names & set(f.names) for f in o.truth.faults)
        for o in short
        for cause in causes(o.verdict)
        if cause.probability >= SURE
    ]
    return [
        estimate(
            "calibration",
            "expected calibration error of stated probabilities",
            Estimate.of(stated, calibration_error),
            at_most=0.05,
        ),
        share("sure", "a cause with P of 0.9 or more from one short foreign run: right", sure, 0.9),
        share(
            "sure_any",
            "short foreign runs from which such a cause is stated",
            [any(c.probability >= SURE for c in causes(o.verdict)) for o in short],
        ),
    ]


def _sprint(outcomes: Sequence[Outcome]) -> list[Row]:
    limits = {"power_limit", "bus_sag"}

    def blames(o: Outcome) -> bool:
        return any(c.names & limits for c in causes(o.verdict))

    def is_limited(o: Outcome) -> bool:
        return any(limits & set(f.names) for f in o.truth.faults)

    large = [o for o in outcomes if Size.LARGE in sizes(o)]
    return [
        share(
            "power",
            "power or bus limit at 4 to 6 m/s that moves the gap: named, alone or in a group",
            [blames(o) for o in large if is_limited(o)],
        ),
        share(
            "power_blamed",
            "rotor, friction or heat there: a power or bus limit named instead",
            [blames(o) for o in outcomes if not is_limited(o)],
        ),
    ]


def _rounds(outcomes: Sequence[Outcome]) -> list[Row]:
    """After each number of experiments; nothing where no case has any."""
    rows: list[Row] = []
    for number in range(1, max((len(o.rounds) for o in outcomes), default=1)):
        asked = [o for o in outcomes if len(o.rounds) > number and is_right(o, number) is not None]
        rows.append(
            share(f"round_{number}", f"after {number} experiments: right", [bool(is_right(o, number)) for o in asked])
        )
        seconds = Estimate.of([o.rounds[number].robot_s for o in asked], mean)
        rows.append(estimate(f"round_{number}_s", "of these: robot time, s", seconds))
    return rows


def breakdown(outcomes: Sequence[Outcome]) -> dict[str, dict[str, Share]]:
    """Cases with a clear truth that were judged right, by what may make them hard."""
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
