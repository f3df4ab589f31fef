"""The verdict's document from what was decided and measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from diagnosis.channels import Channel
from diagnosis.closed_loop.consequences import worse_gaps
from diagnosis.closed_loop.trials import Trials
from diagnosis.decision_constants import NAMED, RUNS_APART
from diagnosis.document import Calibration, Difference, GapCell, GapChange, Status, Stretch, Verdict
from diagnosis.selection.scoring import Scorer
from diagnosis.selection.unexplained import describe
from diagnosis.verdict.advice import advice, cannot_show, split
from diagnosis.verdict.calibration import by_type, calibrated_numbers, numbers, unit_numbers
from diagnosis.verdict.causes import Causes
from diagnosis.verdict.explanation import Explanation
from diagnosis.verdict.measured import Measurements
from diagnosis.verdict.probability import is_none
from spot_model.io.model_file import RobotModel

N_WHERE = 60
"""Cells that the verdict lists; the report has them all."""
CARRIES = 1.75
"""A second whose residual is this many times the usual carries much of the gap."""
MOST = 0.5
"""More than half of a gap is most of it."""
FORCES = frozenset({Channel.SET_POINT_TO_LOAD, Channel.BASE_WRENCH, Channel.LOAD_TO_MOTION})


def status_of(causes: Causes, measured: Measurements, unknown: float, is_simulated: bool) -> Status:
    """The verdict in a word."""
    found, gaps = causes.found, measured.whole.gaps
    if not found.views.keys() & FORCES and not is_simulated:
        return "cannot_tell"
    if found.selection.best.terms:
        return "partly_explained" if unknown > NAMED or any(map(is_open, gaps)) else "explained"
    if unknown > NAMED:
        return "unknown_effect"
    return "no_gap" if gaps and all(g.before <= RUNS_APART * g.floor for g in gaps) else "calibration"


def is_open(gap: GapChange) -> bool:
    """Whether most of a gap is left, and the corrected model is not as near as repeats are."""
    return gap.after > RUNS_APART * gap.floor and (gap.share is None or gap.share < MOST)


def assemble(
    causes: Causes,
    model: RobotModel,
    measured: Measurements,
    unknown_effect: float,
    trials: Trials | None,
    cells: Sequence[GapCell],
    **known: Any,
) -> Verdict:
    """The document.

    Args:
        causes: What was decided.
        model: The nominal one.
        measured: What differences and calibration do.
        unknown_effect: Probability of something that no effect of the library is.
        trials: Closed loops; None where nothing was simulated.
        cells: Of the gap map.
        known: Fields of the verdict that are known already.
    """
    found, board = causes.found, causes.found.board
    distances = trials.distances() if trials is not None else {}
    status = status_of(causes, measured, unknown_effect, bool(distances))
    differences = tuple(_differences(causes, measured))
    unknown = None
    if status in ("unknown_effect", "partly_explained"):
        unknown = describe(board, found.stack, found.left_over, found.remainder)
    off = {str(c.name): f"off: {c.reason}" for c in found.off}
    # Channels that cannot tell say nothing for or against either.
    none, unknown_too = is_none(causes.there.values(), unknown_effect, found.n_runs), unknown_effect
    if status == "cannot_tell":
        none = unknown_too = 0.5
    return Verdict(
        status=status,
        warnings=tuple(worse_gaps(measured.whole)),
        where=tuple(c for c in cells if c.p_value is None or c.p_value <= 0.05)[:N_WHERE],
        differences=differences,
        calibration=Calibration(
            numbers=calibrated_numbers(board, causes.best, model),
            units=unit_numbers(board, causes.best, model),
            consequences=measured.calibration,
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
        **known,
    )


def _differences(causes: Causes, measured: Measurements) -> list[Difference]:
    found, belief = causes.found, causes.belief
    best, board = found.selection.best, found.board
    out: list[Difference] = []
    for i, (term, gain) in enumerate(zip(best.terms, found.selection.gains, strict=True)):
        others = best.terms[:i] + best.terms[i + 1 :]
        scorer = Scorer(board, others)
        scored = scorer.scored(term.effect, term.shape, term.place)
        baseline = scorer.now.by_block if others else np.zeros(len(board.blocks))
        by_channel = {c: round(float((scored.by_block - baseline)[n].sum()), 1) for c, n in board.by_channel.items()}
        name = term.effect.name
        group = belief.group(name) or {name: 1.0}
        names = (name, *(n for n in group if n != name))
        probability = float(np.clip(belief.there[name], 0.0, 1.0))
        out.append(
            Difference(
                name=name,
                title=term.effect.title,
                probability=probability,
                group=names,
                joints=board.robot.named(board.robot.joints_of(term.effect, term.place)),
                split_by=term.effect.split_by.text if len(names) > 1 else "",
                split=split(term.effect.split_by) if len(names) > 1 else None,
                parameters=numbers(scorer, scored),
                by_type=by_type(scorer, scored),
                rivals={n: probability * w for n, w in group.items()},
                gain_nats=float(gain),
                channels={c: v for c, v in by_channel.items() if abs(v) >= 1.0},
                consequences=measured.each.get(name),
            )
        )
    return sorted(out, key=lambda e: -e.gain_nats)


def _timeline(found: Explanation) -> list[Stretch]:
    """What was cut, and the seconds of each log that carry the most of channel *set-point to load*'s residual."""
    out: list[Stretch] = []
    period = found.stack.period_s
    for run, (recording, cut) in enumerate(zip(found.stack.recordings, found.stack.segmentations, strict=True)):
        name = recording.run_id
        out += [
            Stretch(log=name, kind=s.kind, start_s=s.first * period, end_s=(s.last + 1) * period, reason=s.reason)
            for s in cut.segments
            if s.is_cut
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
