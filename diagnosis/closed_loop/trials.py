"""Closed-loop runs of several models on sequences that their fits never saw, their distances, and the shrink."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from diagnosis.closed_loop.environment import ChosenSurroundings, Surroundings, best_surroundings
from diagnosis.closed_loop.run_numbers import time_to_fall
from diagnosis.closed_loop.shrink import (
    Features,
    SequenceDistances,
    features_by_sequence,
    sequence_distances,
    sequence_name,
    shrinkage,
    simulated_features,
)
from diagnosis.closed_loop.simulation import RolloutEngine, run_all
from diagnosis.document import Shrink
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.robot_models import corrected_model
from diagnosis.selection.scoring import Scored
from spot_log.read.run import Run
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy
from spot_model.text import counted
from trainer.signals.policy_ticks import Script, scripts_of
from trainer.simulate.engine import Tell


@dataclass(frozen=True)
class Bench:
    """What every model is put through."""

    runs: tuple[Run, ...]
    """Real logs."""
    scripts: tuple[Script, ...]
    """Scripts of the runs that are long enough."""
    policy: Policy
    engine: RolloutEngine

    @staticmethod
    def of(runs: Sequence[Run], policy: Policy, engine: RolloutEngine) -> Bench | None:
        """With every log that is long enough, run so often that simulated runs of a sequence have a scatter too.

        Logs at gains other than the policy's are left out. None where no log is long enough.
        """
        runs = [run for run in runs if run.header.policy_sha256 in ("", policy.sha256)]
        scripts = scripts_of(runs)
        for name in sorted({s.sequence for s in scripts}):
            own = [s for s in scripts if s.sequence == name]
            others = [s for s in scripts if s.sequence != name] or own
            last = max(s.repeat for s in own)
            # Runs that start alike scatter less than a robot's: the others lend their starts.
            scripts += [
                replace(own[i % len(own)], repeat=last + 1 + i, start=others[i % len(others)].start)
                for i in range(max(0, LEAST_RUNS - len(own)))
            ]
        return Bench(tuple(runs), tuple(scripts), policy, engine) if scripts else None

    @property
    def sequences(self) -> list[str]:
        """Names of the command sequences."""
        return sorted({s.sequence for s in self.scripts})

    def real(self) -> dict[str, Features]:
        """Real runs' features by sequence."""
        return dict(features_by_sequence(self.runs, self.policy))


NOMINAL: Final = "nominal"
"""The nominal model among those that are run: as its file has it, in no surroundings but its own."""
LEAST_RUNS: Final = 3
"""Simulated runs of a sequence, however few real ones there are."""
LOWER: Final = 1.0 / 3.0
"""Quantile of a sequence's simulated runs that counts: some stumble where the robot did not."""
SMALLEST: Final = 0.01
"""No distance counts as less."""


@dataclass(frozen=True)
class Trials:
    """Closed-loop runs of several models, and how far each is from the robot."""

    bench: Bench
    runs: Mapping[str, list[Run]]
    """By name of the model."""
    compared: tuple[SequenceDistances, ...]
    is_crossed: bool
    """Whether each sequence's model was fitted without it."""
    notes: tuple[str, ...]
    surroundings: ChosenSurroundings = ChosenSurroundings({})
    """Surroundings of all models but the nominal one."""

    def distances(self) -> dict[str, float]:
        """One by model, in floors: distances between the robot's own repeats; without repeats between the model's.

        Neither one simulated run that stumbles nor one sequence rules it.
        """
        names = self.compared[0].models if self.compared else ()
        lower = {n: [np.quantile(c.models[n].mean(axis=1), LOWER) for c in self.compared] for n in names}
        return {name: float(np.exp(np.mean(np.log(np.maximum(own, SMALLEST))))) for name, own in lower.items()}


def run_trials(
    bench: Bench,
    nominal: RobotModel,
    board: Evidence,
    candidates: Mapping[str, Scored],
    stated: str,
    rng: np.random.Generator,
    tell: Tell = lambda _: None,
) -> Trials:
    """Run the nominal model, and each candidate in the surroundings of the stated one.

    Args:
        bench: Real logs and how to simulate them.
        nominal: The model.
        board: The evidence, with its folds.
        candidates: Fitted sets of effects with their ordinary errors, by name.
        stated: Name of the candidate whose surroundings serve all.
        rng: Draws seeds.
        tell: Called with the share that is done.

    Raises:
        BadInputError: The nominal model cannot be simulated.
    """
    names, notes = bench.sequences, []
    crossed = list(board.fold_names) == names and len(names) > 1
    models = {NOMINAL: dict.fromkeys(names, nominal)}  # by name and command sequence
    chosen = ChosenSurroundings({})
    for name, scored in candidates.items():
        made, why = _fitted_models(nominal, board, scored, names if crossed else [])
        if made is None:
            notes.append(f"{name} cannot be simulated: {why}")
            continue
        models[name] = {s: made[k if crossed else -1] for k, s in enumerate(names)}
        if name == stated:
            chosen = best_surroundings(
                made[-1], bench.scripts, bench.runs, bench.policy, bench.engine, rng, lambda share: tell(0.5 * share)
            )
    # One object for one model in one place: runs of models that cannot be merged go by model.
    placed: dict[tuple[int, Surroundings], RobotModel] = {}
    jobs, owners = [], []
    for name, by_sequence in models.items():
        for sequence, model in by_sequence.items():
            around = chosen.by_sequence.get(sequence) if name != NOMINAL else None
            own = model if around is None else placed.setdefault((id(model), around), around.around(model))
            mine = [(own, script) for script in bench.scripts if script.sequence == sequence]
            jobs += mine
            owners += [name] * len(mine)
    runs: dict[str, list[Run]] = {name: [] for name in models}
    made_runs = run_all(jobs, bench.engine, rng, lambda share: tell(0.5 + 0.5 * share))
    for name, run in zip(owners, made_runs, strict=True):
        runs[name].append(run)
    compared, told = compared_by_sequence(bench, runs)
    return Trials(bench, runs, tuple(compared), crossed, (*notes, *told), chosen)


def _fitted_models(
    nominal: RobotModel, board: Evidence, scored: Scored, folds: Sequence[str]
) -> tuple[list[RobotModel] | None, str]:
    """Models fitted without each fold, and last the one fitted to all; None, and why, if a value is out of bounds."""
    try:
        without = [corrected_model(nominal, board, scored, k) for k in range(len(folds))]
        return [*without, corrected_model(nominal, board, scored)], ""
    except BadInputError as error:
        return None, str(error)


def measure_shrink(trials: Trials, stated: str, rng: np.random.Generator) -> Shrink | None:
    """How much of the gap the stated model closes; in crossed trials on sequences that its numbers never saw."""
    compared = trials.compared
    if not compared or stated not in trials.runs:
        return None
    d0, d1, floor, s, low, high = shrinkage(compared, NOMINAL, stated, rng, trials.surroundings.doubt)
    return Shrink(
        d0=d0,
        d1=d1,
        floor=floor,
        floor_of="robot" if compared[0].real.shape[0] > 1 else "model",
        s=s,
        s_low=low,
        s_high=high,
        held_out=tuple(c.sequence for c in compared) if trials.is_crossed else (),
    )


def compared_by_sequence(
    bench: Bench, models: Mapping[str, Sequence[Run]]
) -> tuple[list[SequenceDistances], list[str]]:
    """Distances by sequence, each of a run up to its fall, and what has to be known of them."""
    real = bench.real()
    parts = {name: simulated_features(group, bench.policy) for name, group in models.items()}
    compared, notes = [], []
    for sequence in bench.sequences:
        notes += _falls_of(sequence, bench.runs)
        own = {name: part[sequence] for name, part in parts.items()}
        compared.append(sequence_distances(sequence, real[sequence], own, steady=NOMINAL))
    for sequence in sorted({sequence_name(r) for r in bench.runs} - set(bench.sequences)):
        notes += _falls_of(sequence, bench.runs) and [
            f"sequence {sequence}: every run fell within a second; none is simulated"
        ]
    repeated = [c for c in compared if c.real.shape[0] > 1]
    if repeated and len(repeated) < len(compared):
        # Without a floor of its own, a sequence's distances have another unit.
        single = ", ".join(c.sequence for c in compared if c.real.shape[0] < 2)
        notes.append(f"there is one run alone of {single}: without a repeat, it does not count for the shrink")
    return repeated or compared, notes


def _falls_of(sequence: str, runs: Sequence[Run]) -> list[str]:
    mine = [run for run in runs if sequence_name(run) == sequence]
    falls_s = [lasted.time_s for run in mine if (lasted := time_to_fall(run)) is not None and lasted.has_fallen]
    if not falls_s:
        return []
    told = f"{len(falls_s)} of {counted(len(mine), 'run')} of the robot fell, the first after {min(falls_s):.1f} s"
    return [f"sequence {sequence}: {told}; motion is compared up to the fall"]
