"""The verdict's document from what was decided and measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from diagnosis.channels import Channel
from diagnosis.closed_loop.consequences import worse_gaps
from diagnosis.closed_loop.trials import Trials
from diagnosis.decision_constants import NAMED, RUNS_APART, SIGNIFICANT
from diagnosis.document import Calibration, Difference, GapCell, GapChange, Number, Status, Stretch, Verdict
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.scoring import Placed, Scored, Scorer
from diagnosis.verdict.advice import advice, cannot_show, split
from diagnosis.verdict.belief import Belief, is_none
from diagnosis.verdict.calibration import by_type, calibrated_numbers, held_sentences, parameter_numbers, unit_numbers
from diagnosis.verdict.explanation import Explanation
from diagnosis.verdict.left_over import probability
from diagnosis.verdict.measured import Measurements
from diagnosis.verdict.unknown import describe_unknown
from spot_model.io.model_file import RobotModel

N_WHERE = 60
"""Cells that the verdict lists; the report has them all."""
CARRIES = 1.75
"""A second whose residual is this many times the usual carries much of the gap."""
MOST = 0.5
"""More than half of a gap is most of it."""
FORCES = frozenset({Channel.SET_POINT_TO_LOAD, Channel.BASE_WRENCH, Channel.LOAD_TO_MOTION})


def verdict_status(belief: Belief, measured: Measurements, unknown: float, is_simulated: bool) -> Status:
    """The verdict in a word."""
    found, gaps = belief.found, measured.whole.gaps
    if not found.views.keys() & FORCES and not is_simulated:
        return "cannot_tell"
    if found.effects and all(belief.there[name] <= NAMED for name in found.effects):
        return "cannot_tell"
    if found.effects:
        return "partly_explained" if unknown > NAMED or any(map(is_open, gaps)) else "explained"
    if unknown > NAMED:
        return "unknown_effect"
    return "no_gap" if gaps and all(g.before <= RUNS_APART * g.floor for g in gaps) else "calibration"


def is_open(gap: GapChange) -> bool:
    """Whether most of a gap is left, and the corrected model is not as near as repeats are."""
    return gap.after > RUNS_APART * gap.floor and (gap.share is None or gap.share < MOST)


def assemble(
    belief: Belief,
    model: RobotModel,
    measured: Measurements,
    left_over: Mapping[str, float],
    trials: Trials | None,
    cells: Sequence[GapCell],
    **known: Any,
) -> Verdict:
    """The document.

    Args:
        belief: What was decided.
        model: The nominal one.
        measured: What differences and calibration do.
        left_over: What the corrected model leaves, by channel and by gap.
        trials: Closed loops; None where nothing was simulated.
        cells: Of the gap map.
        known: Fields of the verdict that are known already.
    """
    found, board = belief.found, belief.found.board
    distances = trials.distances() if trials is not None else {}
    unknown_effect = probability(left_over)
    status = verdict_status(belief, measured, unknown_effect, bool(distances))
    differences = tuple(_differences(belief, measured))
    unknown = None
    if status in ("unknown_effect", "partly_explained"):
        unknown = describe_unknown(board, belief.best, left_over)
    off = {str(c.name): f"off: {c.reason}" for c in found.off}
    # Channels that cannot tell say nothing for or against either.
    none, unknown_too = is_none(belief.there.values(), unknown_effect, found.n_runs), unknown_effect
    if status == "cannot_tell":
        none = unknown_too = 0.5
    named = {d.name for d in differences}
    return Verdict(
        status=status,
        warnings=tuple(worse_gaps(measured.whole)),
        where=tuple(c for c in cells if c.p_value is None or c.p_value <= SIGNIFICANT)[:N_WHERE],
        differences=differences,
        calibration=Calibration(
            numbers=calibrated_numbers(board, belief.best, model),
            units=unit_numbers(board, belief.best, model),
            consequences=measured.calibration,
            effects={name: own for name, own in measured.each.items() if name not in named},
        ),
        consequences=measured.whole,
        remainder=measured.left,
        distances=distances,
        probability_none=none,
        probability_unknown=unknown_too,
        unknown=unknown,
        channels={**{str(name): "used" for name in found.views}, **off},
        invisible=tuple(sorted(cannot_show(board))),
        log_advice=advice(found.stack, found.views, found.off, differences, unknown),
        timeline=tuple(_timeline(found)),
        held=held_sentences(board, belief.best),
        **known,
    )


def _differences(belief: Belief, measured: Measurements) -> list[Difference]:
    best, board = belief.best, belief.found.board
    out: list[Difference] = []
    for name, gain in belief.found.selection.gains.items():
        # The first term of an effect is its strongest; where others of it have their own numbers, each is told.
        mine = [t for t in best.terms if t.effect.name == name]
        others = [t for t in best.terms if t is not mine[0]]
        term, scorer = mine[0], Scorer(board, others)
        scored = scorer.scored(term.effect, term.shape, term.place)
        group, there = belief.groups[name], belief.there[name]
        place = np.max([t.place for t in mine], axis=0)
        out.append(
            Difference(
                name=name,
                title=term.effect.title,
                probability=there,
                group=tuple(group),
                joints=board.robot.named(board.robot.joints_of(term.effect, place)),
                split_by=term.effect.split_by.text if len(group) > 1 else "",
                split=split(term.effect.split_by) if len(group) > 1 else None,
                parameters=parameter_numbers(scorer, scored),
                by_type=by_type(scorer, scored) if len(mine) == 1 else _by_place(board, best, mine),
                rivals={n: there * w for n, w in group.items()},
                gain_nats=float(gain),
                channels={c: round(v, 1) for c, v in belief.found.selection.channels[name].items() if abs(v) >= 1.0},
                consequences=measured.each.get(name),
            )
        )
    return sorted(out, key=lambda d: (-_closed(d), -d.gain_nats))


def _closed(difference: Difference) -> float:
    """The largest share of a gap that opens again without it."""
    gaps = difference.consequences.gaps if difference.consequences is not None else ()
    return max((g.share for g in gaps if g.share is not None), default=0.0)


def _by_place(board: Evidence, best: Scored, mine: Sequence[Placed]) -> dict[str, dict[str, Number]]:
    """Numbers of each term of one effect, by the joints in words."""
    out = {}
    for term in mine:
        scorer = Scorer(board, [t for t in best.terms if t is not term])
        where = " ".join(board.robot.words_for(term.effect, term.place))
        out[where] = parameter_numbers(scorer, scorer.scored(term.effect, term.shape, term.place))
    return out


def _timeline(found: Explanation) -> list[Stretch]:
    """What was cut, and the seconds of each log that carry the most of channel *set-point to load*'s residual."""
    out: list[Stretch] = []
    period = found.stack.period_s
    for run, (recording, cut) in enumerate(zip(found.stack.recordings, found.stack.segmentations, strict=True)):
        name = recording.run_id
        out += [
            Stretch(log=name, kind=s.kind, start_s=s.first * period, end_s=(s.last + 1) * period, reason=s.reason)
            for s in cut.segments
        ]
        view = found.views.get(Channel.SET_POINT_TO_LOAD)
        if view is None:
            continue
        mine = view.of_run(run)
        size = np.where(view.usable, (view.response / view.noise) ** 2, 0.0).mean(axis=1)[mine]
        second = (view.state[mine] * period).astype(np.intp)
        energy = np.bincount(second, size)
        typical = float(np.median(energy[energy > 0])) if (energy > 0).any() else 0.0
        times = np.sqrt(energy / typical) if typical > 0.0 else np.zeros(0)
        out += [
            Stretch(
                log=name,
                kind="gap",
                start_s=float(at),
                end_s=float(at + 1),
                reason=f"the load's error is {times[at]:.1f} times its usual size",
            )
            for at in np.flatnonzero(times > CARRIES)
        ]
    return out
