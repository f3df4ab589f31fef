"""Do the two back ends agree? Same robots, same start, same set-points, on a GPU and on the CPU; prints JSON.

Claim it supports: the task trains on the same physics on both, up to rounding.
Usage: python benchmarks/gpu_parity.py [DEVICE] [ROBOTS] [PERIODS]
"""

from __future__ import annotations

import json
import sys

import torch

from spot_model.robot import facts
from trainer.backends.plant_backend import PlantBackend
from trainer.backends.random_draws import Draws
from trainer.config.task_config import RandomisationConfig, TaskConfig
from trainer.task.initial_state import draw_initial_state, draw_simulations
from trainer.task.randomised_effects import training_effects

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
    initial = draw_initial_state(config.randomisation, config.terrain, n, draws)
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


if __name__ == "__main__":
    arguments = sys.argv[1:]
    main(*arguments[:1], *(int(a) for a in arguments[1:]))
