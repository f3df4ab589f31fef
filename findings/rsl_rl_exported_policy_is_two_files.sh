#!/usr/bin/env bash
# rsl-rl-lib 5.5.1 with torch 2.13.0: an exported policy is two files, and only one of them was named.
#
# export_policy_to_onnx(folder, "walk.onnx") writes the network there, with its small tensors, and the larger ones (from
# about 1 KB) to walk.onnx.data. A walk.onnx that is sent alone cannot be loaded. Nor can the pair be renamed: the file
# holds the other's name, so fast.onnx beside fast.onnx.data looks for walk.onnx.data. If that of another policy lies
# there, it loads: a network with the biases of one policy and the weights of the other.
# Whoever deploys: onnx.save(onnx.load("walk.onnx"), "whole.onnx") is one file that can be sent and renamed.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "rsl-rl-lib==5.5.1" "torch==2.13.0" "numpy==2.4.6" \
  "onnx==1.23.2" "onnxruntime==1.31.1"
"$folder/venv/bin/python" - <<'PY'
import copy
import logging
import shutil
import tempfile
import warnings
from contextlib import redirect_stderr, redirect_stdout
from importlib.metadata import version
from io import StringIO
from pathlib import Path

warnings.simplefilter("ignore")
logging.disable(logging.CRITICAL)
import numpy as np
import onnx
import onnxruntime
import torch
from rsl_rl.env import VecEnv
from rsl_rl.runners import OnPolicyRunner
from tensordict import TensorDict

assert version("rsl-rl-lib") == "5.5.1" and torch.__version__.split("+")[0] == "2.13.0"
NETWORK = {"class_name": "MLPModel", "hidden_dims": [128], "activation": "elu"}
NOISE = {"class_name": "GaussianDistribution", "init_std": 1.0}
CONFIG = {
    "num_steps_per_env": 8,
    "save_interval": 50,
    "obs_groups": {"actor": ["policy"], "critic": ["policy"]},
    "algorithm": {"class_name": "PPO"},
    "actor": NETWORK | {"distribution_cfg": NOISE},
    "critic": NETWORK,
}


class World(VecEnv):
    """What a runner asks before it trains."""

    num_envs, num_actions, max_episode_length, device, cfg = 4, 2, 10, "cpu", {}
    episode_length_buf = torch.zeros(4, dtype=torch.long)

    def get_observations(self):
        return TensorDict({"policy": torch.ones(4, 3)}, batch_size=[4])

    def step(self, actions):
        raise NotImplementedError


def export(folder, name, seed):
    torch.manual_seed(seed)
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        OnPolicyRunner(World(), copy.deepcopy(CONFIG), None, "cpu").export_policy_to_onnx(str(folder), name)


def act(path):
    """The action, or None where the file cannot be loaded."""
    try:
        session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    except Exception as error:
        print(f"{path.name} alone or renamed:", str(error).splitlines()[0][:110])
        return None
    return session.run(None, {"obs": np.ones((1, 3), np.float32)})[0]


with tempfile.TemporaryDirectory() as name:
    made, sent, renamed = (Path(name) / part for part in ("made", "sent", "renamed"))
    export(made, "walk.onnx", seed=0)
    sizes = {path.name: path.stat().st_size for path in sorted(made.iterdir())}
    print("exported:", sizes)
    assert list(sizes) == ["walk.onnx", "walk.onnx.data"]
    right = act(made / "walk.onnx")
    sent.mkdir()
    shutil.copy(made / "walk.onnx", sent / "walk.onnx")
    assert act(sent / "walk.onnx") is None
    renamed.mkdir()
    for end in ("", ".data"):
        shutil.copy(made / f"walk.onnx{end}", renamed / f"fast.onnx{end}")
    assert act(renamed / "fast.onnx") is None
    export(renamed, "walk.onnx", seed=1)
    mixed, other = act(renamed / "fast.onnx"), act(renamed / "walk.onnx")
    print("right:", right, "- renamed, beside another policy:", mixed, "- the other:", other)
    assert not np.allclose(mixed, right) and not np.allclose(mixed, other)
    onnx.save(onnx.load(made / "walk.onnx"), sent / "whole.onnx")
    assert np.array_equal(act(sent / "whole.onnx"), right)
PY
