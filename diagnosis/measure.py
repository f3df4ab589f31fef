"""Closed-loop runs of the nominal, corrected and placebo models on sequences that the fit never saw, and the shrink."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from diagnosis.fitted import corrected_model, without_fold
from diagnosis.logs import features, policy_ticks
from diagnosis.selection.board import Board
from diagnosis.selection.scoring import Scored
from diagnosis.selection.search import Rival, Selection
from diagnosis.shrink import Compared, compare, shrinkage
from diagnosis.simulated import Script, SensorNoise, simulate
from diagnosis.verdict import OtherGap, Placebo, Shrink
from spot_model.errors import BadInputError
from spot_model.model_file import RobotModel
from spot_model.policy import Policy
from spot_runtime.log.run import Run

MIN_FEATURE_TICKS = 50


@dataclass(frozen=True)
class Measured:
    """The shrink and the runs behind it."""

    shrink: Shrink | None
    nominal: tuple[Run, ...]
    corrected: tuple[Run, ...]
    notes: tuple[str, ...]


def measure(
    runs: Sequence[Run], scripts: Sequence[Script], simulated: Sequence[Run], nominal: RobotModel, board: Board,
    selection: Selection, policy: Policy, rng: np.random.Generator,
) -> Measured:  # fmt: skip
    """Roll out and compare.

    Args:
        runs: Real logs.
        scripts: Of those that are long enough.
        simulated: The nominal model's runs of the scripts.
        nominal: The model.
        board: With the folds.
        selection: What was chosen.
        policy: The policy that ran.
        rng: Draws sensor noise and resamples.
    """
    best = selection.best
    if best is None:
        return Measured(None, tuple(simulated), (), ())
    notes: list[str] = []
    names = sorted({s.sequence for s in scripts})
    crossed = list(board.fold_names) == names and len(names) > 1
    if not crossed:
        notes.append("all logs are of one command sequence: the shrink is measured on sequences that the fit saw")
    placebo = _placebo(selection)
    models = {"corrected": best} | ({"placebo": placebo.scored} if placebo is not None else {})
    made: dict[str, list[Run]] = {name: [] for name in models}
    for name, scored in models.items():
        for sequence in names if crossed else [None]:
            mine = [s for s in scripts if sequence is None or s.sequence == sequence]
            own = without_fold(scored, names.index(sequence)) if sequence is not None else None
            try:
                model = corrected_model(nominal, board.robot, scored, own)
                made[name] += simulate(model, policy, mine, rng, SensorNoise())
            except BadInputError as error:
                notes.append(f"{name} model cannot be simulated: {error}")
                made[name] = []
                break
    if not made["corrected"]:
        return Measured(None, tuple(simulated), (), tuple(notes))
    models_runs: dict[str, Sequence[Run]] = {"nominal": simulated, **{k: v for k, v in made.items() if v}}
    compared = []
    for sequence in names:
        real = _of(runs, sequence, policy)
        parts = {name: _of(group, sequence, policy) for name, group in models_runs.items()}
        fallen = [n for n, p in parts.items() if not p]
        if fallen:
            notes.append(f"sequence {sequence}: {', '.join(fallen)} fell at once and is not compared")
            continue
        compared.append(compare(sequence, real, parts))
    if not compared:
        return Measured(None, tuple(simulated), tuple(made["corrected"]), tuple(notes))
    after = shrinkage(compared, "nominal", "corrected", rng)
    wrong = shrinkage(compared, "nominal", "placebo", rng) if "placebo" in models_runs else None
    shrink = Shrink(
        d0=after.d0, d1=after.d1, floor=after.floor, s=after.s, s_low=after.low, s_high=after.high,
        held_out=tuple(c.sequence for c in compared) if crossed else (),
        placebo=Placebo(name=placebo.scored.terms[-1].effect.name, s=wrong.s)
        if wrong is not None and wrong.s is not None and placebo is not None else None,
        beside=tuple(_beside(runs, simulated, made["corrected"])),
    )  # fmt: skip
    if any(c.real.shape[0] < 2 for c in compared):
        notes.append("a sequence was run once: its floor counts as 0, and S is a lower bound")
    return Measured(shrink, tuple(simulated), tuple(made["corrected"]), tuple(notes))


def _of(runs: Sequence[Run], sequence: str, policy: Policy) -> list[np.ndarray]:
    chosen = [r for r in runs if (r.header.command_sequence or "unnamed") == sequence]
    return [f for r in chosen if len(f := features(r, policy)) >= MIN_FEATURE_TICKS]


def _placebo(selection: Selection) -> Rival | None:
    """The best effect outside of the chosen one's place with at least as many parameters, alone in that place."""
    if selection.best is None or not selection.rivals:
        return None
    chosen = selection.best.terms[-1]
    names = {t.effect.name for t in selection.best.terms}
    last = [r for r in selection.rivals[-1] if r.scored.terms[-1].effect.name not in names]
    enough = [r for r in last if r.scored.terms[-1].n_parameters >= chosen.n_parameters]
    best = enough or last
    return best[0] if best else None


def _beside(runs: Sequence[Run], before: Sequence[Run], after: Sequence[Run]) -> list[OtherGap]:
    """Gaps of measured torque and body speed: mean Wasserstein distance by channel of the signal."""
    out = []
    for name, unit, pick in (("load", "N·m", _load), ("body velocity", "m/s", _velocity)):
        pairs = [(a, b, c) for a, b, c in _matched(runs, before, after)]
        gaps = [(_w1(pick(a), pick(b)), _w1(pick(a), pick(c))) for a, b, c in pairs]
        same = [
            _w1(pick(a), pick(b))
            for i, a in enumerate(runs) for b in runs[:i]
            if a.header.command_sequence == b.header.command_sequence
        ]  # fmt: skip
        if gaps and np.isfinite(gaps).all():
            b, a = np.mean(gaps, axis=0)
            out.append(
                OtherGap(
                    name=name, unit=unit, before=float(b), after=float(a), floor=float(np.mean(same)) if same else 0.0
                )
            )
    return out


def _matched(runs: Sequence[Run], before: Sequence[Run], after: Sequence[Run]) -> list[tuple[Run, Run, Run]]:
    def key(run: Run) -> tuple[str, int]:
        return (run.header.command_sequence or "unnamed", run.header.repeat)

    first, second = {key(r): r for r in before}, {key(r): r for r in after}
    return [(r, first[key(r)], second[key(r)]) for r in runs if key(r) in first and key(r) in second]


def _load(run: Run) -> np.ndarray:
    return np.asarray(run.states.load_nm[_active(run)])


def _velocity(run: Run) -> np.ndarray:
    return np.asarray(run.ticks.observation[policy_ticks(run), :3], dtype=np.float64)


def _active(run: Run) -> np.ndarray:
    rows = policy_ticks(run)
    stamps = run.ticks.robot_stamp_ns[rows]
    return np.asarray((run.states.robot_stamp_ns >= stamps[0]) & (run.states.robot_stamp_ns <= stamps[-1]))


def _w1(a: np.ndarray, b: np.ndarray) -> float:
    grid = (np.arange(200) + 0.5) / 200
    return float(np.mean(np.abs(np.quantile(a, grid, axis=0) - np.quantile(b, grid, axis=0))))


__all__ = ["Compared", "Measured", "Scored", "measure"]
