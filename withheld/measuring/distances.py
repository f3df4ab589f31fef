"""What only the judge can measure: how far each fault moves the headline gap, and the true S of a delivered model."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from spot_log import Run, read_run
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy
from trainer.sysid.distance.measures import SequenceReference
from withheld.features import Features, features_of_run
from withheld.measuring.closed_loop import simulate
from withheld.plan import Made, MakesRuns, Reality, RecordingPlan, Walk

MIN_TICKS: Final = 50
TWIN_REPEATS: Final = 3
"""Runs of each sequence by the robot without a fault; several, so that there is a floor even for a case of one run."""
SHRINK_REPEATS: Final = 3
"""Runs of each new sequence, real and simulated, for the true S."""
SMALLEST_GAP: Final = 0.25
"""In floors. A gap smaller than this above its floor cannot be shrunk by a share that means anything."""


class Written:
    """The runs of a reality that can only record: its logs lie in a folder at once.

    Args:
        reality: Which.
        plan: What it records.
        folder: Empty; the logs stay there.
    """

    def __init__(self, reality: Reality, plan: RecordingPlan, folder: Path) -> None:
        reality.record(plan, folder)
        self._folder = folder

    def walks(self, policy: Policy) -> list[Walk]:
        """Read from the logs."""
        runs = [read_run(path) for path in sorted(self._folder.glob("*.mcap"))]
        return [(run.header.command_sequence or "unnamed", features_of_run(run, policy)) for run in runs]

    def write(self, folder: Path) -> None:
        """They are there."""


def make_runs(reality: Reality, plan: RecordingPlan, folder: Path) -> Made:
    """The runs of a plan, without logs where the reality can; ``folder`` is for those of one that cannot."""
    return reality.make_runs(plan) if isinstance(reality, MakesRuns) else Written(reality, plan, folder)


def moved(walks: Sequence[Walk], twins: Sequence[Walk]) -> float | None:
    """(D − floor)/floor: D the mean W1 + MMD between runs with and without a fault, floor that between repeats.

    None where a robot fell too soon.
    """
    first, second = _by_sequence(walks), _by_sequence(twins)
    ratios = []
    for name in sorted(first.keys() & second.keys()):
        repeated, others = first[name], second[name]
        if len(repeated) < len(others):
            repeated, others = others, repeated
        if len(repeated) > 1:
            reference = SequenceReference.build(name, repeated)
            ratios.append(float(np.mean([reference.distances(f) / reference.scale for f in others])))
    return float(np.mean(ratios)) - 1.0 if ratios else None


def true_shrink(
    runs: Sequence[Run], nominal: RobotModel, delivered: RobotModel, policy: Policy, seed: int
) -> float | None:
    """S = (D0 − D1)/(D0 − floor) of a delivered model, on runs of the reality that neither fit nor verdict saw.

    Args:
        runs: New logs of the reality, several of each sequence.
        nominal: The model that the diagnosis was given.
        delivered: The model that it wrote.
        policy: In the loop.
        seed: Of the simulated runs.

    Returns:
        None where the nominal model has no gap to speak of, or a robot falls.
    """
    d0, d1 = (_distance(runs, model, policy, seed) for model in (nominal, delivered))
    return None if d0 is None or d1 is None or d0 < 1.0 + SMALLEST_GAP else (d0 - d1) / (d0 - 1.0)


def _distance(runs: Sequence[Run], model: RobotModel, policy: Policy, seed: int) -> float | None:
    """Mean over the sequences, in floors."""
    made = simulate(model, policy, runs, np.random.default_rng(seed))
    real = _by_sequence([(run.header.command_sequence, features_of_run(run, policy)) for run in runs])
    simulated = _by_sequence([(run.header.command_sequence, f) for run, f in zip(runs, made, strict=True)])
    ratios = []
    for name, repeated in real.items():
        if len(repeated) < 2:
            continue
        if name not in simulated:
            return None
        reference = SequenceReference.build(name, repeated)
        ratios.append(float(np.mean([reference.distances(f) / reference.scale for f in simulated[name]])))
    return float(np.mean(ratios)) if ratios else None


def _by_sequence(walks: Sequence[Walk]) -> dict[str, list[Features]]:
    found: dict[str, list[Features]] = {}
    for name, features in walks:
        if len(features) >= MIN_TICKS:
            found.setdefault(name, []).append(features)
    return found
