"""Predict the top speed of withheld robots from logs at up to 4 m/s, then run them and compare.

    python benchmarks/predict_withheld.py robots --seed 51 --count 8 --out DIR [--catalogue calibrating] [--until 600]
    python benchmarks/predict_withheld.py score DIR

Each robot has ordinary errors and surroundings of its own and one fault of the catalogue, drawn as the withheld check
draws single faults. Three logs of 8 s, ramps to 2, 3 and 4 m/s, are diagnosed against the judge's nominal model; then a
ramp to ``--speed`` is predicted, recorded, and compared with the prediction. It can be interrupted, and goes on.
"""

from __future__ import annotations

import json
import shutil
import time
from argparse import Namespace
from itertools import count, islice
from typing import Any, Final

import numpy as np
from calibrate_diagnosis import two_steps

from diagnosis.next.prediction import load_prediction, with_log
from diagnosis.next.session import Session, diagnosed
from diagnosis.session import Inputs
from spot_log import read_run
from spot_model.errors import SpotRlError
from spot_model.io.model_file import save_model
from spot_model.io.velocity_sequence import VelocitySequence, save_sequence, sequence_of
from spot_model.policy.built_in import policy_file
from withheld.cases import draw, kind_of
from withheld.plan import RecordingPlan
from withheld.realities.source import source_of

SLOW_M_S: Final = (2.0, 3.0, 4.0)
WANTED_M_S: Final = 0.15


def ramp(speed_m_s: float) -> VelocitySequence:
    """Up to a speed in 4 s, held for 3 s, and down."""
    points = ((0.0, 0.0), (0.5, 0.0), (4.0, speed_m_s), (7.0, speed_m_s), (8.0, 0.0))
    return sequence_of(f"ramp_{speed_m_s:g}", 8.0, *points, is_ramped=True)


def robot(number: int, given: Namespace) -> str:
    """Record, diagnose, predict, record, compare; a line to print."""
    out = given.out / f"{given.seed}-{number:04d}"
    file = out.with_suffix(".json")
    if file.exists():
        return f"{number}: there"
    shutil.rmtree(out, ignore_errors=True)  # of an interrupted start
    out.mkdir(parents=True)
    began_s = time.monotonic()
    case = draw(given.seed, number, source_of(given.catalogue), given.policy.parent)
    reality = source_of(given.catalogue).make(case.requests, case.reality_seed)
    save_model(reality.nominal, out / "nominal.yaml")
    fast = ramp(given.speed)
    kept: dict[str, Any] = {"number": number, "kind": case.requests[0].kind, "error_scale": reality.truth.error_scale}
    try:
        plan = RecordingPlan(given.policy, tuple(map(ramp, SLOW_M_S)), 1, case.recording_seed)
        reality.record(plan, out / "logs")
        logs = tuple(str(p.absolute()) for p in sorted((out / "logs").glob("*.mcap")))
        inputs = Inputs(logs=logs, nominal=str(out / "nominal.yaml"), policy=str(given.policy.absolute()))
        kept["verdict"] = diagnosed(inputs, (), out / "found").sentence
        session = Session.opened(out / "found", [], None, None, case.diagnosis_seed)
        save_sequence(fast, out / "fast.yaml")
        session.predicted(str(out / "fast.yaml"), None, out / "prediction.json")
        reality.record(RecordingPlan(given.policy, (fast,), 1, case.recording_seed + 1), out / "fast")
        (log,) = (out / "fast").glob("*.mcap")
        made = with_log(load_prediction(out / "prediction.json"), read_run(log))
        lines = made.lines()
        kept["numbers"] = {
            f.name: (f.value, f.low, f.high, f.measured) for f in made.forecasts if f.measured is not None
        }
    except SpotRlError as error:
        kept["error"], lines = str(error), [str(error)]
    file.write_text(json.dumps(kept, indent=1))
    return "\n".join([f"{number}: {kept['kind']}, {time.monotonic() - began_s:.0f} s", *lines])


def robots(given: Namespace) -> None:
    """Make what is missing."""
    given.out.mkdir(parents=True, exist_ok=True)
    began_s = time.monotonic()
    for number in islice((n for n in count() if kind_of(given.seed, n) == "single"), given.count):
        if time.monotonic() - began_s < given.until:
            print(robot(number, given), flush=True)


def score(given: Namespace) -> None:
    """Print how far top speeds were off, and how many intervals held."""
    rows = [json.loads(path.read_text()) for path in sorted(given.folder.glob("*.json"))]
    for row in rows:
        print(f"{row['number']:4d} {row['kind']:22s} {row.get('error') or row['verdict']}")
        for name, (value, low, high, measured) in row.get("numbers", {}).items():
            held = "held" if low <= measured <= high else "did not hold"
            print(f"     {name:24s} {value:7.2f} ({low:.2f} to {high:.2f}), measured {measured:.2f}: {held}")
    made = [row["numbers"] for row in rows if "numbers" in row]
    off = np.array([own["top_speed"][0] - own["top_speed"][3] for own in made])
    print(f"top speed within {WANTED_M_S} m/s: {np.sum(np.abs(off) <= WANTED_M_S)} of {len(off)}")
    print(f"root mean square {np.sqrt(np.mean(off**2)):.3f} m/s, mean {off.mean():+.3f} m/s")
    for name in dict.fromkeys(n for own in made for n in own):
        own = [o[name] for o in made if name in o]
        print(f"{name}: interval held for {sum(low <= m <= high for _, low, high, m in own)} of {len(own)}")


def main() -> None:
    """Read the command line."""
    parser, one = two_steps(__doc__, robots, "score", score)
    one.add_argument("--policy", type=policy_file, default="fast")
    one.add_argument("--catalogue", default="calibrating")
    one.add_argument("--count", type=int, required=True)
    one.add_argument("--speed", type=float, default=5.0)
    given = parser.parse_args()
    given.step(given)


if __name__ == "__main__":
    main()
