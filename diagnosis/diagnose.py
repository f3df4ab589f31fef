"""From logs and the nominal model to a verdict: where the gap lies, which effect causes it, how far it shrinks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.advice import advice, split
from diagnosis.channels.build import build_views
from diagnosis.channels.stack import Stack, stack
from diagnosis.engine import Engine, LocalEngine
from diagnosis.fitted import corrected_model, numbers
from diagnosis.library.base import LibraryEffect
from diagnosis.library.registry import LIBRARY
from diagnosis.logs import script_of
from diagnosis.measure import Bench, Measured, decided, measure, simulate_all
from diagnosis.members import Member, after_members, with_member
from diagnosis.posterior import Calibration, Posterior, after_shrink, posterior
from diagnosis.progress import Progress
from diagnosis.recording import record
from diagnosis.seam import Array, ChannelOff, ChannelView, Ints, Views
from diagnosis.selection.board import Board, lay_out
from diagnosis.selection.places import Robot
from diagnosis.selection.scoring import Scored, Scorer
from diagnosis.selection.search import Selection, search, selection_of
from diagnosis.sober import sober
from diagnosis.surroundings import SURROUNDING_EFFECTS
from diagnosis.unknown import Remainder, describe, remainder
from diagnosis.verdict import FoundEffect, Status, Stretch, Verdict
from diagnosis.where import GapMap, Side, gap_map
from spot_log.read.run import Run
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy
from spot_model.robot import facts

Say = Callable[[str], None]
ORDINARY_AT_MOST = 2.5
"""What is left may be put down to ordinary errors of so many usual sizes, and no more."""
N_WHERE = 60
"""Cells that the verdict lists; the report has them all."""
WITHOUT_RUNS = "without the policy that ran on Spot nothing can be simulated: no gap map and no shrink"
UNKNOWN_IS_LIKELY = 0.5
NONE_IS_LIKELY = 0.5
CARRIES = 1.75
"""A second whose residual is this many times the usual carries much of the gap."""
PARTLY = 0.3
"""With this probability of an unknown effect beside those found, they are called a part of the explanation."""


@dataclass(frozen=True)
class Diagnosis:
    """A verdict and what the report needs beside it."""

    verdict: Verdict
    corrected: RobotModel
    map: GapMap | None
    measured: Measured | None
    runs: tuple[Run, ...]
    board: Board


@dataclass(frozen=True)
class Explained:
    """What the residual channels say, without any simulation."""

    stack: Stack
    views: Mapping[str, ChannelView]
    off: tuple[ChannelOff, ...]
    board: Board
    selection: Selection
    left: Remainder
    posterior: Posterior


def explain(
    runs: Sequence[Run], nominal: RobotModel, policy: Policy | None, library: Mapping[str, LibraryEffect],
    calibration: Calibration, say: Say, limits_rad: tuple[Array, Array] | None = None,
) -> Explained:  # fmt: skip
    """Channels, selection, remainder and probabilities.

    Raises:
        BadInputError: The logs feed no channel at all.
    """
    logs = stack([record(run) for run in runs])
    views, off = build_views(logs, nominal, policy=policy, limits_rad=limits_rad)
    if not views:
        told = "; ".join(f"{c.name}: {c.reason}" for c in off)
        raise BadInputError(f"these logs feed no channel ({told}); map joint velocities, loads or set-points as well")
    robot = Robot(logs.recordings[0].joint_names, _legs(views))
    names = sorted({r.sequence for r in logs.recordings})
    by_run = len(names) < 2
    folds = list(range(len(runs))) if by_run else [names.index(r.sequence) for r in logs.recordings]
    fold_names = [r.run_id for r in logs.recordings] if by_run else names
    board = lay_out(
        views, robot, folds, fold_names, calibration.tolerance,
        library={**LIBRARY, **library}, sizes=calibration.ordinary, dof=calibration.dof, relative=calibration.relative,
    )  # fmt: skip
    say(f"trying {len(library)} effects on {len(board.blocks)} signals of {len(views)} channels")
    selection = search(board, library, calibration.threshold_nats, say)
    left = _remainder(board, logs, selection)
    return Explained(logs, views, off, board, selection, left, posterior(selection, left, calibration))


def _remainder(board: Board, logs: Stack, selection: Selection) -> Remainder:
    explained = selection.best.explained if selection.best is not None else np.zeros(len(board.blocks))
    gained = selection.best.score if selection.best is not None else 0.0
    return remainder(board, logs, _left_over(board, selection), explained, gained)


def _legs(views: Views) -> Ints:
    """Leg of each joint, from a channel that knows: those without a body model do not."""
    every = [view.leg_of_joint for view in views.values()]
    return next((legs for legs in every if legs.max(initial=-1) >= 0), every[0])


def _left_over(board: Board, selection: Selection) -> list[np.ndarray]:
    terms = selection.best.terms if selection.best is not None else ()
    return Scorer(board, terms).residuals(ORDINARY_AT_MOST)


def diagnose(
    runs: Sequence[Run], nominal: RobotModel, policy: Policy | None, rng: np.random.Generator, say: Say,
    *, library: Mapping[str, LibraryEffect] = LIBRARY, calibration: Calibration | None = None,
    with_synthesis: bool = False, nominal_name: str = "", limits_rad: tuple[Array, Array] | None = None,
    engine: Engine | None = None,
) -> Diagnosis:  # fmt: skip
    """Diagnose logs.

    Args:
        runs: Logs of one robot.
        nominal: The simulator's model.
        policy: The policy that ran; without it nothing is simulated: no gap map, no shrink.
        rng: Draws noise of simulated sensors, permutations, resamples.
        say: Where progress goes.
        library: Effects that are tried.
        calibration: Numbers behind the probabilities; the package's own by default.
        with_synthesis: Also diagnose the nominal simulator with the effects put in.
        nominal_name: For the verdict.
        limits_rad: Joint stops of a robot other than Spot, low and high.
        engine: Computes closed-loop runs; in this process by default.
    """
    chosen = calibration or Calibration.load()
    tell = say.at if isinstance(say, Progress) else _ignore
    say(f"building channels of {len(runs)} logs")
    found = explain(runs, nominal, policy, library, chosen, say, limits_rad)
    best = found.selection.best
    is_spot = found.board.robot.joint_names == facts.JOINT_NAMES
    corrected = corrected_model(nominal, found.board.robot, best) if best is not None and is_spot else nominal
    notes = [n for view in found.views.values() for n in view.notes]
    map_, measured = None, None
    scripts = tuple(s for run in runs if (s := script_of(run)) is not None) if policy is not None and is_spot else ()
    if policy is None or not scripts:
        notes.append(WITHOUT_RUNS)
    else:
        say("simulating the models through the same commands")
        is_shared = best is not None and any(t.effect.name in SURROUNDING_EFFECTS for t in best.terms)
        bench = Bench(tuple(runs), scripts, policy, engine or LocalEngine(policy), corrected if is_shared else None)
        simulated = simulate_all(bench, nominal, found.board, found.selection, found.posterior.groups, rng, tell)
        simulated, winner, rider = decided(bench, simulated)
        found = _with_members(found, simulated.members, winner, chosen)
        if rider is not None:
            say(f"{rider.effect} {'is added' if rider.is_added else 'is left out'}: so closed loops come nearer")
            found = _with_effects(found, rider.scored, library, chosen)
        if found.selection.best is not None and found.selection.best is not best:
            corrected = corrected_model(nominal, found.board.robot, found.selection.best)
        logs = stack([record(run) for run in simulated.runs["nominal"]])
        views, _ = build_views(logs, nominal)
        legs = found.board.robot.leg_of_joint
        map_ = gap_map(Side(found.stack, found.views.get("A")), Side(logs, views.get("A")), legs, rng)
        measured = measure(bench, simulated, rng)
        if (shrink := measured.shrink) is not None and shrink.held_out:
            found = replace(found, posterior=after_shrink(found.posterior, shrink, sum(found.selection.gains)))
        notes += [*measured.notes, *([map_.note] if map_.note else [])]
    verdict = _verdict(found, map_, measured, notes, runs, nominal_name)
    verdict = verdict.model_copy(update={"without": tuple(n for n in LIBRARY if n not in library)})
    if with_synthesis and best is not None and policy is not None and is_spot:
        from diagnosis.synthesis import synthesis_check

        say("synthesis check")
        verdict = verdict.model_copy(update={
            "synthesis": synthesis_check(runs, nominal, corrected, policy, verdict, rng, library, chosen)
        })  # fmt: skip
    return Diagnosis(verdict, corrected, map_, measured, tuple(runs), found.board)


def _with_members(
    found: Explained, members: Sequence[Member], winner: Member | None, calibration: Calibration
) -> Explained:
    """What was found, knowing the closed loops of the groups' members."""
    selection = with_member(found.selection, winner) if winner is not None else found.selection
    return replace(
        found, selection=selection, posterior=after_members(found.posterior, members, winner, calibration)
    )  # fmt: skip


def _with_effects(
    found: Explained, best: Scored, library: Mapping[str, LibraryEffect], calibration: Calibration
) -> Explained:
    """What was found, with another set of effects."""
    selection = selection_of(found.board, best, found.selection.first, library)
    left = _remainder(found.board, found.stack, selection)
    return replace(found, selection=selection, left=left, posterior=posterior(selection, left, calibration))


def _ignore(share: float) -> None:
    """Progress that nobody watches."""


def status_of(found: Explained) -> Status:
    """The verdict in a word."""
    p = found.posterior
    if not found.views.keys() & {"A", "B", "D"}:
        return "cannot_tell"
    if p.unknown > UNKNOWN_IS_LIKELY:
        return "unknown_effect"
    if found.selection.best is None or p.none > NONE_IS_LIKELY:
        return "no_gap"
    return "partly_explained" if p.unknown > PARTLY else "explained"


def _verdict(
    found: Explained,
    map_: GapMap | None,
    measured: Measured | None,
    notes: Sequence[str],
    runs: Sequence[Run],
    nominal_name: str,
) -> Verdict:
    status, plain = sober(status_of(found), found.views, measured.shrink if measured is not None else None)
    effects = tuple(_effects(found)) if status not in ("no_gap", "cannot_tell") else ()
    unknown = None
    if status in ("unknown_effect", "partly_explained"):
        unknown = describe(found.board, found.stack, _left_over(found.board, found.selection), found.left)
    off = {c.name: f"off: {c.reason}" for c in found.off}
    cells = map_.cells if map_ is not None else ()
    # Channels that cannot tell say nothing for or against either.
    none, unknown_too = (0.5, 0.5) if status == "cannot_tell" else (found.posterior.none, found.posterior.unknown)
    return Verdict(
        status=status,
        where=tuple(c for c in cells if c.p_value is None or c.p_value <= 0.05)[:N_WHERE],
        effects=effects,
        probability_none=none,
        probability_unknown=unknown_too,
        unknown=unknown,
        channels={**dict.fromkeys(found.views, "used"), **off},
        invisible=tuple(sorted(n for n, e in LIBRARY.items() if not e.show(found.views))),
        shrink=measured.shrink if measured is not None and effects else None,
        log_advice=advice(found.stack, found.views, found.off, effects, unknown),
        timeline=tuple(_timeline(found)),
        logs=tuple(str(run.path) for run in runs),
        nominal=nominal_name,
        notes=tuple(dict.fromkeys([*([plain] if plain else []), *notes])),
    )


def _effects(found: Explained) -> list[FoundEffect]:
    out: list[FoundEffect] = []
    best, p = found.selection.best, found.posterior
    if best is None:
        return out
    board = found.board
    for i, (term, gain, rivals, group) in enumerate(
        zip(best.terms, found.selection.gains, found.selection.rivals, p.groups, strict=True)
    ):
        others = best.terms[:i] + best.terms[i + 1 :]
        scorer = Scorer(board, others)
        own = next((r.scored for r in rivals if r.scored.terms[-1].effect.name == term.effect.name), None)
        scored = own or scorer.scored(term.effect, term.shape, term.place)
        top = rivals[0].scored if rivals else scored
        last = top.terms[-1]
        some = (1.0 - p.none) * (1.0 - p.unknown)
        share = group.probabilities.get(last.effect.name, 0.0)
        baseline = np.array([0.0] * len(board.blocks)) if not others else (
            scorer.now.by_block
        )  # fmt: skip
        by_channel = {c: round(float((top.by_block - baseline)[n].sum()), 1) for c, n in board.by_channel.items()}
        grouped = len(group.names) > 1
        out.append(FoundEffect(
            name=last.effect.name,
            title=last.effect.title,
            probability=min(1.0, some * share),
            group=group.names or (last.effect.name,),
            margin_nats=group.margin_nats,
            joints=board.robot.named(board.robot.joints_of(last.effect, last.place)),
            split_by=last.effect.split_by.text if grouped else "",
            split=split(last.effect.split_by) if grouped else None,
            parameters=numbers(scorer, top),
            rivals={n: some * v for n, v in group.probabilities.items()},
            gain_nats=float(gain),
            channels={c: v for c, v in by_channel.items() if abs(v) >= 1.0},
        ))  # fmt: skip
    return sorted(out, key=lambda e: -e.gain_nats)


def _timeline(found: Explained) -> list[Stretch]:
    """What was cut, and the seconds of each log that carry the most of channel A's residual."""
    out: list[Stretch] = []
    period = found.stack.period_s
    for run, (recording, cut) in enumerate(zip(found.stack.recordings, found.stack.segmentations, strict=True)):
        name = recording.run_id
        out += [
            Stretch(log=name, kind=s.kind, start_s=s.first * period, end_s=(s.last + 1) * period, reason=s.reason)
            for s in cut.segments
            if s.is_cut
        ]
        view = found.views.get("A")
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
                log=name, kind="gap", start_s=float(at), end_s=float(at + 1),
                reason=f"the load's error is {times[at]:.1f} times its usual size",
            )
            for at in np.flatnonzero(times > CARRIES)
        ]  # fmt: skip
    return out


def with_effect(library: Mapping[str, LibraryEffect], extra: LibraryEffect) -> dict[str, LibraryEffect]:
    """The library and one more effect."""
    return {**library, extra.name: extra}


__all__ = ["Diagnosis", "Explained", "diagnose", "explain", "replace", "status_of", "with_effect"]
