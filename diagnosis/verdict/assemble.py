"""The verdict's document from what was decided."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from diagnosis.channels.channel import Channel
from diagnosis.closed_loop.gap_map import GapMap
from diagnosis.closed_loop.trials import NOMINAL
from diagnosis.decision_constants import CLOSES_SOME, PARTLY, UNKNOWN_IS_LIKELY
from diagnosis.document import FoundEffect, SeenEffect, Shrink, Status, Stretch, Verdict
from diagnosis.library.registry import LIBRARY
from diagnosis.selection.fitted import numbers
from diagnosis.selection.scoring import Scorer
from diagnosis.selection.unexplained import describe
from diagnosis.verdict.advice import advice, split
from diagnosis.verdict.causes import Causes
from diagnosis.verdict.explain import Explained
from diagnosis.verdict.open_loop import load_error_share, open_loop_cells
from spot_log.read.run import Run

N_WHERE = 60
"""Cells that the verdict lists; the report has them all."""
CARRIES = 1.75
"""A second whose residual is this many times the usual carries much of the gap."""
PLAIN_SHARE = 0.3
"""A load's error of this share of the load, root mean square, is plain to see."""
PLAIN = (
    "loads differ from the servo law by {share:.0f} % of their size at half of the joints, in no way that repeats: "
    "these logs cannot tell why; record longer ones, each command sequence several times"
)
WIDENS = (
    "closed loops with the stated effects are farther from the robot ({after:.1f} floors) than without ({before:.1f}); "
    "do not train on this model"
)
CLOSES_MOST = 0.5
"""What explains a gap closes this share of it at least."""
CLOSES_LITTLE = "the stated effects close {share:.0f} % of the gap{where}; something else makes the rest"
WIDER = 0.5
"""Floors by which closed loops must be farther off with a model than without, to say so."""


def status_of(causes: Causes) -> Status:
    """The verdict in a word."""
    found, belief = causes.found, causes.belief
    has_forces = found.views.keys() & {Channel.SET_POINT_TO_LOAD, Channel.BASE_WRENCH, Channel.LOAD_TO_MOTION}
    if not has_forces and not causes.distances:
        return "cannot_tell"
    if belief.unknown > UNKNOWN_IS_LIKELY and _closed(causes) < CLOSES_SOME:
        return "unknown_effect"
    if found.selection.best is None:
        # Without a gap there is nothing to explain; with one, nothing explains it.
        return "no_gap" if belief.none >= belief.unknown else "unknown_effect"
    return "partly_explained" if belief.unknown > PARTLY else "explained"


def _closed(causes: Causes) -> float:
    """Share of the gap that the stated causes close; without any, or without closed loops, none."""
    before, after = causes.distances.get(NOMINAL, 0.0), causes.left
    if causes.found.selection.best is None or after is None or before <= 1.0:
        return 0.0
    return (before - after) / (before - 1.0)


def assemble(
    causes: Causes,
    map_: GapMap | None,
    shrink: Shrink | None,
    notes: Sequence[str],
    runs: Sequence[Run],
    nominal_name: str,
) -> Verdict:
    """The document.

    Args:
        causes: What was decided.
        map_: Of closed loops; without it the map is that of open-loop prediction.
        shrink: Of the stated model.
        notes: Sentences for the reader.
        runs: The logs.
        nominal_name: As it was asked for.
    """
    found, belief = causes.found, causes.belief
    status, told = _sanity(status_of(causes), found, shrink)
    effects = tuple(_effects(causes)) if status not in ("no_gap", "cannot_tell") else ()
    unknown = None
    if status in ("unknown_effect", "partly_explained"):
        unknown = describe(found.board, found.stack, found.left_over(), found.remainder())
    off = {str(c.name): f"off: {c.reason}" for c in found.off}
    cells = map_.cells if map_ is not None else open_loop_cells(found)
    # Channels that cannot tell say nothing for or against either.
    none, unknown_too = (0.5, 0.5) if status == "cannot_tell" else (belief.none, belief.unknown)
    return Verdict(
        status=status,
        where=tuple(c for c in cells if c.p_value is None or c.p_value <= 0.05)[:N_WHERE],
        effects=effects,
        seen=tuple(_seen(causes)),
        distances=dict(causes.distances),
        probability_none=none,
        probability_unknown=unknown_too,
        unknown=unknown,
        channels={**{str(name): "used" for name in found.views}, **off},
        invisible=tuple(sorted(n for n, e in LIBRARY.items() if not e.show(found.board.views))),
        shrink=shrink if effects else None,
        log_advice=advice(found.stack, found.views, found.off, effects, unknown),
        timeline=tuple(_timeline(found)),
        logs=tuple(str(run.path) for run in runs),
        nominal=nominal_name,
        notes=tuple(dict.fromkeys([*([told] if told else []), *notes])),
    )


def _sanity(status: Status, found: Explained, shrink: Shrink | None) -> tuple[Status, str]:
    """Plain errors of the loads are no "no gap"; what widens the gap, or closes little of it, does not explain it."""
    share = load_error_share(found.views)
    if status == "no_gap" and share > PLAIN_SHARE:
        return "cannot_tell", PLAIN.format(share=100.0 * share)
    if status == "explained" and shrink is not None and shrink.floor > 0.0:
        before, after = shrink.d0 / shrink.floor, shrink.d1 / shrink.floor
        if after > before + WIDER:
            return "partly_explained", WIDENS.format(before=before, after=after)
        if shrink.s is not None and shrink.s < CLOSES_MOST:
            return "partly_explained", CLOSES_LITTLE.format(
                share=100.0 * max(shrink.s, 0.0),
                where=" on sequences to which their sizes were not fitted" if shrink.held_out else "",
            )
    return status, ""


def _effects(causes: Causes) -> list[FoundEffect]:
    found, belief = causes.found, causes.belief
    best, board = found.selection.best, found.board
    out: list[FoundEffect] = []
    if best is None:
        return out
    for i, (term, gain) in enumerate(zip(best.terms, found.selection.gains, strict=True)):
        others = best.terms[:i] + best.terms[i + 1 :]
        scorer = Scorer(board, others)
        scored = scorer.scored(term.effect, term.shape, term.place)
        baseline = scorer.now.by_block if others else np.zeros(len(board.blocks))
        by_channel = {c: round(float((scored.by_block - baseline)[n].sum()), 1) for c, n in board.by_channel.items()}
        group = belief.group(term.effect.name) or {term.effect.name: 1.0}
        names = (term.effect.name, *(n for n in group if n != term.effect.name))
        probability = float(np.clip(belief.effects.get(term.effect.name, 0.0), 0.0, 1.0))
        out.append(
            FoundEffect(
                name=term.effect.name,
                title=term.effect.title,
                probability=probability,
                group=names,
                joints=board.robot.named(board.robot.joints_of(term.effect, term.place)),
                split_by=term.effect.split_by.text if len(names) > 1 else "",
                split=split(term.effect.split_by) if len(names) > 1 else None,
                parameters=numbers(scorer, scored),
                rivals={n: probability * w for n, w in group.items()},
                gain_nats=float(gain),
                nearer_floors=finite(belief.nearer.get(term.effect.name)),
                moved_floors=finite(causes.moved.get(term.effect.name)),
                channels={c: v for c, v in by_channel.items() if abs(v) >= 1.0},
            )
        )
    return sorted(out, key=lambda e: -e.gain_nats)


def finite(floors: float | None) -> float | None:
    """None also where the set without the effect was not simulated: its distance is infinite then."""
    return floors if floors is not None and np.isfinite(floors) else None


def _seen(causes: Causes) -> list[SeenEffect]:
    board = causes.found.board
    out = []
    for seen in causes.seen:
        others = tuple(t for t in seen.scored.terms if t is not seen.term)
        scorer = Scorer(board, others)
        scored = scorer.scored(seen.term.effect, seen.term.shape, seen.term.place)
        out.append(
            SeenEffect(
                name=seen.term.effect.name,
                title=seen.term.effect.title,
                joints=board.robot.named(board.robot.joints_of(seen.term.effect, seen.term.place)),
                parameters=numbers(scorer, scored),
                moved_floors=finite(seen.moved),
            )
        )
    return out


def _timeline(found: Explained) -> list[Stretch]:
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
