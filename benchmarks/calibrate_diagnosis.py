"""What a diagnosis leaves on robots with nothing wrong: the ensemble behind the numbers of ``decision_constants.py``.

    python benchmarks/calibrate_diagnosis.py --policy policies/walk.onnx --out ensemble.jsonl [--robots 20] [--left]

Each robot is the nominal model with ordinary errors drawn from the published ranges, load cells with a lag and a gain
of their own, another ground and another estimator. Printed at the end: quantiles of the distance that models with
fitted ordinary errors keep from it, in floors; and what trees still predict of the residuals, by channel, in nats.
"""

from __future__ import annotations

import json
import sys
import time
from argparse import ArgumentParser
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from diagnosis.closed_loop.engine import LocalEngine
from diagnosis.closed_loop.simulation import SensorNoise, Surroundings, simulate
from diagnosis.closed_loop.trials import Bench, run_trials
from diagnosis.decision_constants import ERROR_SCALES
from diagnosis.library.registry import LIBRARY
from diagnosis.read.policy_ticks import Script, script_of
from diagnosis.selection.nuisance import ErrorKind, error_sets
from diagnosis.selection.nuisance_model import with_kind
from diagnosis.selection.places import Robot
from diagnosis.selection.scoring import null_of
from diagnosis.selection.search import Selection
from diagnosis.verdict.explain import Explained, evidence_of
from spot_log.read.run import Run
from spot_model.effects.command.command_delay import CommandDelay
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy, load_policy
from spot_model.robot import facts
from trainer.sysid.simulation.rollout import StartState

NOMINAL = RobotModel((CommandDelay(delay_s=0.005),))
SECONDS, REPEATS = 5.0, 3
COMMANDS = {
    "straight": ((0.0, 0.0, 0.0, 0.0), (0.2, 0.7, 0.0, 0.0), (0.6, 1.2, 0.0, 0.0), (1.0, 0.4, 0.0, 0.0)),
    "curves": ((0.0, 0.0, 0.0, 0.0), (0.2, 0.6, 0.0, 0.6), (0.6, 0.6, 0.0, -0.6), (1.0, 0.5, 0.0, 0.0)),
    "aside": ((0.0, 0.0, 0.0, 0.0), (0.2, 0.4, 0.3, 0.0), (0.6, 0.6, -0.3, 0.0), (1.0, 0.6, 0.0, 0.3)),
}
ROBOT = Robot(facts.JOINT_NAMES, np.repeat(np.arange(facts.N_LEGS), 3))


def drawn(rng: np.random.Generator) -> RobotModel:
    """The nominal model with ordinary errors."""
    model = NOMINAL
    for name, given in ERROR_SCALES.items():
        if not given.acts_in_closed_loop:
            continue
        effect = LIBRARY[name]
        scale = np.array([given.scales.get(c.name, 0.0) for c in effect.coefficients])
        chosen, sets = np.flatnonzero(scale > 0.0), error_sets(ROBOT, effect)
        kind = ErrorKind(effect, given.at, 0, tuple(sets), chosen)
        size = np.array([scale[k] * (given.alike if s.sum() > 1 else 1.0) for s in sets for k in chosen])
        model = with_kind(model, ROBOT, kind, kind.coefficients(size * rng.standard_normal(len(size))))
    return model


def logs_of(model: RobotModel, policy: Policy, rng: np.random.Generator) -> list[Run]:
    """Runs of a robot on a ground of its own, by load cells of its own."""
    at = np.linspace(0.0, 1.0, round(SECONDS * facts.POLICY_RATE_HZ))
    scripts = []
    for name, points in COMMANDS.items():
        p = np.array(points)
        command = np.stack([np.interp(at, p[:, 0], p[:, k]) for k in (1, 2, 3)], axis=1)
        for repeat in range(REPEATS):
            pose = facts.DEFAULT_POSITION_RAD + 0.02 * rng.standard_normal(facts.N_JOINTS)
            still = np.zeros(facts.N_JOINTS)
            upright = np.array([1.0, 0.0, 0.0, 0.0])
            scripts.append(
                Script(name, repeat, StartState(pose, still, upright, np.zeros(3), np.zeros(3), still), command)
            )
    around = Surroundings(rng.uniform(0.008, 0.025), rng.uniform(0.85, 1.2), rng.choice([0.0, 0.05, 0.12]))
    runs = simulate(model, policy, scripts, rng, SensorNoise(), surroundings=[around] * len(scripts))
    lag_s = rng.uniform(0.0, 0.006)
    keep = np.exp(-facts.STATE_PERIOD_NS * 1e-9 / lag_s)
    gain = 1.0 + 0.02 * rng.standard_normal(facts.N_JOINTS)
    out = []
    for run in runs:
        load = lfilter([1.0 - keep], [1.0, -keep], gain * run.states.load_nm, axis=0)
        out.append(replace(run, states=replace(run.states, load_nm=load)))
    return out


def measured(seed: int, policy: Policy, *, has_left: bool) -> dict[str, object]:
    """One robot's distances, and left-overs if asked for: they take as long as all the rest."""
    rng = np.random.default_rng(seed)
    runs = logs_of(drawn(rng), policy, rng)
    stack, views, off, board = evidence_of(runs, NOMINAL, policy, LIBRARY)
    found = Explained(stack, views, off, board, Selection(None, (), (), ()))
    scripts = tuple(s for run in runs if (s := script_of(run)) is not None)
    bench = Bench(tuple(runs), scripts, policy, LocalEngine(policy))
    trials = run_trials(bench, NOMINAL, board, {"errors": null_of(board)}, {}, rng, only_ticks=True)
    nats: dict[str, float] = {}
    if has_left:
        left = found.remainder()
        nats = {c: float(left.nats[[x == c for x in left.channels]].sum()) for c in dict.fromkeys(left.channels)}
    return {"seed": seed, "distances": trials.distances(), "left": nats, "notes": trials.notes}


def main(arguments: Sequence[str]) -> None:
    """Make what is missing, then print."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--policy", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--robots", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--left", action="store_true", help="Also what trees predict of the residuals.")
    given = parser.parse_args(arguments)
    policy = load_policy(given.policy)
    rows = [json.loads(line) for line in given.out.read_text().splitlines()] if given.out.exists() else []
    for seed in range(given.seed, given.seed + given.robots):
        if any(row["seed"] == seed for row in rows):
            continue
        began_s = time.monotonic()
        rows.append(measured(seed, policy, has_left=given.left))
        with given.out.open("a") as file:
            file.write(json.dumps(rows[-1]) + "\n")
        print(f"robot {seed}: {rows[-1]['distances']}, {time.monotonic() - began_s:.0f} s", flush=True)
    good = [row["distances"]["errors"] for row in rows if "errors" in row["distances"]]
    print(f"{len(good)} robots: distance in floors, 50, 80, 95 %: {np.quantile(good, [0.5, 0.8, 0.95]).round(2)}")
    for channel in rows[0]["left"]:
        nats = [row["left"].get(channel, 0.0) for row in rows]
        print(f"channel {channel}: left nats, 95 %: {np.quantile(nats, 0.95):.1f}")


if __name__ == "__main__":
    main(sys.argv[1:])
