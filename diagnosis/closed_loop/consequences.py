"""What something does to simulated runs: how near they come to the robot's, and what a person asks of them.

Runs without it and with it start alike and are told the same. All simulated runs of a sequence are compared with all of
the robot's, and these with each other, each pair up to the earlier end: for the true model the distance is that of the
repeats. A gap counts from its floor: the distance of the repeats, or what nobody would call a gap if that is larger.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Final

import numpy as np

from diagnosis.channels import Array, Ints
from diagnosis.closed_loop.run_numbers import (
    QUANTITIES,
    Quantity,
    WalkTime,
    known_mean,
    restricted_mean_s,
    run_numbers,
    time_to_fall,
)
from diagnosis.closed_loop.shrink import (
    QUANTILES,
    Cuts,
    SequenceDistances,
    interval,
    mean_distance,
    mean_floor,
    mean_repeats,
    pair_distances,
    resamples,
    sequence_name,
    shrinkage,
)
from diagnosis.closed_loop.trials import Trials
from diagnosis.decision_constants import MIN_GAP, PRACTICAL
from diagnosis.document import Consequences, GapChange, GapLeft, GapName, QuantityChange
from spot_log.read.run import Run
from spot_model.robot.rotation import rotate_inverse_wxyz
from trainer.signals.policy_ticks import MIN_TICKS, policy_ticks

FALLS: Final = Quantity("fall_share", "share of runs that fall", "")
FALL_TIME: Final = Quantity("time_to_fall", "mean time to a fall, within the commands", "s")
LARGEST: Final = frozenset({"top_speed"})
"""Quantities of which that of the sequence with the largest counts; of the others the mean over sequences."""


@dataclass(frozen=True)
class Gap:
    """One of the three gaps."""

    name: GapName
    unit: str
    pick: Callable[[Run], Array]
    """Its signal, a row a state."""


def _body_velocity(run: Run) -> Array:
    s = run.states
    return np.asarray(rotate_inverse_wxyz(s.odom_from_body_wxyz, s.linear_vel_of_body_in_odom_m_s))


GAPS: Final = (
    Gap("torque", "N·m", lambda run: run.states.load_nm),
    Gap("joint motion", "rad/s", lambda run: run.states.velocity_rad_s),
    Gap("body motion", "m/s", _body_velocity),
)

Came = Sequence[tuple[list[float], WalkTime]]
"""What each run of one sequence came to: :data:`QUANTITIES`, and how long it lasted."""
ROBOT: Final = ""
"""The robot's name among those of the models."""


@dataclass(frozen=True)
class Outcomes:
    """What the runs of all models and of the robot come to, and how far each model is from the robot."""

    gaps: Mapping[Gap, Sequence[SequenceDistances]]
    """By gap and by sequence, in the gap's unit; a distance is NaN where a log lacks the signal."""
    scatter: Mapping[Gap, Sequence[Mapping[str, float]]]
    """Likewise, the mean distance of each model's runs from each other; of sequences that the robot did not repeat."""
    came: Mapping[str, Sequence[Came]]
    """By model and sequence; the robot is :data:`ROBOT`."""
    length_s: Sequence[float]
    """Of each sequence's commands."""

    @staticmethod
    def of(trials: Trials) -> Outcomes:
        """Compare all models of the trials with the robot.

        What is nothing to anybody is a share of the spread of the robot's signal, standard deviations over a run,
        averaged over the components and the runs.
        """
        real, models = _by_sequence(trials.bench.runs), {name: _by_sequence(own) for name, own in trials.runs.items()}
        sequences = list(next(iter(models.values())))
        gaps: dict[Gap, list[SequenceDistances]] = {gap: [] for gap in GAPS}
        scatter: dict[Gap, list[dict[str, float]]] = {gap: [] for gap in GAPS}
        for sequence in sequences:
            own = _cuts([run for run in real[sequence] if len(policy_ticks(run)) >= MIN_TICKS])
            made = {name: _cuts(runs[sequence], MIN_TICKS) for name, runs in models.items()}
            pairs = pair_distances(own, own, _apart)
            apart = {name: pair_distances(cuts, own, _apart) for name, cuts in made.items()}
            alone = {name: _mean_apart(cuts) for name, cuts in made.items()} if len(pairs) < 2 else {}
            least = PRACTICAL * np.mean([_spread(own.to(i, n)) for i, n in enumerate(own.lengths)], axis=0)
            for k, gap in enumerate(GAPS):
                of_models = {name: distances[..., k] for name, distances in apart.items()}
                gaps[gap].append(SequenceDistances(sequence, pairs[..., k], of_models, least=float(least[k])))
                scatter[gap].append({name: float(own[k]) for name, own in alone.items()})
        came = {name: [_came(runs[s]) for s in sequences] for name, runs in {ROBOT: real, **models}.items()}
        length_s = {s.sequence: len(s.velocity_command) * s.tick_period_s for s in trials.bench.scripts}
        return Outcomes(gaps, scatter, came, [length_s[s] for s in sequences])

    def consequences(self, before: str, after: str, rng: np.random.Generator, doubt: float = 0.0) -> Consequences:
        """What the model named ``after`` has beyond the one named ``before`` does.

        ``doubt`` is a standard error of the distance after, in floors: other surroundings might have been chosen.
        """
        gaps = []
        for gap, compared in self._compared(before, after):
            d0, d1, floor, s, low, high = shrinkage(compared, before, after, rng, doubt * mean_repeats(compared))
            repeats, share = _known_repeats(compared), {"share": s, "low": low, "high": high}
            gaps.append(
                GapChange(gap=gap.name, unit=gap.unit, before=d0, after=d1, floor=floor, repeats=repeats, **share)
            )
        return Consequences(loop="closed", gaps=tuple(gaps), changes=self._changes(before, after, rng))

    def remainder(self, after: str) -> tuple[GapLeft, ...]:
        """What a model leaves of each gap."""
        out = []
        for gap, compared in self._compared(after):
            left, floor = mean_distance(compared, after), mean_floor(compared)
            ratio = left / floor if floor > 0.0 else None
            repeats = _known_repeats(compared)
            out.append(GapLeft(gap=gap.name, unit=gap.unit, left=left, floor=floor, ratio=ratio, repeats=repeats))
        return tuple(out)

    def _compared(self, *models: str) -> list[tuple[Gap, list[SequenceDistances]]]:
        """Distances of some models by gap, without gaps whose signal a log lacks.

        The scatter of the last model is the floor of a robot that did not repeat itself.
        """
        out = []
        for gap, every in self.gaps.items():
            found = [
                replace(c, models={m: c.models[m] for m in models}, floor=alone.get(models[-1], 1.0))
                for c, alone in zip(every, self.scatter[gap], strict=True)
            ]
            if all(np.isfinite(d).all() for c in found for d in (c.real, *c.models.values())):
                out.append((gap, [c for c in found if len(c.real) > 1] or found))
        return out

    def _changes(self, before: str, after: str, rng: np.random.Generator) -> tuple[QuantityChange, ...]:
        sides = [self.came[name] for name in (ROBOT, before, after)]
        once = np.arange(len(self.length_s))[None]
        values = [
            _summary(side, self.length_s, once, [np.ones((*once.shape, len(came)), dtype=np.int64) for came in side])[0]
            for side in sides
        ]
        sizes = [(len(b), len(a)) for b, a in zip(*sides[1:], strict=True)]
        chosen, counts = resamples(sizes, rng)
        # Row i of both starts alike.
        first, second = (_summary(side, self.length_s, chosen, [own for _, own in counts]) for side in sides[1:])
        draws, out = second - first, []
        falls = any(one.has_fallen for side in sides for came in side for _, one in came)
        for k, q in enumerate((*QUANTITIES, FALLS, *([FALL_TIME] if falls else []))):
            own, without, with_it = (float(v[k]) if np.isfinite(v[k]) else None for v in values)
            known = draws[np.isfinite(draws[:, k]), k]
            low, high = None, None
            if without is not None and with_it is not None and len(known):
                low, high = interval(with_it - without, known, [n for _, n in sizes])
                if q is FALLS:
                    low, high = max(low, -without), min(high, 1.0 - without)
            change = {"before": without, "after": with_it, "robot": own, "low": low, "high": high}
            out.append(QuantityChange(quantity=q.name, title=q.title, unit=q.unit, **change))
        return tuple(out)


def _known_repeats(compared: Sequence[SequenceDistances]) -> float | None:
    return mean_repeats(compared) if len(compared[0].real) > 1 else None


def worse_gaps(whole: Consequences) -> list[str]:
    """Where the corrected model is farther from the robot than the nominal one, a sentence each."""
    out = [
        f"the corrected model is farther from the robot than the nominal one in {g.gap}: {g.after:.2g} instead of "
        f"{g.before:.2g} {g.unit}"
        for g in whole.gaps
        if g.after - max(g.before, g.floor) > MIN_GAP * g.floor
    ]
    for c in whole.changes:
        if c.quantity != FALLS.name or c.before is None or c.after is None or c.robot is None:
            continue
        if abs(c.after - c.robot) > abs(c.before - c.robot):
            out.append(
                f"the corrected model falls in {c.after:.0%} of its runs, the nominal one in {c.before:.0%}, the robot "
                f"in {c.robot:.0%}"
            )
    return out


def _by_sequence(runs: Sequence[Run]) -> dict[str, list[Run]]:
    out: dict[str, list[Run]] = {}
    for run in runs:
        out.setdefault(sequence_name(run), []).append(run)
    return out


def _cuts(runs: Sequence[Run], at_least: int = 0) -> Cuts:
    """Quantiles of each gap's components, of each run up to each tick, shape (Q, k)."""
    ticks_ns = [run.ticks.robot_stamp_ns[policy_ticks(run, at_least)] for run in runs]
    signals = [[gap.pick(run) for gap in GAPS] for run in runs]

    @cache
    def digest(i: int, n: int) -> list[Array]:
        first, last = np.searchsorted(runs[i].states.robot_stamp_ns, [ticks_ns[i][0], ticks_ns[i][n - 1] + 1])
        rows = (QUANTILES * (last - first)).astype(np.intp)
        return [np.asarray(np.sort(signal[first:last], axis=0)[rows]) for signal in signals[i]]

    return Cuts([len(t) for t in ticks_ns], digest)


def _mean_apart(cuts: Cuts) -> Array:
    """Mean distance of runs from each other, by gap."""
    scatter = pair_distances(cuts, cuts, _apart)
    return np.asarray(scatter.sum(axis=(0, 1)) / max(1, len(scatter) * (len(scatter) - 1)))


def _spread(quantiles: list[Array]) -> list[float]:
    """Standard deviation of each gap's signal, mean over its components."""
    return [float(np.mean(np.std(q, axis=0))) for q in quantiles]


def _apart(first: list[Array], second: list[Array]) -> list[float]:
    """Wasserstein distance of each gap, mean over its components."""
    return [float(np.mean(np.abs(a - b))) for a, b in zip(first, second, strict=True)]


def _came(runs: Sequence[Run]) -> Came:
    found = [(run_numbers(run), lasted) for run in runs if (lasted := time_to_fall(run)) is not None]
    return [([numbers[q.name] for q in QUANTITIES], lasted) for numbers, lasted in found]


def _summary(sequences: Sequence[Came], lengths_s: Sequence[float], chosen: Ints, counts: Sequence[Ints]) -> Array:
    """:data:`QUANTITIES`, the share of falls and the time to a fall, over the sequences of each of N draws.

    ``chosen`` and ``counts`` are as :func:`resamples` has them; shape (N, number of quantities + 2), NaN where no run
    gives one.
    """
    found = np.full((*chosen.shape, len(QUANTITIES) + 2), np.nan)
    for i, (came, length_s, drawn) in enumerate(zip(sequences, lengths_s, counts, strict=True)):
        numbers, lasted = np.array([own for own, _ in came]).reshape(-1, len(QUANTITIES)), [one for _, one in came]
        known, mine = np.isfinite(numbers), chosen == i
        n = drawn[mine] @ known
        mean = np.where(n > 0, drawn[mine] @ np.where(known, numbers, 0.0) / np.maximum(n, 1), np.nan)
        share = drawn[mine] @ [float(one.has_fallen) for one in lasted] / len(lasted)
        found[mine] = np.column_stack([mean, share, restricted_mean_s(lasted, length_s, drawn[mine])])
    values = known_mean(np.moveaxis(found, 1, 0))
    top = np.max(np.nan_to_num(found, nan=-np.inf), axis=1)
    return np.where(np.isfinite(top) & [q.name in LARGEST for q in (*QUANTITIES, FALLS, FALL_TIME)], top, values)
