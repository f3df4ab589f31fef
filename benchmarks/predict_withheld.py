"""Predict the top speed of withheld robots from logs at up to 4 m/s, then run them and compare.

    python benchmarks/predict_withheld.py robots --seed 51 --count 8 --out DIR [--slowed 0.3] [--workers 2]
    python benchmarks/predict_withheld.py score DIR

Each robot has ordinary errors and surroundings of its own and one fault of the catalogue, drawn as the withheld check
draws single faults. A ramp to ``--speed`` is recorded by the same robot without the fault; with ``--slowed``, robots
that the fault slows by less are left out. Three logs of 8 s, ramps to 2, 3 and 4 m/s, are diagnosed against the judge's
nominal model; then the ramp to ``--speed`` is predicted, recorded, and compared with the prediction. It can be
interrupted, and goes on.
"""

from __future__ import annotations

import json
import shutil
import time
from argparse import Namespace
from collections.abc import Sequence
from itertools import count, islice
from pathlib import Path
from typing import Any, Final

import numpy as np
from many_robots import make_all, two_steps

from diagnosis.closed_loop.run_numbers import run_numbers
from diagnosis.next.prediction import load_prediction, with_log
from diagnosis.next.session import Session, diagnosed
from diagnosis.session import Inputs
from spot_log import read_run
from spot_model.errors import SpotRlError
from spot_model.io.model_file import save_model
from spot_model.io.velocity_sequence import VelocitySequence, save_sequence, sequence_of
from spot_model.policy.built_in import policy_file
from withheld.cases import draw, kind_of
from withheld.plan import Reality, RecordingPlan
from withheld.realities.source import CATALOGUES, source_of
from withheld.scoring.statistics import Estimate, Share
from withheld.simulator.simulation import RealityDivergedError

SLOW_M_S: Final = (2.0, 3.0, 4.0)
WANTED_M_S: Final = 0.15
SLOWED_M_S: Final = 0.3


def ramp(speed_m_s: float) -> VelocitySequence:
    """Up to a speed in 4 s, held for 3 s, and down."""
    points = ((0.0, 0.0), (0.5, 0.0), (4.0, speed_m_s), (7.0, speed_m_s), (8.0, 0.0))
    return sequence_of(f"ramp_{speed_m_s:g}", 8.0, *points, is_ramped=True)


def top_speed(reality: Reality, plan: RecordingPlan, folder: Path) -> float:
    """Record one run; its top speed, m/s."""
    reality.record(plan, folder)
    (log,) = folder.glob("*.mcap")
    return run_numbers(read_run(log))["top_speed"]


def robot(number: int, given: Namespace, late_s: float) -> str:
    """Record, diagnose, predict, record, compare; a line to print."""
    out = given.out / f"{given.seed}-{number:04d}"
    file = out.with_suffix(".json")
    if file.exists() or time.monotonic() > late_s:
        return f"{number}: {'there' if file.exists() else 'left for another time'}"
    shutil.rmtree(out, ignore_errors=True)  # of an interrupted start
    out.mkdir(parents=True)
    began_s = time.monotonic()
    case = draw(given.seed, number, source_of(given.catalogue), given.policy.parent)
    reality, healthy = (source_of(given.catalogue).make(own, case.reality_seed) for own in (case.requests, ()))
    save_model(reality.nominal, out / "nominal.yaml")
    fast = ramp(given.speed)
    kept: dict[str, Any] = {"number": number, "kind": case.requests[0].kind, "error_scale": reality.truth.error_scale}
    try:
        again = RecordingPlan(given.policy, (fast,), 1, case.recording_seed + 1)
        kept["without"] = top_speed(healthy, again, out / "without")
        kept["with"] = top_speed(reality, again, out / "fast")
        if not kept["without"] - kept["with"] >= given.slowed:
            file.write_text(json.dumps(kept | {"left_out": True}, indent=1))
            return f"{number}: {kept['kind']} slows by less"
        plan = RecordingPlan(given.policy, tuple(map(ramp, SLOW_M_S)), 1, case.recording_seed)
        reality.record(plan, out / "logs")
        logs = tuple(str(p.absolute()) for p in sorted((out / "logs").glob("*.mcap")))
        inputs = Inputs(logs=logs, nominal=str(out / "nominal.yaml"), policy=str(given.policy.absolute()))
        kept["verdict"] = diagnosed(inputs, (), out / "found").sentence
        session = Session.opened(out / "found", [], None, None, case.diagnosis_seed)
        save_sequence(fast, out / "fast.yaml")
        session.predicted(str(out / "fast.yaml"), None, out / "prediction.json")
        (log,) = (out / "fast").glob("*.mcap")
        made = with_log(load_prediction(out / "prediction.json"), read_run(log))
        lines = made.lines()
        kept["numbers"] = {
            f.name: (f.value, f.low, f.high, f.measured) for f in made.forecasts if f.measured is not None
        }
    except (RealityDivergedError, SpotRlError) as error:
        kept["error"], lines = str(error), [str(error)]
    file.write_text(json.dumps(kept, indent=1))
    return "\n".join([f"{number}: {kept['kind']}, {time.monotonic() - began_s:.0f} s", *lines])


def robots(given: Namespace) -> None:
    """Make what is missing."""
    given.out.mkdir(parents=True, exist_ok=True)
    late_s = time.monotonic() + given.until
    numbers = list(islice((n for n in count() if kind_of(given.seed, n) in given.kinds), given.count))
    make_all(robot, [(n, given, late_s) for n in numbers], given.workers)


def score(given: Namespace) -> None:
    """Print how far top speeds were off, and how many intervals held."""
    rows = [json.loads(path.read_text()) for path in sorted(given.folder.glob("*.json"))]
    made = [row for row in rows if "numbers" in row]
    for row in made:
        slows = row["without"] - row["with"]
        print(f"{row['number']:4d} {row['kind']:22s} slows by {slows:.2f} m/s: {row['verdict']}")
        for name, (value, low, high, measured) in row["numbers"].items():
            held = "held" if low <= measured <= high else "did not hold"
            print(f"     {name:24s} {value:7.2f} ({low:.2f} to {high:.2f}), measured {measured:.2f}: {held}")
    for row in (row for row in rows if "error" in row):
        print(f"{row['number']:4d} {row['kind']:22s} {row['error']}")
    slowed = [row for row in made if row["without"] - row["with"] >= SLOWED_M_S]
    print(f"{len(rows)} robots, {len(made)} predicted, {sum('error' in row for row in rows)} with an error")
    for words, some in (("all", made), (f"slowed by {SLOWED_M_S} m/s or more", slowed)):
        print(f"{words}: {len(some)}")
        if some:
            _print_errors(some)


def _print_errors(some: Sequence[dict[str, Any]]) -> None:
    off = np.array([row["numbers"]["top_speed"][0] - row["numbers"]["top_speed"][3] for row in some])
    print(f"  top speed within {WANTED_M_S} m/s: {Share.of([*(np.abs(off) <= WANTED_M_S)])}")
    root = Estimate.of([(v,) for v in off], lambda v: float(np.sqrt(np.mean(v**2))))
    print(f"  root mean square {root} m/s, mean {off.mean():+.3f} m/s, largest {np.abs(off).max():.2f} m/s")
    for name in dict.fromkeys(n for row in some for n in row["numbers"]):
        told = [row["numbers"][name] for row in some if name in row["numbers"]]
        held = [low <= measured <= high for _, low, high, measured in told]
        print(f"  {name}: interval held for {Share.of(held)}")


def main() -> None:
    """Read the command line."""
    parser, one, _ = two_steps(__doc__, robots, "score", score)
    one.add_argument("--policy", type=policy_file, default="fast")
    one.add_argument("--catalogue", choices=CATALOGUES, default="judging")
    one.add_argument("--kinds", nargs="+", default=["single"], help="of cases")
    one.add_argument("--count", type=int, required=True, help="robots to draw")
    one.add_argument("--slowed", type=float, default=-np.inf, help="leave out robots that slow by less, m/s")
    one.add_argument("--workers", type=int, default=1, help="processes, each on one core")
    one.add_argument("--speed", type=float, default=5.0)
    given = parser.parse_args()
    given.step(given)


if __name__ == "__main__":
    main()
