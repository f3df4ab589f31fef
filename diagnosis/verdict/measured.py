"""What each difference does, and the robot's calibration: in closed loop, or by prediction of logged signals.

Models with something and without it are compared, all else alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import t as student

from diagnosis.channels import Array, Channel, Ints
from diagnosis.closed_loop.consequences import Outcomes
from diagnosis.closed_loop.environment import SURROUNDING_EFFECTS
from diagnosis.closed_loop.trials import NOMINAL, Trials
from diagnosis.document import Consequences, GapCell, GapChange, GapLeft, GapName
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.scoring import Scored, Scorer, crossed, null_of, term_columns, without_effect
from diagnosis.selection.search import effects_of
from diagnosis.verdict.belief import CALIBRATED
from diagnosis.verdict.explanation import Explanation


@dataclass(frozen=True)
class Measurements:
    """Consequences of all that was found, and what is left of the gaps."""

    whole: Consequences
    """Consequences of the corrected model, against the nominal one."""
    calibration: Consequences | None
    """Consequences of the robot's own numbers, without any difference; None where that model could not be simulated."""
    each: Mapping[str, Consequences]
    """By effect, differences and kinds of ordinary numbers, of the corrected model against the same without it."""
    left: tuple[GapLeft, ...]


LESS: Final = "without "
"""How the name of the model without something begins."""
MOST_KINDS: Final = 4
"""Kinds of ordinary numbers that are taken out of the corrected model one at a time: those farthest from nominal."""
LEAST_SIZE: Final = 1.0
"""Numbers within one published spread are taken out by no model of their own."""


def compared_models(board: Evidence, best: Scored, stated: str) -> dict[str, Scored]:
    """The corrected model, named ``stated``, the same without each kind of number, and without all differences.

    ``best`` are the differences with the ordinary errors that were fitted beside them.
    """
    models = {stated: best}
    names = effects_of(best.terms)
    nothing = best
    for name in names:
        nothing = without_effect(board, nothing, name)
    models[CALIBRATED] = nothing
    for name in (*(names if len(names) > 1 else ()), *largest_kinds(board, best)):
        models.setdefault(LESS + name, without_effect(board, best, name))
    return models


def largest_kinds(board: Evidence, best: Scored) -> list[str]:
    """Effects, none of them a difference, whose ordinary numbers are farthest from the nominal ones."""
    size: dict[str, float] = {}
    for kind in board.ordinary.kinds:
        spreads = np.array([board.ordinary.scale[kind.columns(k)].max() for k in range(len(kind.chosen))])
        total = np.abs(kind.coefficients(best.pulls * board.ordinary.scale)[:, kind.chosen]) / spreads
        size[kind.effect.name] = float(total.max())
    named = {term.effect.name for term in best.terms}
    ranked = sorted((n for n in size if n not in named and size[n] > LEAST_SIZE), key=lambda n: -size[n])
    return ranked[:MOST_KINDS]


def measured_by_simulation(trials: Trials, best: Scored, stated: str, rng: np.random.Generator) -> Measurements | None:
    """In closed loop; None where the corrected model could not be simulated."""
    if stated not in trials.runs or not trials.compared:
        return None
    outcomes, each, names = Outcomes.of(trials), {}, effects_of(best.terms)
    if len(names) == 1 and CALIBRATED in trials.runs:
        each[names[0]] = outcomes.consequences(CALIBRATED, stated, rng)
    for name in trials.runs:
        if name.startswith(LESS):
            each[name.removeprefix(LESS)] = outcomes.consequences(name, stated, rng)
    # The surroundings were chosen for the corrected model: another choice would move its distance from the robot. It
    # would move the calibrated model's where what was found is itself one of the surroundings.
    doubt = trials.surroundings.doubt
    is_around = any(t.effect.name in SURROUNDING_EFFECTS for t in best.terms)
    whole, calibration = outcomes.consequences(NOMINAL, stated, rng, doubt), None
    if CALIBRATED in trials.runs:
        is_stated = stated == CALIBRATED
        calibration = outcomes.consequences(NOMINAL, CALIBRATED, rng, doubt if is_around or is_stated else 0.0)
    return Measurements(whole, calibration, each, outcomes.remainder(stated))


def measured_by_prediction(board: Evidence, best: Scored) -> Measurements:
    """In open loop: logged signals predicted from each other, in folds that nothing was fitted to."""
    best, nothing = crossed(board, best), crossed(board, null_of(board))
    changes = gap_changes(board, None, best)
    left = tuple(
        GapLeft(gap=g.gap, unit=g.unit, left=g.after, floor=g.floor, ratio=g.after / g.floor if g.floor > 0.0 else None)
        for g in changes
    )
    each = {}
    for name in effects_of(best.terms):
        # Errors refitted without it: what they can take up of it, it does not close.
        less = crossed(board, Scorer(board, [t for t in best.terms if t.effect.name != name]).now)
        each[name] = Consequences(loop="open", gaps=gap_changes(board, less, best))
    return Measurements(
        Consequences(loop="open", gaps=changes),
        Consequences(loop="open", gaps=gap_changes(board, None, nothing)),
        each,
        left,
    )


SIGNALS: Final = {Channel.SET_POINT_TO_LOAD: "load error", Channel.LOAD_TO_MOTION: "torque error of swinging legs"}
MEAN_OF_NORMAL: Final = float(np.sqrt(2.0 / np.pi))
"""Mean size of a normal variable over its standard deviation."""
STANDS_FOR: Final[Sequence[Sequence[tuple[GapName, Channel, str, str]]]] = (
    (("torque", Channel.SET_POINT_TO_LOAD, "", "N·m"),),
    (("swing-leg torque", Channel.LOAD_TO_MOTION, "", "N·m"), ("joint velocity", Channel.JOINT_RATES, "", "rad/s")),
    (
        ("body force", Channel.BASE_WRENCH, "force", "N"),
        ("body acceleration", Channel.INERTIAL_UNIT, "acceleration", "m/s²"),
        ("body velocity", Channel.STANCE_KINEMATICS, "velocity", "m/s"),
    ),
)
"""What stands for each gap without a closed loop: the first whose channel is on. Its name is that of what is predicted;
then how the names of the channel's rows begin, and their unit."""
FEW_RUNS: Final = 5
"""With fewer runs, intervals come from pieces of runs."""


def open_loop_cells(found: Explanation) -> tuple[GapCell, ...]:
    """By joint, mean size of the prediction's error against what sensors' noise alone makes; largest ratio first."""
    out = []
    for channel, signal in SIGNALS.items():
        view = found.views.get(channel)
        if view is None:
            continue
        for row in range(view.response.shape[1]):
            good = view.usable[:, row] & np.isfinite(view.response[:, row])
            if not good.any() or view.row_joint[row] < 0:
                continue
            gap = float(np.mean(np.abs(view.response[good, row])))
            floor = MEAN_OF_NORMAL * float(view.noise[row])
            out.append(
                GapCell(
                    signal=signal,
                    joint=found.board.robot.joint_names[view.row_joint[row]],
                    regime="all",
                    gap=gap,
                    floor=floor,
                    ratio=gap / floor if floor > 0.0 else None,
                    p_value=None,
                    unit=view.unit,
                    n_samples=int(good.sum()),
                )
            )
    return tuple(sorted(out, key=lambda c: -(c.ratio or 0.0)))


def gap_changes(board: Evidence, before: Scored | None, after: Scored) -> tuple[GapChange, ...]:
    """What a fit closes of the three gaps: of torque, as loads show it, of the motion of swinging legs, of the body's.

    A distance is the root mean square, over joints or axes and samples, of what is mispredicted in command sequences
    that the fit has not seen (with one sequence, in other runs; with one run, in other stretches of two seconds). The
    floor is the channel's noise, with what a rigid model and smoothed impacts leave at least. Intervals are a jackknife
    over runs, or over such stretches where there are few runs. A gap that exceeds its floor by no more than chance has
    no share.

    Args:
        board: The channels.
        before: What it is compared with; None for the nominal model as it is.
        after: The fit.

    Returns:
        Those that these logs can show.
    """
    left = [_left(board, before), _left(board, after)]
    found = []
    for stands in STANDS_FOR:
        for gap, channel, prefix, unit in stands:
            every = board.by_channel.get(channel, ())
            numbers = [n for n in every if board.views[channel].rows[board.blocks[n].row].startswith(prefix)]
            if numbers:
                found.append(_change(board, numbers, left, gap, unit))
                break
    return tuple(found)


def _change(
    board: Evidence, numbers: Sequence[int], left: Sequence[Sequence[Array]], gap: GapName, unit: str
) -> GapChange:
    blocks = [board.blocks[n] for n in numbers]
    pieces, n_pieces = _pieces(board, numbers)
    noise = np.array([b.noise for b in blocks])
    count = np.array([np.bincount(p, minlength=n_pieces) for p in pieces], dtype=np.float64)
    squares = np.array(
        [
            [
                np.bincount(p, (b.noise * side[n]) ** 2, n_pieces)
                for p, b, n in zip(pieces, blocks, numbers, strict=True)
            ]
            for side in left
        ]
    )
    floor = float(np.sqrt(np.mean(noise**2)))

    def distances(kept: Ints) -> Array:
        """Before and after, from some pieces."""
        sums, counts = squares[:, :, kept].sum(axis=2), count[:, kept].sum(axis=1)
        there = counts > 0
        return np.asarray(np.sqrt(np.mean(sums[:, there] / counts[there], axis=1)))

    def shares(pairs: Array) -> Array:
        # What is left below the floor is no gap.
        return np.asarray((pairs[:, 0] - pairs[:, 1]) / (pairs[:, 0] - np.minimum(floor, pairs[:, 1])))

    both, every = distances(np.arange(n_pieces)), np.arange(n_pieces)
    value = low = high = None
    others = np.array([distances(np.flatnonzero(every != k)) for k in range(n_pieces)]) if n_pieces > 1 else both[None]
    if both[0] - _half_width(others[:, 0]) > floor:
        value = float(shares(both[None])[0])
        width = _half_width(shares(others))
        low, high = (value - width, min(value + width, 1.0)) if n_pieces > 1 else (None, None)
    return GapChange(
        gap=gap, unit=unit, before=float(both[0]), after=float(both[1]), floor=floor, share=value, low=low, high=high
    )


def _half_width(others: Array) -> float:
    """Half of the 90 % interval of a value, by a jackknife: from the values without each piece in turn, shape (n,)."""
    n = len(others)
    if n < 2:
        return 0.0
    return float(student.ppf(0.95, n - 1) * np.sqrt((n - 1) / n * np.sum((others - others.mean()) ** 2)))


def _pieces(board: Evidence, numbers: Sequence[int]) -> tuple[list[Ints], int]:
    """By block the piece that each sample belongs to, a run or two seconds of one; and how many pieces there are."""
    keys = []
    for block in (board.blocks[n] for n in numbers):
        view = board.views[block.channel]
        run, state = view.run[block.samples], view.state[block.samples]
        keys.append((run, state // board.stretch))
    n_runs = len(np.unique(np.concatenate([run for run, _ in keys])))
    flat = [run if n_runs >= FEW_RUNS else run * 1_000_000 + block for run, block in keys]
    names, numbered = np.unique(np.concatenate(flat), return_inverse=True)
    return np.split(numbered, np.cumsum([len(f) for f in flat])[:-1]), len(names)


def _left(board: Evidence, scored: Scored | None) -> list[Array]:
    """By block what is mispredicted, in units of the noise, outliers held down; by fits that have not seen it."""
    blocks = board.blocks
    if scored is None:
        return [b.weight * b.y for b in blocks]
    ordinary = board.ordinary
    out = []
    for b, x, z, at in zip(blocks, term_columns(board, scored.terms), ordinary.x, ordinary.numbers, strict=True):
        of_terms = np.einsum("mk,mk->m", x, scored.spread[b.fold])
        of_errors = np.einsum("mq,mq->m", z, scored.fold_pulls[b.fold][:, at])
        out.append(b.weight * (b.y - of_terms - of_errors))
    return out
