#!/usr/bin/env bash
# rsl-rl-lib 5.5.1: a resumed training does the iteration of its checkpoint again, and writes over that checkpoint.
#
# model_4.pt is the policy after iteration 4. A runner that loads it goes on with number 4, not 5: with the same log
# folder, it writes another policy to model_4.pt, the curve has two points at 4, and 5 iterations and 5 more end at
# number 8. The same holds for a second call of learn() on one runner.
# Whoever resumes: into a new folder, or keep a copy of the checkpoint; and add one to current_learning_iteration after
# load() if numbers are to count updates.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "rsl-rl-lib==5.5.1" "torch==2.13.0" "numpy==2.4.6" "tensorboard==2.21.0"
"$folder/venv/bin/python" - <<'PY'
import copy
import logging
import tempfile
from contextlib import redirect_stdout
from importlib.metadata import version
from io import StringIO
from pathlib import Path

import torch
from rsl_rl.env import VecEnv
from rsl_rl.runners import OnPolicyRunner
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensordict import TensorDict

assert version("rsl-rl-lib") == "5.5.1"
logging.disable(logging.CRITICAL)
NETWORK = {"class_name": "MLPModel", "hidden_dims": [8], "activation": "elu"}
NOISE = {"class_name": "GaussianDistribution", "init_std": 1.0}
CONFIG = {
    "num_steps_per_env": 8,
    "save_interval": 1,
    "obs_groups": {"actor": ["policy"], "critic": ["policy"]},
    "logger": "tensorboard",
    "algorithm": {"class_name": "PPO", "num_learning_epochs": 1, "num_mini_batches": 1},
    "actor": NETWORK | {"distribution_cfg": NOISE},
    "critic": NETWORK,
}


class Still(VecEnv):
    """Four worlds in which the best action is zero."""

    num_envs, num_actions, max_episode_length, device, cfg = 4, 2, 10, "cpu", {}

    def __init__(self):
        self.episode_length_buf = torch.zeros(4, dtype=torch.long)

    def get_observations(self):
        return TensorDict({"policy": torch.ones(4, 3)}, batch_size=[4])

    def step(self, actions):
        self.episode_length_buf += 1
        done = self.episode_length_buf >= self.max_episode_length
        self.episode_length_buf[done] = 0
        return self.get_observations(), -actions.square().sum(1), done, {}


def learn(folder, checkpoint=None):
    """Five iterations."""
    with redirect_stdout(StringIO()):
        runner = OnPolicyRunner(Still(), copy.deepcopy(CONFIG), str(folder), "cpu")
        if checkpoint:
            runner.load(str(checkpoint))
        runner.learn(5)


def weights(checkpoint):
    return torch.load(checkpoint, weights_only=False)["actor_state_dict"]["mlp.0.weight"]


torch.manual_seed(0)
with tempfile.TemporaryDirectory() as name:
    folder = Path(name)
    learn(folder)
    first = weights(folder / "model_4.pt")
    learn(folder, folder / "model_4.pt")
    curve = EventAccumulator(name)
    curve.Reload()
    steps = [scalar.step for scalar in curve.Scalars("Loss/learning_rate")]
    files = sorted(path.name for path in folder.glob("model_*.pt"))
    is_kept = torch.equal(first, weights(folder / "model_4.pt"))
    print("5 iterations, and 5 from model_4.pt: steps", steps, "files", files, "- model_4.pt is kept:", is_kept)
assert steps == [0, 1, 2, 3, 4, 4, 5, 6, 7, 8]
assert files == [f"model_{k}.pt" for k in range(9)] and not is_kept
PY
