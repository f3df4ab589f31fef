"""Predict the top speed of a withheld robot from logs at up to 4 m/s, then run it and compare.

    python benchmarks/predict_withheld.py --policy policies/fast.onnx --out DIR [--seed 1] [--speed 5.0]

The robot is one of the withheld simulator, with ordinary errors and surroundings of its own and no fault. Three logs of
8 s, ramps to 2, 3 and 4 m/s, are diagnosed against the judge's nominal model; then a ramp to ``--speed`` is predicted,
recorded, and compared with the prediction.
"""

from __future__ import annotations

import subprocess
import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from pathlib import Path

from spot_model.io.model_file import save_model
from spot_model.io.velocity_sequence import VelocitySequence, Waypoint, save_sequence
from withheld.plan import RecordingPlan
from withheld.realities.judging.catalogue import CATALOGUE
from withheld.realities.reality import make


def ramp(speed_m_s: float) -> VelocitySequence:
    """Up to a speed in 4 s, held for 3 s, and down."""
    points = ((0.0, 0.0), (0.5, 0.0), (4.0, speed_m_s), (7.0, speed_m_s), (8.0, 0.0))
    waypoints = tuple(Waypoint(time_s=t, v_x_m_s=v, ramp=i > 1) for i, (t, v) in enumerate(points))
    return VelocitySequence(name=f"ramp_{speed_m_s:g}", duration_s=8.0, waypoints=waypoints)


def spot_rl(*words: str) -> None:
    """Run a command, and show what it says."""
    subprocess.run([sys.executable, "-m", "spot_model", *words], check=True)  # noqa: S603 - our own command


def main(arguments: Sequence[str]) -> None:
    """Record, diagnose, predict, record, compare."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--policy", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--speed", type=float, default=5.0)
    given = parser.parse_args(arguments)
    reality = make((), given.seed, CATALOGUE)
    out, found = given.out, given.out / "found"
    out.mkdir(parents=True)
    save_model(reality.nominal, out / "nominal.yaml")
    slow = tuple(ramp(v) for v in (2.0, 3.0, 4.0))
    reality.record(RecordingPlan(given.policy, slow, 1, given.seed), out / "logs")
    spot_rl(
        "diagnose",
        str(out / "logs"),
        "--nominal",
        str(out / "nominal.yaml"),
        "--policy",
        str(given.policy),
        "--out",
        str(found),
    )
    fast = ramp(given.speed)
    save_sequence(fast, out / "fast.yaml")
    spot_rl("diagnose", "predict", str(found), "--sequence", str(out / "fast.yaml"))
    reality.record(RecordingPlan(given.policy, (fast,), 1, given.seed + 1), out / "fast")
    log = next((out / "fast").glob("*.mcap"))
    spot_rl("diagnose", "predict", str(found), "--sequence", str(out / "fast.yaml"), "--log", str(log))


if __name__ == "__main__":
    main(sys.argv[1:])
