"""What would a physics step of training cost with other options of MuJoCo, and how far would robots go another way?

Claim it supports: the choice of options in `trainer/task/plant_backend.py`. 512 robots of the training task, after
sixty periods of a policy, continue for twelve periods under the same random set-points with each option in turn. Prints
CPU time of a step (the least of the rounds), and how far joints are from the model with MuJoCo's warm start: the
median and the largest of the robots, each by its worst joint. One thread.

    python lab/benchmarks/solver_options.py [--policy fast] [--rounds 8] [--robots 512]
"""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path

from spot_model.policy.built_in import policy_file

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import mujoco
import numpy as np
import torch

from spot_model.plant.plant import Plant
from spot_model.policy.policy import load_policy
from spot_model.robot import facts
from spot_model.robot.facts import Array
from trainer.config.train_config import train_config_from_data
from trainer.task.task import make_task

PERIODS, SUBSTEPS = 12, 4
Off = mujoco.mjtDisableBit
WARM = int(Off.mjDSBL_ISLAND | Off.mjDSBL_MIDPHASE)
COLD = WARM | int(Off.mjDSBL_WARMSTART)
USUAL = {
    "disableflags": COLD,
    "tolerance": 1e-8,
    "ls_tolerance": 0.01,
    "jacobian": int(mujoco.mjtJacobian.mjJAC_AUTO),
    "solver": int(mujoco.mjtSolver.mjSOL_NEWTON),
    "cone": int(mujoco.mjtCone.mjCONE_PYRAMIDAL),
}
OPTIONS: dict[str, dict[str, float]] = {
    "warm start": {"disableflags": WARM},
    "cold start": {},
    "cold, tolerance 1e-6": {"tolerance": 1e-6},
    "cold, line search to 0.1": {"ls_tolerance": 0.1},
    "cold, no sensors": {"disableflags": COLD | int(Off.mjDSBL_SENSOR)},
    "cold, no springs and dampers": {"disableflags": COLD | int(Off.mjDSBL_SPRING | Off.mjDSBL_DAMPER)},
    "cold, islands": {"disableflags": COLD & ~int(Off.mjDSBL_ISLAND)},
    "cold, sparse": {"jacobian": int(mujoco.mjtJacobian.mjJAC_SPARSE)},
    "cold, conjugate gradient": {"solver": int(mujoco.mjtSolver.mjSOL_CG)},
    "cold, elliptic cone": {"cone": int(mujoco.mjtCone.mjCONE_ELLIPTIC)},
    "cold, no friction in joints": {"disableflags": COLD | int(Off.mjDSBL_FRICTIONLOSS)},
}


def walked(policy: Path, n_robots: int) -> Plant:
    """The robots of a training task, after sixty periods."""
    torch.set_num_threads(1)
    config = train_config_from_data(
        {"name": "options", "iterations": 1}, source="options", overrides=(f"n_envs={n_robots}",)
    )
    task, loaded = make_task(config, "cpu", seed=1, n_threads=1), load_policy(policy)
    result = task.start()
    for _ in range(60):
        result = task.step(torch.from_numpy(np.array(loaded.act(result.observation.numpy()))))
    plant: Plant = task.backend.plant  # type: ignore[attr-defined]
    return plant


def main() -> None:
    """Print one JSON object: by option, CPU µs of a step and how far the robots are from the warm start's, rad."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--policy", type=policy_file, default="fast")
    parser.add_argument("--rounds", type=int, default=8)
    parser.add_argument("--robots", type=int, default=512)
    chosen = parser.parse_args()
    plant, rng = walked(chosen.policy, chosen.robots), np.random.default_rng(0)
    begin = plant.snapshot()
    setpoints = facts.DEFAULT_POSITION_RAD + rng.normal(0.0, 0.1, (PERIODS, chosen.robots, facts.N_JOINTS))
    took: dict[str, float] = dict.fromkeys(OPTIONS, float("inf"))
    ends: dict[str, Array] = {}
    for _ in range(chosen.rounds):
        for name, option in OPTIONS.items():
            for field, value in {**USUAL, **option}.items():
                plant.fields[f"opt.{field}"][...] = value
            plant.restore(begin)
            begin_s = time.process_time()
            for setpoint in setpoints:
                plant.step(setpoint, SUBSTEPS)
            took[name] = min(took[name], time.process_time() - begin_s)
            ends[name] = plant.joint_position_rad
    told = {}
    for name, end in ends.items():
        off = np.abs(end - ends["warm start"]).max(axis=1)
        step_us = 1e6 * took[name] / (PERIODS * SUBSTEPS * chosen.robots)
        told[name] = {
            "step_us": round(step_us, 2),
            "median_rad": float(f"{np.median(off):.1e}"),
            "most_rad": float(f"{off.max():.1e}"),
        }
    print(json.dumps(told, indent=1))


if __name__ == "__main__":
    main()
