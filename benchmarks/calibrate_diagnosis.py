"""Fits P(a difference is there) and P(something unknown is there) to simulated robots whose faults are known.

    python benchmarks/calibrate_diagnosis.py robots --seed 20261 --to 240 --out FOLDER [--workers 2] [--until 3600]
    python benchmarks/calibrate_diagnosis.py fit FOLDER

``robots`` draws cases as the withheld check does, but of its calibrating catalogue; of every eight, two have no fault,
four have one, one has two and one has a fault outside the library. Of each it keeps the evidence of every effect of the
best set, and how far closed loops of the corrected model are from the robot. A robot that its fault moves is explained
a second time by a library without that fault's effects. One robot is one file; ``robots`` can be interrupted and goes
on, and ``--first`` and ``--to`` divide an ensemble between machines.

``fit`` prints what faultless robots leave by channel, and for both probabilities logistic regressions of several forms
with log loss and expected calibration error on robots that were not fitted (ten folds).
"""

from __future__ import annotations

import json
import tempfile
import time
from argparse import Namespace
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import count, islice
from pathlib import Path
from typing import Any, Final

import numpy as np
from calibration_forms import NOTHING, fit
from many_robots import make_all, two_steps
from numpy.typing import NDArray

from diagnosis.closed_loop.simulation import rollouts_under
from diagnosis.closed_loop.trials import Bench, run_trials
from diagnosis.library import LibraryEffect
from diagnosis.library.registry import LIBRARY
from diagnosis.read.prepare import prepared
from diagnosis.read.robot_file import SPOT
from diagnosis.selection.calibrated import calibrated
from diagnosis.selection.normal_equations import one_thread
from diagnosis.selection.robot_models import size_of_errors
from diagnosis.selection.scoring import Placed, null_of
from diagnosis.selection.search import search
from diagnosis.verdict.causes import CALIBRATED, candidates_of, decide, name_of, own_nats
from diagnosis.verdict.explanation import Explanation, explain
from diagnosis.verdict.probability import excess
from spot_log.read.run import Run
from spot_model.io.model_file import RobotModel
from spot_model.policy.built_in import FOLDER
from spot_model.policy.policy import Policy, load_policy
from withheld.blind.execution import what_faults_do
from withheld.cases import Case, CaseKind, draw, kind_of
from withheld.measuring import record_runs
from withheld.plan import Fault, Reality, RecordingPlan
from withheld.realities.source import Source, source_of
from withheld.simulator.simulation import RealityDivergedError

Array = NDArray[np.float64]
ORDER: Final[tuple[CaseKind, ...]] = (
    "faultless",
    "single",
    "single",
    "faultless",
    "single",
    "double",
    "outside",
    "single",
)
"""Of a block of robots."""
POLICIES: Final = FOLDER


def ensemble(seed: int) -> Iterator[int]:
    """Numbers of the cases of an endless draw, kinds in :data:`ORDER`."""
    pools = {kind: _of_kind(seed, kind) for kind in ORDER}
    while True:
        yield from (next(pools[kind]) for kind in ORDER)


def _of_kind(seed: int, kind: CaseKind) -> Iterator[int]:
    return (n for n in count() if kind_of(seed, n) == kind)


def robot(seed: int, number: int, out: Path) -> str:
    """Simulate and explain one robot, and write what was compared; returns a line to print."""
    file = out / f"{seed}-{number:04d}.json"
    if file.exists():
        return f"{number}: there"
    began_s, source = time.process_time(), source_of("calibrating")
    case = draw(seed, number, source, POLICIES)
    policy = load_policy(POLICIES / f"{case.policy}.onnx")
    try:
        reality, runs, by = recorded(case, source, policy)
    except RealityDivergedError:
        return f"{number}: its simulation broke down"
    faults = reality.truth.faults
    library = {name: entry for name, entry in LIBRARY.items() if name not in case.without}
    known = policy if case.detail == "stream" else None
    with one_thread():
        found = explain(runs, reality.nominal, known, library, lambda _: None)
        bench = Bench.of(runs, policy, rollouts_under(policy)) if known is not None else None
        kept: dict[str, Any] = {
            "number": number,
            "kind": case.kind,
            "policy": case.policy,
            "n_runs": len(runs),
            "error_scale": reality.truth.error_scale,
            "faults": [f.model_dump(mode="json") | {"moved": m} for f, m in zip(faults, by, strict=True)],
            "whole": evidence(found, reality, bench, library, case.diagnosis_seed),
        }
        moves = [m if m is not None and set(f.names) & library.keys() else 0.0 for f, m in zip(faults, by, strict=True)]
        if max(moves, default=0.0) >= NOTHING:
            hidden = faults[int(np.argmax(moves))].names
            less = {name: entry for name, entry in library.items() if name not in hidden}
            again = replace(found, selection=search(found.board, less, lambda _: None))
            kept["less"] = evidence(again, reality, bench, less, case.diagnosis_seed)
    file.write_text(json.dumps(kept))
    return f"{number}: {case.kind}, {time.process_time() - began_s:.0f} core-seconds"


def recorded(case: Case, source: Source, policy: Policy) -> tuple[Reality, list[Run], list[float | None]]:
    """A case's robot, its logs as a diagnosis reads them, and how far each fault moves it, in floors.

    Raises:
        RealityDivergedError: Its simulation broke down.
    """
    path = POLICIES / f"{case.policy}.onnx"
    plan = RecordingPlan(path, case.sequences, case.repeats, case.recording_seed, frozenset(case.missing), case.detail)
    with tempfile.TemporaryDirectory() as folder:
        reality = source.make(case.requests, case.reality_seed)
        logs = record_runs(reality, plan, Path(folder) / "logs")
        by = [own for own, _ in what_faults_do(source, case, reality, logs, policy, path, Path(folder))]
        runs, _ = prepared(sorted(logs, key=lambda run: str(run.path)), SPOT)
    return reality, list(runs), by


def evidence(
    found: Explanation, reality: Reality, bench: Bench | None, library: Mapping[str, LibraryEffect], seed: int
) -> dict[str, Any]:
    """What residuals say of each effect of the best set, and what its model leaves in closed loop."""
    board, best, own = found.board, found.selection.best, own_nats(found)
    candidates = candidates_of(found)
    effects = []
    for term, nats, rivals in zip(best.terms, found.selection.gains, found.selection.rivals, strict=True):
        names = [r.scored.terms[-1].effect.name for r in rivals if name_of(r.scored) in candidates]
        told = of_effect(found, term, reality.truth.faults, names)
        effects.append(told | {"nats": nats, "own_nats": own[term.effect.name]})
    rest, left = found.remainder, dict[str, float]()
    for channel, nats in zip(rest.channels, rest.nats, strict=True):
        left[channel] = left.get(channel, 0.0) + float(nats)
    return {
        "library": sorted(library),
        "effects": effects,
        "excess": excess(board, best),
        "left_nats": left,
        "errors": size_of_errors(board, best.pulls),
        "closed": simulated(found, reality.nominal, bench, library, seed),
    }


def simulated(
    found: Explanation, nominal: RobotModel, bench: Bench | None, library: Mapping[str, LibraryEffect], seed: int
) -> dict[str, float]:
    """How far models are from the robot, in floors, and what runs scatter by; empty without a policy."""
    if bench is None:
        return {}
    causes, board = decide(found, library), found.board
    best = calibrated(board, causes.best)
    models = {"stated": best, CALIBRATED: calibrated(board, null_of(board))}
    trials = run_trials(bench, nominal, board, models, "stated", np.random.default_rng(seed))
    if "stated" not in trials.runs:
        return {}
    return {
        **trials.distances(),
        "scatter_nm": trials.scatter_nm(),
        "model_scatter": trials.scatter_of("stated"),
    }


def of_effect(found: Explanation, term: Placed, faults: Sequence[Fault], rivals: Sequence[str]) -> dict[str, Any]:
    """One effect, and whether it or a rival in its place is there."""
    joints = set(found.board.robot.named(found.board.robot.joints_of(term.effect, term.place)))

    def is_there(name: str) -> bool:
        """At least half of the joints are right."""
        return any(name in f.names and (not f.joints or 2 * len(joints & {*f.joints}) >= len(joints)) for f in faults)

    return {
        "name": term.effect.name,
        "joints": sorted(joints),
        "rivals": list(rivals),
        "is_in_group": any(map(is_there, (term.effect.name, *rivals))),
    }


def robots(given: Namespace) -> None:
    """Make what is missing."""
    given.out.mkdir(parents=True, exist_ok=True)
    numbers = list(islice(ensemble(given.seed), given.first, given.to))
    late_s = time.monotonic() + given.until
    make_all(_unless_late, [(late_s, given.seed, n, given.out) for n in numbers], given.workers)


def _unless_late(until_s: float, seed: int, number: int, out: Path) -> str:
    return robot(seed, number, out) if time.monotonic() < until_s else f"{number}: left for another time"


def main() -> None:
    """Read the command line."""
    parser, one, _ = two_steps(__doc__, robots, "fit", fit)
    one.add_argument("--first", type=int, default=0, help="of the ensemble, not of the draw")
    one.add_argument("--to", type=int, required=True)
    one.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    given.step(given)


if __name__ == "__main__":
    main()
