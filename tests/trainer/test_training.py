import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from proof.training import bench_train
from spot_model.effects.base import Effect
from spot_model.errors import BadInputError
from spot_model.policy.observation import COLUMNS, OBSERVATION
from spot_model.policy.policy import load_policy
from tests.trainer.conftest import TINY
from trainer.config.task_config import RandomisationConfig
from trainer.config.train_config import TrainConfig, load_train_config
from trainer.ppo.checkpoint import find_checkpoint, read_checkpoint, write_checkpoint
from trainer.ppo.checkpoint_policy import actor_layers, networks_of_policy, policy_of_layers, read_layers, run_torch
from trainer.ppo.train import make_runner, resume, train_policy
from trainer.task.draws import Draws, training_effects
from trainer.task.task import check_device


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of four tiny iterations with checkpoints after two and four."""
    folder = tmp_path_factory.mktemp("run") / "whole"
    train_policy(TrainConfig.model_validate(TINY), folder, device="cpu", command="spot-rl train --config tiny.yaml")
    return folder


def parameters(path: Path) -> dict[str, torch.Tensor]:
    content = read_checkpoint(path)["algorithm"]
    return {**content["actor_state_dict"], **{f"critic.{k}": v for k, v in content["critic_state_dict"].items()}}


def test_a_resumed_run_is_bit_for_bit_the_uninterrupted_one(run: Path, tmp_path: Path) -> None:
    half = tmp_path / "half"
    half.mkdir()
    (half / "checkpoint_000002.pt").write_bytes((run / "checkpoint_000002.pt").read_bytes())
    last = resume(half, device="cpu")
    assert last.name == "checkpoint_000004.pt"
    expected, got = parameters(run / "checkpoint_000004.pt"), parameters(last)
    assert expected.keys() == got.keys()
    for name, value in expected.items():
        assert torch.equal(value, got[name]), name
    at_two = parameters(run / "checkpoint_000002.pt")
    assert not torch.equal(at_two["mlp.0.weight"], expected["mlp.0.weight"])


def test_the_run_folder_holds_config_revision_and_metrics(run: Path) -> None:
    assert load_train_config(run / "config.yaml") == TrainConfig.model_validate(TINY)
    record = json.loads((run / "run.json").read_text())
    assert record["command"] == "spot-rl train --config tiny.yaml"
    assert record["revision"]
    rows = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    assert [row["iteration"] for row in rows] == [0, 1, 2, 3]
    assert rows[-1]["steps"] == 4 * 6 * 8
    assert list((run / "tensorboard").iterdir())


def test_a_used_folder_and_a_finished_run_are_refused(run: Path, tiny: TrainConfig) -> None:
    with pytest.raises(BadInputError, match="is not empty"):
        train_policy(tiny, run, device="cpu")
    with pytest.raises(BadInputError, match="has done 4 of 4 iterations"):
        resume(run, device="cpu")


def test_a_run_can_start_from_anothers_networks(run: Path, tiny: TrainConfig, tmp_path: Path) -> None:
    small = tmp_path / "networks.pt"
    content = read_checkpoint(find_checkpoint(run))
    write_checkpoint(small, {key: content[key] for key in ("config", "iterations_done", "algorithm")})
    config = tiny.model_copy(update={"start_from": str(small), "iterations": 1, "save_every": 1})
    assert train_policy(config, tmp_path / "next", device="cpu").is_file()
    with pytest.raises(BadInputError, match="networks alone; start a new run"):
        resume(small, device="cpu", iterations=9)
    wide = config.model_copy(update={"ppo": tiny.ppo.model_copy(update={"hidden": (32, 8)})})
    with pytest.raises(BadInputError, match=r"do not fit the config's ppo.hidden"):
        train_policy(wide, tmp_path / "wide", device="cpu")


def test_a_run_can_start_from_a_policys_file_and_teaches_its_critic_first(tiny: TrainConfig, tmp_path: Path) -> None:
    source = Path("policies/walk.onnx")
    content, hidden = networks_of_policy(source)
    actor = content["algorithm"]["actor_state_dict"]
    seen = torch.randn(5, 48, generator=torch.Generator().manual_seed(0))
    acted = load_policy(source).act(seen.numpy())
    np.testing.assert_allclose(run_torch(actor_layers(actor), seen).numpy(), acted, atol=1e-5)
    ppo = tiny.ppo.model_copy(update={"critic_first_iterations": 2})
    config = tiny.model_copy(update={"start_from": str(source), "iterations": 3, "save_every": 1, "ppo": ppo})
    train_policy(config, tmp_path / "next", device="cpu")
    before, after, moved = (parameters(tmp_path / "next" / f"checkpoint_{i:06d}.pt") for i in (1, 2, 3))
    assert after["mlp.0.weight"].shape[0] == hidden[0]
    for name, value in actor.items():
        torch.testing.assert_close(after[name], value, rtol=0.0, atol=0.0)
    assert not torch.equal(before["critic.mlp.0.weight"], after["critic.mlp.0.weight"])
    assert not torch.equal(moved["mlp.0.weight"], after["mlp.0.weight"])


def test_a_policy_with_other_servos_is_no_start(tmp_path: Path) -> None:
    data, contract = Path("policies/walk.onnx").read_bytes(), load_policy(Path("policies/walk.onnx")).contract
    stiff = contract.model_copy(update={"kp_nm_per_rad": (80.0,) * 12})
    (tmp_path / "stiff.onnx").write_bytes(policy_of_layers(read_layers(data, "walk"), stiff).file_bytes)
    with pytest.raises(BadInputError, match="kp_nm_per_rad"):
        networks_of_policy(tmp_path / "stiff.onnx")


def test_joints_in_another_order_are_put_in_order(tmp_path: Path) -> None:
    policy = load_policy(Path("policies/walk.onnx"))
    layers = read_layers(Path("policies/walk.onnx").read_bytes(), "walk")
    order = list(reversed(range(12)))
    columns = [
        c for f in OBSERVATION for c in (np.arange(*COLUMNS[f.name].indices(48))[:: -1 if f.is_of_joints else 1])
    ]
    turned = [(w.clone(), b.clone()) for w, b in layers]
    turned[0] = (turned[0][0][:, columns], turned[0][1])
    turned[-1] = (turned[-1][0][order], turned[-1][1][order])
    names = tuple(policy.contract.joint_names[i] for i in order)
    default = tuple(policy.contract.default_position_rad[i] for i in order)
    changed = {"joint_names": names, "default_position_rad": default}
    made = policy_of_layers(turned, policy.contract.model_copy(update=changed))
    (tmp_path / "turned.onnx").write_bytes(made.file_bytes)
    found = actor_layers(networks_of_policy(tmp_path / "turned.onnx")[0]["algorithm"]["actor_state_dict"])
    for (weight, bias), (wanted, wanted_bias) in zip(found, layers, strict=True):
        torch.testing.assert_close(weight, wanted)
        torch.testing.assert_close(bias, wanted_bias)


def test_a_checkpoint_whose_robots_remember_something_else_is_refused(run: Path, tmp_path: Path) -> None:
    content = read_checkpoint(run / "checkpoint_000002.pt")
    reported = content["environment"]["task"]["0"]["backend"]["reported"]
    content["environment"]["task"]["0"]["backend"]["reported"] = reported[:-1]
    older = tmp_path / "checkpoint_000002.pt"
    torch.save(content, older)
    with pytest.raises(BadInputError, match=r"cannot go on: \d leaves .* with the revision in the run's run\.json"):
        resume(older, device="cpu")


def test_a_checkpoint_of_another_contract_is_refused(run: Path, tmp_path: Path) -> None:
    content = read_checkpoint(find_checkpoint(run))
    other = tmp_path / "other.pt"
    for key, value, words in (
        ("action_scale_rad", 0.5, r"action_scale_rad = 0\.5; expected 0\.2"),
        ("rate_hz", 100.0, r"rate_hz = 100\.0; expected 50"),
        ("kp_nm_per_rad", 50.0, r"kp_nm_per_rad = 50\.0; expected 60"),
    ):
        torch.save({**content, "contract": {**content["contract"], key: value}}, other)
        with pytest.raises(BadInputError, match="another contract: " + words):
            read_checkpoint(other)
    other.write_bytes(b"not a checkpoint")
    with pytest.raises(BadInputError, match=r"cannot be read \(UnpicklingError\)"):
        read_checkpoint(other)
    with pytest.raises(BadInputError, match="nowhere does not exist; give a run folder"):
        find_checkpoint(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    with pytest.raises(BadInputError, match="has no checkpoint_"):
        find_checkpoint(tmp_path / "empty")


def test_a_gpu_that_is_not_there_is_named_at_once() -> None:
    if torch.cuda.is_available():
        pytest.skip("this machine has a GPU")
    with pytest.raises(BadInputError, match="no usable NVIDIA GPU here"):
        check_device("cuda:0")
    with pytest.raises(BadInputError, match="'tpu' is unknown; allowed: cpu, cuda"):
        check_device("tpu")


def drawn_effects(model: str, n: int, *effects: dict[str, Any], replaced: tuple[str, ...] = ()) -> tuple[Effect, ...]:
    randomisation = RandomisationConfig(effects=effects, replaced_effects=replaced)
    return training_effects(model, randomisation, n, Draws(torch.Generator().manual_seed(0)))


def test_effects_can_be_fixed_or_drawn_once_a_simulation() -> None:
    armature = {"effect": "armature", "joints": ["knees"], "inertia_kg_m2": [0.01, 0.08]}
    drawn = drawn_effects("paper_identified", 50, armature)[-1].values["inertia_kg_m2"]
    assert drawn.shape == (50, 1)
    assert 0.01 <= drawn.min() < 0.02
    assert 0.07 < drawn.max() <= 0.08
    with pytest.raises(BadInputError, match=r"randomisation\.effects\.0: inertia_kg_m2 = \[2, 1\]"):
        drawn_effects("ideal", 5, {"effect": "armature", "inertia_kg_m2": [2, 1]})
    with pytest.raises(BadInputError, match=r"randomisation\.effects\.0.*mass"):
        drawn_effects("ideal", 5, {"effect": "armature", "mass": [1, 2]})


def test_an_effect_of_the_model_can_be_replaced() -> None:
    delay = {"effect": "command_delay", "delay_s": [0.002, 0.008]}
    effects = drawn_effects("paper_identified", 5, delay, replaced=("command_delay",))
    delays = [e for e in effects if e.name == "command_delay"]
    assert len(delays) == 1
    assert delays[0].values["delay_s"].shape == (5, 1)
    with pytest.raises(BadInputError, match=r"has no effect 'armature'; allowed: command_delay, coulomb_friction"):
        drawn_effects("paper_identified", 5, replaced=("armature",))


def test_training_with_drawn_and_sensing_effects_runs(tiny: TrainConfig, tmp_path: Path) -> None:
    effects = (
        {"effect": "command_delay", "delay_s": [0.0, 0.01]},
        {"effect": "encoder_offset", "offset_rad": [-0.02, 0.02]},
    )
    randomisation = tiny.task.randomisation.model_copy(update={"effects": effects})
    task = tiny.task.model_copy(update={"randomisation": randomisation})
    config = tiny.model_copy(
        update={"task": task, "iterations": 1, "ppo": tiny.ppo.model_copy(update={"mirror_loss": 0.1})}
    )
    assert train_policy(config, tmp_path / "r", device="cpu").is_file()


def test_the_benchmark_reports_every_share(tiny: TrainConfig) -> None:
    result = bench_train(tiny, "cpu", iterations=1)
    assert result["n_envs"] == 8
    assert result["policy_steps_per_s"] > 0
    assert result["core_us"] > result["collect_core_us"] > 0.0
    total = result["physics_share"] + result["task_share"] + result["learning_share"]
    assert total == pytest.approx(1.0, abs=0.01)


@pytest.mark.slow
def test_two_processes_learn_one_network(tmp_path: Path) -> None:
    script = tmp_path / "two.py"
    script.write_text(
        "import hashlib, sys\n"
        "from pathlib import Path\n"
        "from trainer.config.train_config import TrainConfig\n"
        "from trainer.ppo.train import make_runner\n"
        f"config = TrainConfig.model_validate({TINY!r})\n"
        "runner = make_runner(config, Path(sys.argv[1]), 'cpu')\n"
        "runner.run(2, is_fresh=True)\n"
        "data = b''.join(p.detach().numpy().tobytes() for p in runner.alg.actor.parameters())\n"
        "Path(sys.argv[1], f'{runner.gpu_global_rank}.txt').write_text(hashlib.sha256(data).hexdigest())\n"
        "runner.close()\n"
    )
    command = [sys.executable, "-W", "ignore", "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2]), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [*command, str(script), str(tmp_path)], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-3000:]
    sums = [(tmp_path / f"{rank}.txt").read_text() for rank in range(2)]
    assert sums[0] == sums[1]


def test_the_last_iterations_settle(tiny: TrainConfig, tmp_path: Path) -> None:
    ppo = tiny.ppo.model_copy(update={"settle_iterations": 2})
    runner = make_runner(tiny.model_copy(update={"ppo": ppo}), tmp_path, "cpu")
    seen = []
    for iteration in range(4):
        runner.env.steps = iteration * 6 + 1
        seen.append(runner.alg._settled(1.0, 0.01))
    # Full until two of the four iterations are left, then half way to an entropy of 0 and a fifth of the KL target.
    assert seen == [(1.0, 0.01), (1.0, 0.01), (1.0, 0.01), (0.5, pytest.approx(0.006))]
