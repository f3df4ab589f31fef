"""What formulas leave in each channel of robots without a fault: two tables of ``decision_constants.py``.

    python benchmarks/calibrate_formulas.py --seed 41 --robots 24 [--workers 2]

Robots are the calibrating catalogue's, with ordinary errors 0.5 to 5 times the usual. Printed by channel are the
discrepancy, root mean square in units of the noise of what the formulas leave in command sequences that nothing was
fitted to, beyond noise and beyond their share of what ordinary errors explain; and the nats that signals still predict
of the rest. Both are medians over the robots, with the 5 and 95 % quantiles.
"""

from __future__ import annotations

from argparse import ArgumentParser
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from diagnosis.read.prepare import prepared
from diagnosis.read.robot_file import SPOT
from diagnosis.selection.normal_equations import one_thread
from diagnosis.selection.scoring import Scorer, null_of
from diagnosis.selection.unexplained import remainder
from diagnosis.verdict.explanation import evidence_of
from spot_log import read_run
from spot_model.policy.built_in import FOLDER
from spot_model.policy.policy import load_policy
from withheld.cases import chosen, draw
from withheld.plan import RecordingPlan
from withheld.realities.source import source_of
from withheld.simulator.simulation import RealityDivergedError

POLICIES = FOLDER


def left_by_channel(seed: int, number: int) -> Mapping[str, tuple[float, float]]:
    """Of one robot, discrepancy and nats by channel; empty where its simulation broke down."""
    source = source_of("calibrating")
    case = draw(seed, number, source, POLICIES)
    file = POLICIES / f"{case.policy}.onnx"
    reality = source.make(case.requests, case.reality_seed)
    plan = RecordingPlan(file, case.sequences, case.repeats, case.recording_seed, frozenset(case.missing), case.detail)
    with TemporaryDirectory() as folder:
        try:
            reality.record(plan, Path(folder))
        except RealityDivergedError:
            return {}
        runs, _ = prepared([read_run(path) for path in sorted(Path(folder).glob("*.mcap"))], SPOT)
    with one_thread():
        logs, _, _, board = evidence_of(runs, reality.nominal, load_policy(file), {})
        null = null_of(board)
        rest = remainder(board, logs, Scorer(board).residuals(), null.explained)
    excess = null.held_out - 1.0 - board.relative_square * null.explained
    return {
        str(channel): (float(np.sqrt(max(0.0, np.median(excess[blocks])))), float(rest.nats[blocks].sum()))
        for channel, blocks in board.by_channel.items()
    }


def main() -> None:
    """Read the command line, and print."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--robots", type=int, default=24)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    numbers = chosen(given.seed, range(100 * given.robots), ("faultless",))[: given.robots]
    with ProcessPoolExecutor(given.workers) as pool:
        rows = list(pool.map(left_by_channel, [given.seed] * len(numbers), numbers))
    for channel in sorted({c for row in rows for c in row}):
        own = np.array([row[channel] for row in rows if channel in row])
        (a, b), (low_a, low_b), (high_a, high_b) = np.quantile(own, [0.5, 0.05, 0.95], axis=0)
        print(
            f"{channel}: discrepancy {a:.2f} ({low_a:.2f} to {high_a:.2f}), "
            f"nats {b:.1f} ({low_b:.1f} to {high_b:.1f}); {len(own)} robots"
        )


if __name__ == "__main__":
    main()
