"""How a policy is trained further, PPO on a GPU and gains on cores, with the robots that its logs allow."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from diagnosis.improve.steps import CommandStep, Say, take
from spot_model.errors import GpuMemoryError
from spot_model.policy.contract import PolicyContract

RETRAIN: Final = Path(__file__).with_name("retrain.yaml")
FEWEST_ROBOTS: Final = 512
"""A training with fewer learns too little for its time."""
GENERATIONS: Final = 12
"""Generations of the search over gains; on two cores they take some 15 minutes."""
POPULATION: Final = 14


def train_words(
    robots: Path, policy: Path, contract: PolicyContract, config: Path, sets: Sequence[str], out: Path, device: str
) -> tuple[str, ...]:
    """The command that trains a policy further, within its own command ranges unless ``sets`` says others."""
    ranges = zip(
        ("v_x_m_s", "v_y_m_s", "yaw_rate_rad_s"),
        contract.velocity_command_low,
        contract.velocity_command_high,
        strict=True,
    )
    own = [f"task.commands.{key}=[{low:g}, {high:g}]" for key, low, high in ranges]
    own = [f"model={robots}", f"start_from={policy}", f"name={contract.name}-improved"[:105], *own, *sets]
    words = [word for value in own for word in ("--set", value)]
    return ("train", "--config", str(config), *words, "--out", str(out), "--device", device)


def take_training(step: CommandStep, run: Path, n_envs: int, device: str, say: Say) -> float | None:
    """Train, from the last checkpoint where there is one; with half of the robots where a GPU's memory is too small."""
    while True:
        if sorted(run.glob("checkpoint_*.pt")):
            step = replace(step, words=("train", "--resume", str(run), "--device", device))
        elif run.exists():
            shutil.rmtree(run)  # Interrupted before there was anything to go on from.
        try:
            return take(step, say)
        except GpuMemoryError:
            n_envs //= 2
            if n_envs < FEWEST_ROBOTS or sorted(run.glob("checkpoint_*.pt")):
                raise
            say(f"{step.about}: the GPU has too little memory; with {n_envs} robots instead")
            step = replace(step, words=(*step.words, "--set", f"n_envs={n_envs}"))


def refine_config(robots: Path, contract: PolicyContract, seed: int) -> dict[str, Any]:
    """A search over gains within the policy's own command ranges, on the fitted robot and on the possible ones."""
    low, high = np.array(contract.velocity_command_low), np.array(contract.velocity_command_high)
    top = float(high[0])
    speeds = sorted({round(min(v, top), 3) for v in (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, top)})
    alone = [np.zeros(3), low * (1, 0, 0), high * (0, 1, 0), high * (0, 0, 1)]
    both = [high * (0.5, 0.5, 0), high * (0.5, 0, 0) + low * (0, 0, 0.5)]
    return {
        "schema": "spot-rl/refine/1",
        "generations": GENERATIONS,
        "population": POPULATION,
        "seed": seed,
        "speeds_m_s": speeds,
        "others": [[round(float(v), 3) + 0.0 for v in command] for command in (*alone, *both)],
        "robots": [{"model": str(robots)}],
        "starts": [{"top_m_s": round(min(3.0, top), 3)}],
        "weights": {"top_speed_wanted_m_s": round(top, 3)},
    }
