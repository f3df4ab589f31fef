"""What only the judge can measure: how far the faults move the headline gap, and the true shrink of a stated model."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.logs import features_of_ticks
from diagnosis.measure import shrink_of
from spot_log import Run, read_run
from spot_model.io.model_file import RobotModel
from spot_model.io.velocity_sequence import VelocitySequence
from spot_model.policy.policy import Policy, load_policy
from trainer.sysid.distance.measures import SequenceReference
from withheld.plan import Reality, RecordingPlan, Rehearsal, Rehearsing, Walk

Features = NDArray[np.float32]

MIN_TICKS: Final = 50
TWIN_REPEATS: Final = 2
"""Runs of each sequence by the robot without its faults; with two there is a floor even where a case has one run."""


def read_folder(folder: Path) -> list[Run]:
    """All logs of a folder, in the order of their sequences and repeats."""
    runs = [read_run(path) for path in sorted(folder.glob("*.mcap"))]
    return sorted(runs, key=lambda r: (r.header.command_sequence or "", r.header.repeat))


def walks_of(runs: Sequence[Run]) -> list[Walk]:
    """Runs as the measure sees them."""
    return [(run.header.command_sequence or "unnamed", run.ticks) for run in runs]


class Written:
    """The rehearsal of a reality that can only record: its logs lie in a folder at once.

    Args:
        reality: Which.
        plan: What it records.
        folder: Empty; the logs stay there.
    """

    def __init__(self, reality: Reality, plan: RecordingPlan, folder: Path) -> None:
        reality.record(plan, folder)
        self._folder = folder

    @property
    def walks(self) -> list[Walk]:
        """Read from the logs."""
        return walks_of(read_folder(self._folder))

    def write(self, folder: Path) -> None:
        """They are there."""


def rehearse(reality: Reality, plan: RecordingPlan, folder: Path) -> Rehearsal:
    """The runs of a plan, without logs where the reality can; ``folder`` is for those of one that cannot."""
    return reality.rehearse(plan) if isinstance(reality, Rehearsing) else Written(reality, plan, folder)


def moved(runs: Sequence[Walk], twins: Sequence[Walk], policy: Policy) -> float | None:
    """(D − floor)/floor, D the mean W1 + MMD between runs with and without the faults, floor that of repeats.

    None where the robot fell too soon, or nothing is different.
    """
    first, second = _by_sequence(runs, policy), _by_sequence(twins, policy)
    ratios = []
    for name in sorted(first.keys() & second.keys()):
        repeated = first[name] if len(first[name]) > 1 else second[name]
        if len(repeated) < 2:
            continue
        reference = SequenceReference.build(name, repeated)
        others = second[name] if repeated is first[name] else first[name]
        ratios.append(float(np.mean([reference.distances(f) / reference.scale for f in others])))
    return float(np.mean(ratios)) - 1.0 if ratios else None


def true_shrink(
    reality: Reality,
    corrected: RobotModel,
    policy_path: Path,
    sequences: Sequence[VelocitySequence],
    repeats: int,
    seed: int,
    folder: Path,
) -> float | None:
    """S of a stated model as a verdict measures it, on sequences that neither fit nor verdict saw, with more runs.

    Args:
        reality: With its faults.
        corrected: What the diagnosis made.
        policy_path: The policy's file.
        sequences: New ones.
        repeats: Runs of each.
        seed: Of the recordings and the simulated sensors.
        folder: For the logs; empty.
    """
    plan = RecordingPlan(policy=policy_path, sequences=tuple(sequences), repeats=repeats, seed=seed)
    reality.record(plan, folder)
    rng = np.random.default_rng(seed)
    found = shrink_of(read_folder(folder), reality.nominal, corrected, load_policy(policy_path), rng)
    return None if found is None else found.s


def _by_sequence(walks: Sequence[Walk], policy: Policy) -> dict[str, list[Features]]:
    found: dict[str, list[Features]] = {}
    for name, ticks in walks:
        f = features_of_ticks(ticks, policy)
        if len(f) >= MIN_TICKS:
            found.setdefault(name, []).append(f)
    return found
