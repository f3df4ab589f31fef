"""Every recording of the menu on robots drawn from wide errors: none falls, none exceeds a limit.

    python benchmarks/check_experiments.py --policy walk [--robots 50] [--only squat] [--seed 1]

Each robot is the paper's identified model with rotor inertia, and ordinary errors of twice the published ranges, as
``spot-rl diagnose next`` draws them. One that the gate refuses is never run on a robot.
"""

from __future__ import annotations

import sys
from argparse import ArgumentParser
from collections.abc import Sequence

import numpy as np

from diagnosis.library.registry import LIBRARY
from diagnosis.next.candidates import HEAT, candidates
from diagnosis.next.trial import burden, refusals, settled, try_on, wide_robots
from diagnosis.verdict.explanation import evidence_of
from spot_log.read.run import Run
from spot_model.effects.friction import Armature
from spot_model.io.model_file import load_model
from spot_model.policy.built_in import policy_file
from spot_model.policy.policy import load_policy
from spot_model.robot import facts
from spot_model.robot.rotation import tilt_rad

SUSPECTS = ("fl_kn", "hr_hy", "hl_hx")


def lean_deg(run: Run) -> float:
    """Largest tilt of a robot, degrees."""
    return float(np.degrees(tilt_rad(settled(run).odom_from_body_wxyz)).max())


def main(arguments: Sequence[str]) -> None:
    """Print a line for each recording."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--policy", type=policy_file, required=True)
    parser.add_argument("--robots", type=int, default=50)
    parser.add_argument("--only", default="", help="A part of the names of the recordings to run.")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args(arguments)
    policy = load_policy(given.policy)
    rotors = (
        Armature(joints=("hips",), inertia_kg_m2=facts.HIP_ARMATURE_KG_M2),
        Armature(joints=("knees",), inertia_kg_m2=facts.KNEE_ARMATURE_KG_M2),
    )
    nominal = load_model("paper_identified").with_effects(*rotors)
    menu = candidates(policy.contract, SUSPECTS, (HEAT,))
    slow_walk = next(c for c in menu if c.name == "slow_walk")
    *_, board = evidence_of(try_on(slow_walk.motion, [nominal], policy, given.seed), nominal, policy, LIBRARY)
    robots = wide_robots([nominal], board, np.random.default_rng(given.seed))[: given.robots]
    for candidate in menu:
        if given.only in candidate.name:
            runs = try_on(candidate.motion, robots, policy, given.seed)
            lean = max(map(lean_deg, runs))
            told = "; ".join(refusals(runs)) or f"all {len(runs)} robots bear it, lean {lean:.0f} degrees at most"
            print(f"{candidate.name}: {told}; {burden(runs)}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
