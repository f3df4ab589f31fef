"""How often wear, another floor and nothing are told apart by diagnoses of one robot on two dates.

    python lab/benchmarks/has_it_changed.py robots --seed 71 --to 4 --out FOLDER [--workers 2]
    python lab/benchmarks/has_it_changed.py score FOLDER

A robot of the withheld simulator, with errors and faults of the calibrating catalogue, is diagnosed against its nominal
model. Then it comes back three times, and is diagnosed against its corrected model: as it was, with one worn joint, and
on another floor. Robots take turns with the kinds of wear and floor; sizes are drawn. What is there is not done again.
"""

from __future__ import annotations

import json
import tempfile
from argparse import Namespace
from pathlib import Path
from typing import Final

import numpy as np
from many_robots import make_all, two_steps

from diagnosis.report.drift import drift_of, significant
from diagnosis.report.history import Dated
from diagnosis.session import DiagnosisProgress, DiagnosisRequest, run_session
from spot_model.io.model_file import load_model, save_model
from spot_model.policy.built_in import policy_file
from spot_model.policy.policy import load_policy
from spot_model.robot.facts import JOINT_NAMES
from withheld.cases import ordinary_sequences
from withheld.plan import Fault, FaultRequest, RecordingPlan
from withheld.realities.source import source_of

POLICY: Final = policy_file("walk")
WEAR: Final = ("lugre_friction", "flux_change", "loose_teeth", "gear_loss")
FLOOR: Final = ("soft_ground", "slippery_ground")
SIZES: Final = (0.5, 1.0)
REPEATS: Final = 3
SECONDS: Final = 5.0
FIRST: Final = "2026-11-05"
AGAIN: Final = {"nothing": "2026-11-12", "wear": "2026-11-19", "floor": "2026-11-26"}


def requests_of(seed: int, number: int) -> dict[str, tuple[FaultRequest, ...]]:
    """What each kind of second date asks for."""
    wear, floor = (float(size) for size in np.random.default_rng([seed, number]).uniform(*SIZES, 2))
    return {
        "nothing": (),
        "wear": (FaultRequest(kind=WEAR[number % len(WEAR)], place="joint", size=wear),),
        "floor": (FaultRequest(kind=FLOOR[number % len(FLOOR)], place="all", size=floor),),
    }


def robot(seed: int, number: int, out: Path) -> str:
    """Record and diagnose one robot on all dates; returns a line to print."""
    home, source = out / f"{seed}-{number:03d}", source_of("calibrating")
    rng = np.random.default_rng([seed, number, 1])
    sequences = ordinary_sequences(load_policy(POLICY).contract, rng, SECONDS)
    asked: dict[str, tuple[FaultRequest, ...]] = {"first": (), **requests_of(seed, number)}
    for k, (kind, requests) in enumerate(asked.items()):
        place = home / (FIRST if kind == "first" else AGAIN[kind])
        if (place / "truth.json").exists():
            continue
        reality = source.make(requests, 1000 * seed + number)
        home.mkdir(parents=True, exist_ok=True)
        if not (home / "nominal.yaml").exists():
            save_model(reality.nominal, home / "nominal.yaml")
        nominal, since = (
            (home / "nominal.yaml", "") if kind == "first" else (home / FIRST / "corrected_model.yaml", FIRST)
        )
        with tempfile.TemporaryDirectory() as logs:
            reality.record(RecordingPlan(POLICY, sequences, REPEATS, 100 * number + k), Path(logs))
            inputs = DiagnosisRequest(logs=(logs,), nominal=str(nominal), policy=str(POLICY), since=since)
            run_session(inputs, place, DiagnosisProgress(), seed=k)
        faults = [fault.model_dump(mode="json") for fault in reality.truth.faults]
        (place / "truth.json").write_text(json.dumps(faults))
    return f"{home.name}: done"


def robots(given: Namespace) -> None:
    """Make what is missing."""
    make_all(robot, [(given.seed, n, given.out) for n in range(given.to)], given.workers)


def score(given: Namespace) -> None:
    """Print what was said of each second date, and how often it was right."""
    right: dict[str, list[bool]] = {}
    for home in sorted(p for p in given.folder.iterdir() if p.is_dir()):
        if not (home / FIRST / "truth.json").exists():
            continue
        first = dated(home / FIRST)
        for kind, name in AGAIN.items():
            if (home / name / "truth.json").exists():
                again = dated(home / name)
                faults = [Fault.model_validate(f) for f in json.loads((home / name / "truth.json").read_text())]
                drift = drift_of((first, again))
                changed = {m.key[0] for m in significant(*drift.rows)}
                ok, told = is_right(again, faults, drift.outcome, changed), " ".join(drift.since_last)
                right.setdefault(kind, []).append(ok)
                was = f"{faults[0].kind} {faults[0].size:.2f} {' '.join(faults[0].joints)[:12]}" if faults else "-"
                print(f"{home.name} {kind:8} {'right' if ok else 'WRONG'}  {was:36} {told}")
    print("; ".join(f"{kind}: {sum(found)} of {len(found)} right" for kind, found in right.items()))


def dated(folder: Path) -> Dated:
    """A diagnosis of a robot."""
    from diagnosis.document import load_verdict

    return Dated(folder, load_verdict(folder / "verdict.json"), load_model(str(folder / "corrected_model.yaml")))


def is_right(again: Dated, faults: list[Fault], told: str, moved: set[str]) -> bool:
    """Whether what was there is told, itself or in its group and at its joints, and nothing where nothing was.

    Of a floor its number may have ``moved`` beyond the intervals, without a difference that is named.
    """
    named = again.verdict.differences
    if not faults:
        return told == "unchanged"
    names, joints = set(faults[0].names), set(faults[0].joints)
    is_floor = len(joints) == len(JOINT_NAMES)
    if not named:
        return is_floor and bool(names & moved)
    return len(named) == 1 and all(names & set(d.group) and (is_floor or joints & set(d.joints)) for d in named)


def main() -> None:
    """Read the command line."""
    parser, one, _ = two_steps(__doc__, robots, "score", score)
    one.add_argument("--to", type=int, required=True, help="robots")
    one.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    given.step(given)


if __name__ == "__main__":
    main()
