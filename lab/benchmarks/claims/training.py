"""Claim: training on processors spends most of what bare MuJoCo would do in the same time on the same robots.

Bare: `mj_step` of the same model, batched on as many threads, with a PD law in one line (plant_speed.py). Beside it
the plant with the paper's effects, and `spot-rl bench train`: physics alone, with the task, with learning. All count
physics steps of 5 ms a second. Also `spot_rl.make_vec_env`, with 1,024 robots: steps of robots a second.

    python lab/benchmarks/claims/training.py [--envs 512]
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from plant_speed import SUBSTEPS, bare_period, plant_period, seconds_a_period

import spot_rl
from spot_model.robot.mjcf import MjcfOptions

TRAIN = [sys.executable, "-m", "spot_model", "bench", "train", "--json"]


VECTOR_ENVS, VECTOR_STEPS = 1024, 100


def vector_env_steps_per_s(n: int) -> float:
    """Steps of all robots a second, from random actions with a standard deviation of 0.2 rad."""
    env, rng = spot_rl.make_vec_env(n, raw_actions=True), np.random.default_rng(0)
    env.reset(seed=0)
    actions = rng.normal(size=(VECTOR_STEPS, n, 12)).astype(np.float32)
    for action in actions[:10]:
        env.step(action)
    start_s = time.perf_counter()
    for action in actions:
        env.step(action)
    return n * VECTOR_STEPS / (time.perf_counter() - start_s)


def main() -> None:
    """Print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--envs", type=int, default=512)
    parser.add_argument("--threads", type=int, default=2)
    chosen = parser.parse_args()
    n, threads = chosen.envs, chosen.threads
    bare = n * SUBSTEPS / seconds_a_period(bare_period(n, threads, MjcfOptions()), 4.0)
    plant = n * SUBSTEPS / seconds_a_period(plant_period(n, threads, "paper_identified", MjcfOptions()), 4.0)
    words = [*TRAIN, "--set", f"n_envs={n}", "--iterations", "3"]
    train = json.loads(subprocess.run(words, check=True, capture_output=True, text=True).stdout)  # noqa: S603
    steps = {
        "plant": plant,
        "physics": train["physics_steps_per_s"],
        "collecting": train["collect_steps_per_s"] * SUBSTEPS,
        "with_learning": train["policy_steps_per_s"] * SUBSTEPS,
    }
    told = {f"{name}_share_of_bare": round(value / bare, 3) for name, value in steps.items()}
    told |= {"policy_steps_per_s": train["policy_steps_per_s"]}
    told |= {"vector_env_steps_per_s": round(vector_env_steps_per_s(min(VECTOR_ENVS, 2 * n)))}
    print(json.dumps({"bare_steps_per_s": round(bare), **told}))


if __name__ == "__main__":
    main()
