"""Robots on slopes, in grass and with tilted units, diagnosed: told apart where the walk turned, grouped where not.

    python lab/benchmarks/ground.py robots --seed 1 --to 24 --out FOLDER [--workers 2]
    python lab/benchmarks/ground.py score FOLDER...

The robots are of the withheld simulator, which shares no code with the effect library. Each has ordinary errors, and
walks straight on or turns, with measured loads or without.
"""

from __future__ import annotations

import json
import tempfile
import time
from argparse import Namespace
from itertools import product
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
from many_robots import make_all, two_steps

from diagnosis.library.registry import LIBRARY
from diagnosis.read.prepare import prepared
from diagnosis.read.robot_file import SPOT
from diagnosis.selection.normal_equations import one_thread
from diagnosis.verdict.belief import decide
from diagnosis.verdict.explanation import weigh
from spot_model.io.velocity_sequence import sequence_of
from spot_model.policy.built_in import FOLDER
from spot_model.policy.policy import load_policy
from withheld.measuring import record_runs
from withheld.plan import FaultRequest, RecordingPlan, Signal
from withheld.realities.fault_kind import BODY, Ask, FaultKind, Parameters
from withheld.realities.reality import make
from withheld.simulator.robot import Robot

WALKS: Final = {
    "straight": sequence_of("straight", 8.0, (0, 0, 0, 0), (0.5, 0.7, 0, 0), (4, 1.0, 0, 0), (7.5, 0, 0, 0)),
    "turning": sequence_of("turning", 8.0, (0, 0, 0, 0), (0.5, 0.5, 0, 0.8), (4, 0.6, 0, 0.8), (7.5, 0, 0, 0)),
}


def slope(robot: Robot, ask: Ask) -> Parameters:
    """A plane that leans, and lies so low that no foot starts within it."""
    angle, uphill = np.radians(ask.rng.uniform(3.0, 6.0)), ask.rng.uniform(-np.pi, np.pi)

    def edit(model: mujoco.MjModel) -> None:
        ground = model.geom("ground").id
        mujoco.mju_axisAngle2Quat(model.geom_quat[ground], np.array([np.sin(uphill), -np.cos(uphill), 0.0]), angle)
        model.geom_pos[ground, 2] = -0.25 * np.tan(angle)

    robot.model_edits.append(edit)
    return {"ground_slope": float(angle)}


def tilt(robot: Robot, ask: Ask) -> Parameters:
    """An inertial unit askew about a level axis."""
    angle, about = np.radians(ask.rng.uniform(3.0, 6.0)), ask.rng.uniform(-np.pi, np.pi)
    robot.sensing.imu_tilt_rpy_rad += angle * np.array([np.cos(about), np.sin(about), 0.0])
    return {"imu_tilt": float(angle)}


def grass(robot: Robot, ask: Ask) -> Parameters:
    """Blades that hold a foot back the more the deeper it is among them."""
    drag, length = ask.rng.uniform(4.0, 15.0), ask.rng.uniform(0.06, 0.2)

    robot.foot_forces.append(
        lambda height_m, velocity: -drag * np.clip(1.5 * (1.0 - height_m / length), 0.0, 1.0)[..., None] * velocity
    )
    return {"foot_drag": float(drag)}


KINDS: Final = {
    "slope": FaultKind("slope", "ground", ("ground_slope",), BODY, slope),
    "tilt": FaultKind("tilt", "sensing", ("imu_tilt",), BODY, tilt),
    "grass": FaultKind("grass", "ground", ("foot_drag",), BODY, grass),
    "nothing": FaultKind("nothing", "ground", (), BODY, lambda *_: {}),
}


def robot(seed: int, kind: str, walk: str, loads: bool, out: Path) -> str:
    """Simulate and diagnose one robot, and write what was found; returns a line to print."""
    began_s, name = time.process_time(), f"{seed}-{kind}-{walk}-{'loads' if loads else 'none'}"
    reality = make([FaultRequest(kind=kind, place="body", size=0.5)], seed, KINDS)
    missing: frozenset[Signal] = frozenset() if loads else frozenset({"load"})
    plan = RecordingPlan(FOLDER / "walk.onnx", (WALKS[walk],), 2, seed, missing)
    with tempfile.TemporaryDirectory() as folder:
        runs, _ = prepared(record_runs(reality, plan, Path(folder)), SPOT)
    with one_thread():
        belief = decide(weigh(runs, reality.nominal, load_policy(plan.policy), LIBRARY, lambda _: None), LIBRARY)
    terms = zip(belief.best.terms, belief.best.coefficients, strict=True)
    found: dict[str, Any] = {
        "truth": dict(reality.truth.faults[0].parameters),
        "there": dict(belief.there),
        "groups": {own: dict(group) for own, group in belief.groups.items()},
        "values": {t.effect.name: dict(t.effect.values(c, t.shape)) for t, c in terms},
    }
    (out / f"{name}.json").write_text(json.dumps(found, default=float))
    return f"{name}: {found['truth']} {found['groups']}, {time.process_time() - began_s:.0f} core-seconds"


def robots(given: Namespace) -> None:
    """Make what is missing."""
    given.out.mkdir(parents=True, exist_ok=True)
    every = list(product(KINDS, WALKS, (True, False)))
    make_all(robot, [(given.seed + k // 16, *every[k % 16], given.out) for k in range(given.to)], given.workers)


def score(given: Namespace) -> None:
    """Count, kind by kind and walk by walk."""
    rows: dict[str, list[str]] = {}
    for path in sorted(given.folder.glob("*.json")):
        found, (_, kind, walk, loads) = json.loads(path.read_text()), path.stem.split("-")
        truth, groups = set(found["truth"]), found["groups"]
        wrong = [group for own, group in groups.items() if own not in truth]
        word = "right" if set(groups) == truth else "missed" if not groups else "wrong name"
        if any(truth & set(group) for group in wrong) or any(len(group) > 1 for group in groups.values()):
            word = "grouped"
        rows.setdefault(f"{kind}, {walk}, {loads}", []).append(word)
    for name, own in rows.items():
        print(f"{name}: " + ", ".join(f"{word} {own.count(word)}" for word in sorted(set(own))))


if __name__ == "__main__":
    parser, one, _ = two_steps(__doc__, robots, "score", score)
    one.add_argument("--to", type=int, default=16, help="number of robots")
    one.add_argument("--workers", type=int, default=1)
    given = parser.parse_args()
    given.step(given)
