"""Learns what robots without a fault look like to the diagnosis, and writes ``diagnosis/selection/faultless.json``.

    python lab/benchmarks/calibrate_diagnosis.py robots --seed 501 --to 320 --closed 64 --out FOLDER [--workers 2]
    python lab/benchmarks/calibrate_diagnosis.py fit FOLDER...

``robots`` draws cases as the withheld check does, but of its calibrating catalogue and without a fault; ordinary errors
are 0.5 to 5 times the usual. Of each robot it keeps what every effect would add, and what is left in each channel; of
the first ``--closed`` also what the corrected model leaves of each gap in closed loop. One robot is one file;
``robots`` can be interrupted and goes on, and ``--first`` and ``--to`` divide an ensemble between machines.
"""

from __future__ import annotations

import json
import tempfile
import time
from argparse import Namespace
from collections.abc import Iterator, Sequence
from itertools import count, islice
from pathlib import Path
from typing import Any, Final

import numpy as np
from many_robots import make_all, two_steps

from diagnosis.decision_constants import LEAST_NATS
from diagnosis.library.registry import LIBRARY
from diagnosis.read.prepare import prepared
from diagnosis.read.robot_file import SPOT
from diagnosis.selection import faultless
from diagnosis.selection.faultless import FAULTLESS, Faultless, Tail
from diagnosis.selection.normal_equations import one_thread
from diagnosis.verdict.diagnose import diagnose_runs
from diagnosis.verdict.explanation import weigh
from diagnosis.verdict.left_over import left_over
from spot_log.read.run import Run
from spot_model.policy.built_in import FOLDER
from spot_model.policy.policy import load_policy
from withheld.cases import Case, draw, kind_of
from withheld.measuring import record_runs
from withheld.plan import Reality, RecordingPlan
from withheld.realities.source import Source, source_of
from withheld.simulator.simulation import RealityDivergedError

FALSE_ALARMS: Final = 0.05
"""Share of faultless robots on which any of the library's effects may be named."""
LEAST_ROBOTS: Final = 20
LEAST_BEYOND: Final = 0.05
"""No tail falls off faster than this: a few robots do not prove one."""


def faultless_cases(seed: int) -> Iterator[int]:
    """Numbers of the cases without a fault of an endless draw."""
    return (n for n in count() if kind_of(seed, n) == "faultless")


def robot(seed: int, number: int, is_closed: bool, out: Path, until_s: float) -> str:
    """Simulate and explain one robot, and write what it looks like; returns a line to print."""
    file = out / f"{seed}-{number:05d}.json"
    if file.exists():
        return f"{number}: there"
    if time.monotonic() > until_s:
        return f"{number}: left for another time"
    began_s, source = time.process_time(), source_of("calibrating")
    case = draw(seed, number, source, FOLDER)
    try:
        reality, runs = recorded(case, source)
    except RealityDivergedError:
        return f"{number}: its simulation broke down"
    policy = load_policy(FOLDER / f"{case.policy}.onnx")
    with one_thread():
        found = weigh(runs, reality.nominal, policy, LIBRARY, lambda _: None)
    kept: dict[str, Any] = {
        "error_scale": reality.truth.error_scale,
        "policy": case.policy,
        "gains": {(name := s.terms[-1].effect.name): s.value + FAULTLESS.price(name) for s in found.selection.first},
        "named": dict(found.selection.gains),
        "left": left_over(found.board, found.selection.best),
    }
    if is_closed:
        rng = np.random.default_rng(case.diagnosis_seed)
        verdict = diagnose_runs(runs, reality.nominal, policy, rng, lambda _: None).verdict
        kept["gaps"] = {g.gap: float(np.log(g.left / g.floor)) for g in verdict.remainder if g.floor > 0.0}
    file.write_text(json.dumps(kept))
    return f"{number}: {time.process_time() - began_s:.0f} core-seconds"


def recorded(case: Case, source: Source) -> tuple[Reality, list[Run]]:
    """A case's robot, and its logs as a diagnosis reads them.

    Raises:
        RealityDivergedError: Its simulation broke down.
    """
    path = FOLDER / f"{case.policy}.onnx"
    plan = RecordingPlan(path, case.sequences, case.repeats, case.recording_seed, frozenset(case.missing), case.detail)
    with tempfile.TemporaryDirectory() as folder:
        reality = source.make(case.requests, case.reality_seed)
        logs = record_runs(reality, plan, Path(folder))
        runs, _ = prepared(sorted(logs, key=lambda run: str(run.path)), SPOT)
    return reality, list(runs)


def tail_of(values: Sequence[float]) -> Tail:
    """Median, upper tenth, and how that falls off."""
    v = np.asarray(values)
    tenth = float(np.quantile(v, 0.9))
    beyond = float(np.mean(v[v > tenth] - tenth)) if (v > tenth).any() else 0.0
    return Tail(median=float(np.median(v)), tenth=tenth, beyond=max(beyond, LEAST_BEYOND))


def fit(given: Namespace) -> None:
    """Write the file, and print it."""
    rows = [json.loads(path.read_text()) for path in sorted(given.folder.rglob("*.json"))]
    if len(rows) < LEAST_ROBOTS:
        raise SystemExit(f"{len(rows)} robots are too few; make more of them")
    gains: dict[str, list[float]] = {}
    left: dict[str, list[float]] = {}
    for row in rows:
        for kept, found in ((gains, row["gains"]), (left, row["left"] | row.get("gaps", {}))):
            for name, value in found.items():
                kept.setdefault(name, []).append(value)
    share = FALSE_ALARMS / len(LIBRARY)
    known = Faultless(
        robots=len(rows),
        command="python lab/benchmarks/calibrate_diagnosis.py robots, fit",
        gains={name: round(g, 2) for name, own in sorted(gains.items()) if (g := tail_of(own).at(share)) > LEAST_NATS},
        left={name: tail_of(own) for name, own in sorted(left.items()) if len(own) >= LEAST_ROBOTS},
    )
    text = known.model_dump_json(indent=1) + "\n"
    given.to.write_text(text, encoding="utf-8")
    print(text, f"{len(rows)} robots, {sum('gaps' in r for r in rows)} of them in closed loop", sep="")
    print("named on", sum(bool(r["named"]) for r in rows), "before what is learned is taken off")
    for gap in ("torque", "joint motion", "body motion"):
        own = np.exp([r["gaps"][gap] for r in rows if gap in r.get("gaps", {})])
        if len(own):
            print(f"{gap}: {np.median(own):.2f} times what repeats explain, {np.quantile(own, 0.95):.2f} in 95 of 100")


def robots(given: Namespace) -> None:
    """Make what is missing."""
    given.out.mkdir(parents=True, exist_ok=True)
    until_s = time.monotonic() + given.until
    numbers = enumerate(islice(faultless_cases(given.seed), given.to))
    jobs = [(given.seed, n, k < given.closed, given.out, until_s) for k, n in numbers if k >= given.first]
    make_all(robot, jobs, given.workers)


def main() -> None:
    """Read the command line."""
    parser, one, two = two_steps(__doc__, robots, "fit", fit)
    one.add_argument("--first", type=int, default=0, help="of the ensemble, not of the draw")
    one.add_argument("--to", type=int, required=True)
    one.add_argument("--closed", type=int, default=0, help="so many of them in closed loop, too")
    one.add_argument("--workers", type=int, default=2)
    two.add_argument("--to", type=Path, default=Path(faultless.__file__).with_name("faultless.json"))
    given = parser.parse_args()
    given.step(given)


if __name__ == "__main__":
    main()
