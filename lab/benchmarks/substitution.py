"""Which part of a faultless robot keeps its corrected model at a distance: the truth is put into it part by part.

    python lab/benchmarks/substitution.py robots --seed 777301 --to 10 --out FOLDER
    python lab/benchmarks/substitution.py table FOLDER

``robots`` draws faultless robots of the calibrating catalogue that repeat themselves, fits what a diagnosis fits, and
simulates the corrected model as it is, with the truth in place of one part after another, and with all of it. It also
takes parts away from the truth: the robot itself is simulated again, as it is, and with one part as models have it. A
robot is one file, and what is there already is not made again. ``table`` prints what is left of the three gaps and of
the headline distance, in floors: medians over the robots, and of the corrected model where 95 of 100 lie, too.
"""

from __future__ import annotations

import json
import tempfile
import time
from argparse import Namespace
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from itertools import count, islice
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

import numpy as np
from calibrate_diagnosis import recorded
from many_robots import make_all, two_steps
from true_parts import AWAY, Change, Part, true_parts

from diagnosis.closed_loop import simulation
from diagnosis.closed_loop.consequences import Outcomes
from diagnosis.closed_loop.simulation import rollouts_under, run_all
from diagnosis.closed_loop.trials import Bench, Trials, compared_by_sequence, run_trials
from diagnosis.library.registry import LIBRARY
from diagnosis.read.prepare import prepared
from diagnosis.read.robot_file import SPOT
from diagnosis.selection.normal_equations import one_thread
from diagnosis.selection.robot_models import corrected_model
from diagnosis.selection.scoring import crossed, null_of
from diagnosis.verdict.explanation import evidence_of
from spot_log.read.run import Run
from spot_model.policy.built_in import FOLDER
from spot_model.policy.policy import Policy, load_policy
from trainer.signals.policy_ticks import policy_ticks
from withheld.cases import Case, draw, kind_of
from withheld.measuring import record_runs
from withheld.plan import RecordingPlan
from withheld.realities.reality import ComposedReality
from withheld.realities.source import source_of
from withheld.simulator.robot import Robot

CORRECTED: Final = "the corrected model"
SUBSTEPS: Final = 6
"""Physics steps between two states where the truth's are put in."""
COLUMNS: Final = ("torque", "joint motion", "body motion", "headline")
FIRST_TICKS: Final = 50
"""Ticks of the first second."""
FEW: Final = 2
"""Runs of each sequence by a model with the truth of a part, and by the robot that is simulated again."""


# One robot ------------------------------------------------------------------------------------------------------------


def ensemble(seed: int) -> Iterator[tuple[int, Case]]:
    """Faultless cases that repeat themselves, with their numbers in an endless draw."""
    source = source_of("calibrating")
    for number in count():
        if kind_of(seed, number) == "faultless":
            case = draw(seed, number, source, FOLDER)
            if case.repeats > 1 and case.detail == "stream":
                yield number, case


def robot(seed: int, number: int, out: Path) -> str:
    """Measure one robot, and write what was measured; returns a line to print."""
    file = out / f"{seed}-{number:04d}.json"
    if file.exists():
        return f"{number}: there"
    began_s, source = time.process_time(), source_of("calibrating")
    case = draw(seed, number, source, FOLDER)
    policy = load_policy(FOLDER / f"{case.policy}.onnx")
    reality, runs = recorded(case, source)
    if not isinstance(reality, ComposedReality):
        raise TypeError("the catalogue's realities are composed of parts")
    with one_thread():
        told = measured(case, reality, runs, policy)
    told = {"policy": case.policy, "error_scale": reality.truth.error_scale, **told}
    file.write_text(json.dumps(told))
    return f"{number}: {case.policy}, {time.process_time() - began_s:.0f} core-seconds"


def measured(case: Case, reality: ComposedReality, runs: Sequence[Run], policy: Policy) -> dict[str, Any]:
    """What every model leaves, by table and row."""
    _, _, _, board = evidence_of(runs, reality.nominal, policy, LIBRARY)
    scored = crossed(board, null_of(board))
    bench = Bench.of(runs, policy, rollouts_under(policy))
    if bench is None:
        raise ValueError(f"case {case.number}: its logs are too short")
    rng = np.random.default_rng(case.diagnosis_seed)
    trials = run_trials(bench, reality.nominal, board, {CORRECTED: scored}, CORRECTED, rng)
    names, around = bench.sequences, trials.surroundings.by_sequence
    fitted = {s: around[s].around(corrected_model(reality.nominal, board, scored, k)) for k, s in enumerate(names)}
    parts = true_parts(reality.robot(), reality.settings)
    few = [s for n in names for s in [s for s in bench.scripts if s.sequence == n][:FEW]]

    def simulated(*some: Part) -> list[Run]:
        models = dict(fitted)
        for part in some:
            models = {s: part.put_into(model) for s, model in models.items()}
        jobs = [(models[script.sequence], script) for script in few]
        return run_all(jobs, bench.engine, np.random.default_rng(case.diagnosis_seed), lambda _: None)

    into = {"nominal": left(bench, trials.runs["nominal"]), CORRECTED: left(bench, trials.runs[CORRECTED])}
    into |= {name: left(bench, simulated(part)) for name, part in parts.items()}
    around_it = [
        parts[name]
        for name in (
            "stiffness and damping of the ground",
            "friction of the ground, stiffness of friction",
            "estimator",
        )
    ]
    into["ground and estimator"] = left(bench, simulated(*around_it))
    of_drives = [
        parts[name] for name in ("masses, their centres, inertias", "gains and motor constants", "friction and rotors")
    ]
    into["masses, gains, friction and rotors"] = left(bench, simulated(*of_drives))
    with ExitStack() as changed:
        changed.enter_context(patch.object(simulation, "SUBSTEPS", SUBSTEPS))
        into["physics step"] = left(bench, simulated())
        into["all of these"] = left(bench, simulated(*parts.values()))
    late = replace(bench, runs=tuple(map(_later, bench.runs)))
    into["the first second left out"] = left(late, list(map(_later, trials.runs[CORRECTED])))
    away = {name: left(bench, again(case, reality, change)) for name, change in AWAY.items()}
    return {"into": into, "away": away}


def left(bench: Bench, runs: Sequence[Run]) -> dict[str, float]:
    """What some runs leave of each gap, in floors, and the headline distance."""
    made = {CORRECTED: list(runs)}
    compared, _ = compared_by_sequence(bench, made)
    trials = Trials(bench, made, tuple(compared), is_crossed=False, notes=())
    gaps = {str(gap.gap): gap.ratio for gap in Outcomes.of(trials).remainder(CORRECTED) if gap.ratio is not None}
    return gaps | {"headline": trials.distances()[CORRECTED]}


def again(case: Case, reality: ComposedReality, change: Change) -> list[Run]:
    """Other runs of the robot, with a part of it changed."""

    def install(robot: Robot) -> dict[str, float]:
        change(robot, reality.settings)
        return {}

    settings = change(Robot(), reality.settings)
    other = replace(reality, installs=(*reality.installs, install), settings=settings)
    path = FOLDER / f"{case.policy}.onnx"
    plan = RecordingPlan(path, case.sequences, FEW, case.recording_seed + 1, frozenset(case.missing), case.detail)
    with tempfile.TemporaryDirectory() as folder:
        logs = record_runs(other, plan, Path(folder) / "logs")
        return list(prepared(sorted(logs, key=lambda run: str(run.path)), SPOT)[0])


def _later(run: Run) -> Run:
    """Without the first second under the policy."""
    return replace(run, ticks=run.ticks.rows(policy_ticks(run, at_least=1)[FIRST_TICKS:]))


# The command line -----------------------------------------------------------------------------------------------------


def robots(given: Namespace) -> None:
    """Make what is missing."""
    given.out.mkdir(parents=True, exist_ok=True)
    numbers = [number for number, _ in islice(ensemble(given.seed), given.to)]
    make_all(robot, [(given.seed, number, given.out) for number in numbers], given.workers)


def table(given: Namespace) -> None:
    """Print both tables in Markdown."""
    told = [json.loads(file.read_text()) for file in sorted(given.folder.glob("*.json"))]
    scales, policies = [one["error_scale"] for one in told], {one["policy"] for one in told}
    words = f"{len(told)} robots under {len(policies)} policies, errors {min(scales):.1f} to {max(scales):.1f} times"
    print(f"{words} the usual: medians, and in brackets where 95 of 100 lie, in times what repeats explain")
    for kind, title in (("into", "with the truth of"), ("away", "the robot again, without its own")):
        print(f"\n| {title} | {' | '.join(COLUMNS)} |\n|---" + "|---" * len(COLUMNS) + "|")
        for row in told[0].get(kind, {}):
            values = [[one[kind][row][c] for one in told if c in one[kind][row]] for c in COLUMNS]
            cells = [f"{np.median(v):.2f} ({np.quantile(v, 0.95):.2f})" for v in values]
            print(f"| {row} | {' | '.join(cells)} |")


def main() -> None:
    """Read the command line."""
    parser, one, _ = two_steps(__doc__, robots, "table", table)
    one.add_argument("--to", type=int, required=True, help="number of robots")
    one.add_argument("--workers", type=int, default=1)
    given = parser.parse_args()
    given.step(given)


if __name__ == "__main__":
    main()
