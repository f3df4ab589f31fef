"""Do the two back ends agree? Same robots, same start, same set-points, on a GPU and on the CPU; prints JSON.

Claim it supports: the task trains on the same physics on both, up to rounding.
Usage: python lab/benchmarks/gpu_parity.py [DEVICE] [ROBOTS] [PERIODS]
"""

from __future__ import annotations

import json
import sys

import numpy as np
import torch

from spot_model.io.model_file import load_model
from spot_model.plant.closed_loop import StartState
from spot_model.policy.built_in import policy_file
from spot_model.policy.policy import load_policy
from spot_model.robot import facts
from trainer.config.task_config import RandomisationConfig, TaskConfig
from trainer.signals.distances import SequenceReference, features_of_run
from trainer.signals.policy_ticks import Script
from trainer.simulate.recorded_runs import UsualNoise, simulate_scripts
from trainer.task.draws import Draws, draw_initial_state, draw_simulations, training_effects
from trainer.task.feet import Ground
from trainer.task.plant_backend import PlantBackend

RANDOMISATION = RandomisationConfig(
    replaced_effects=("command_delay",),
    effects=(
        {"effect": "command_delay", "delay_s": [0.0, 0.03]},
        {"effect": "armature", "joints": ["knees"], "inertia_kg_m2": [0.0, 0.09]},
    ),
)


def main(device: str = "cuda:0", n: int = 256, periods: int = 50) -> None:
    """Print the median and the largest difference after each of a few periods."""
    generator = torch.Generator()
    generator.manual_seed(0)
    draws = Draws(generator)
    config = TaskConfig()
    effects = training_effects("paper_identified", RANDOMISATION, n, draws)
    simulations = draw_simulations(config.randomisation, n, draws)
    initial = draw_initial_state(config.randomisation, Ground(config.terrain, draws.device), n, draws)
    everyone = torch.ones(n, dtype=torch.bool)
    gpu, cpu = PlantBackend(config, effects, simulations, device), PlantBackend(config, effects, simulations)
    cpu.reset(everyone, initial)
    on_gpu = type(initial)(**{name: value.to(device) for name, value in vars(initial).items()})
    gpu.reset(everyone.to(device), on_gpu)
    pose = torch.tensor(facts.DEFAULT_POSITION_RAD, dtype=torch.float32)
    for period in range(1, periods + 1):
        setpoint = pose + 0.15 * torch.randn(n, facts.N_JOINTS, generator=generator)
        cpu.step(setpoint)
        gpu.step(setpoint.to(device))
        if period in (1, 5, 10, 25, 50):
            a, b = gpu.read(), cpu.read()
            error = (a.position_rad.cpu() - b.position_rad).abs().amax(dim=-1)
            contacts = (a.foot_contact.cpu() == b.foot_contact).float().mean()
            bodies = (a.body_contact.cpu() == b.body_contact).float().mean()
            result = {
                "period": period,
                "joint_position_error_median_rad": float(error.median()),
                "joint_position_error_max_rad": float(error.max()),
                "same_foot_contacts": float(contacts),
                "same_body_contacts": float(bodies),
            }
            print(json.dumps(result), flush=True)


def walks(device: str, n: int = 6, seconds: float = 8.0) -> dict[str, float]:
    """Wasserstein distance of walks on a device to walks on the cores, and of those among each other, N·m.

    All walk as *baseline* at 0.6 m/s from the same stand, with a robot's usual sensor noise of other seeds.
    """
    policy, model = load_policy(policy_file("baseline")), load_model("paper_identified")
    rest, none = np.asarray(facts.DEFAULT_POSITION_RAD), np.zeros(12)
    level, still = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
    start = StartState(rest, none, level, still, still, none.astype(np.float32))
    command = np.tile([0.6, 0.0, 0.0], (round(seconds * policy.contract.rate_hz), 1))
    scripts = [Script("walk", i, start, command) for i in range(n)]
    runs = {
        where: simulate_scripts(model, policy, scripts, np.random.default_rng(seed), UsualNoise(), device=where)
        for seed, where in enumerate(("cpu", device))
    }
    features = {where: [features_of_run(run, policy) for run in some] for where, some in runs.items()}
    reference = SequenceReference.build("walk", features["cpu"])
    between = np.mean([reference.distances(f)[:, 0].mean() for f in features[device]])
    return {"w1_to_cores_nm": float(between), "w1_floor_nm": float(reference.scale[0])}


if __name__ == "__main__":
    arguments = sys.argv[1:]
    main(*arguments[:1], *(int(a) for a in arguments[1:]))
    print(json.dumps(walks(arguments[0] if arguments else "cuda:0")), flush=True)
