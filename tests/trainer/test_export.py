import shutil
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from spot_model.errors import BadInputError
from spot_model.policy.observation import N_OBSERVATION
from spot_model.policy.policy import load_policy
from tests.trainer.conftest import TINY
from trainer.config.train_config import TrainConfig
from trainer.evaluate.export import export_policy
from trainer.ppo.checkpoint import find_checkpoint
from trainer.ppo.checkpoint_policy import NewestPolicy, check_agreement, run_torch
from trainer.ppo.train import train_policy


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run") / "r"
    ppo = {**TINY["ppo"], "normalise_observations": True}
    train_policy(
        TrainConfig.model_validate({**TINY, "iterations": 2, "ppo": ppo}), folder, device="cpu", command="the command"
    )
    return folder


def rsl_actor(run: Path, observation: torch.Tensor) -> torch.Tensor:
    """The actor as rsl-rl itself runs it."""
    from tensordict import TensorDict

    from trainer.ppo.checkpoint import config_of, find_checkpoint, read_checkpoint
    from trainer.ppo.train import make_runner

    content = read_checkpoint(find_checkpoint(run))
    runner = make_runner(config_of(content, "test"), run, "cpu")
    runner.alg.load(content["algorithm"], None, strict=True)
    runner.alg.eval_mode()
    groups = {"policy": observation, "critic": observation}
    with torch.no_grad():
        return runner.alg.actor(TensorDict(groups, batch_size=[len(observation)]))


def test_the_file_agrees_with_rsl_rl_and_describes_itself(run: Path, tmp_path: Path) -> None:
    written = export_policy(run, tmp_path / "p.onnx", "trotter")
    policy = load_policy(tmp_path / "p.onnx")
    contract = policy.contract
    assert (written.sha256, written.contract) == (policy.sha256, contract)
    assert contract.name == "trotter"
    assert contract.velocity_command_high == (5.5, 1.5, 2.0)
    assert (contract.training.command, contract.training.seed) == ("the command", 0)
    observation = torch.randn(20, N_OBSERVATION, generator=torch.Generator().manual_seed(0))
    difference = np.abs(policy.act(observation.numpy()) - rsl_actor(run, observation).numpy())
    assert difference.max() <= 1e-5
    assert policy.act(observation[0].numpy()).shape == (12,)


def test_the_file_is_one_file_and_is_not_overwritten(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "p.onnx"
    export_policy(run, out)
    assert [p.name for p in tmp_path.iterdir()] == ["p.onnx"]
    model = onnx.load(out)
    assert model.graph.input[0].type.tensor_type.shape.dim[0].dim_param == "batch"
    with pytest.raises(BadInputError, match=r"p\.onnx exists"):
        export_policy(run, out)


def test_a_training_is_followed_from_checkpoint_to_checkpoint(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("trainer.ppo.checkpoint_policy.LOOKED_EVERY_S", 0.0)
    newest = find_checkpoint(run)
    shutil.copy(newest, tmp_path / "checkpoint_000001.pt")
    shutil.copy(run / "run.json", tmp_path)
    told: list[str] = []
    following = NewestPolicy(tmp_path, told.append)
    observation = np.random.default_rng(0).normal(size=(3, 48)).astype(np.float32)
    export_policy(run, tmp_path / "policy.onnx")
    wanted = load_policy(tmp_path / "policy.onnx").act(observation)
    np.testing.assert_array_equal(following.load().act(observation), wanted)
    assert following.newer() is None
    shutil.copy(newest, tmp_path / "checkpoint_000002.pt")
    assert following.newer() is not None
    assert told == ["checkpoint_000001.pt", "checkpoint_000002.pt"]


def test_networks_that_disagree_are_refused() -> None:
    wanted = np.linspace(-1.0, 1.0, 24, dtype=np.float32).reshape(2, 12)
    check_agreement(wanted + 5e-6, wanted)
    with pytest.raises(BadInputError, match=r"torch and onnxruntime differ by 0.001"):
        check_agreement(wanted + np.float32(0.001), wanted)


def test_layers_by_hand() -> None:
    layers = [(torch.tensor([[1.0, -2.0]]), torch.tensor([0.5])), (torch.tensor([[3.0]]), torch.tensor([1.0]))]
    # 1 − 4 + 0.5 = −2.5; ELU: e^−2.5 − 1; times 3, plus 1.
    got = run_torch(layers, torch.tensor([[1.0, 2.0]]))
    assert float(got) == pytest.approx(3.0 * (np.exp(-2.5) - 1.0) + 1.0)


def test_a_policys_file_is_measured_anew(tmp_path: Path) -> None:
    walk = Path(__file__).parents[2] / "policies" / "walk.onnx"
    before, after = load_policy(walk), export_policy(walk, tmp_path / "again.onnx")
    observation = np.random.default_rng(0).normal(size=(5, N_OBSERVATION)).astype(np.float32)
    np.testing.assert_array_equal(after.act(observation), before.act(observation))
    assert after.contract.model_copy(update={"gait": ()}) == before.contract.model_copy(update={"gait": ()})
    turning = {g.v_x_m_s: g for g in after.contract.gait}[1.0]
    assert turning.turn_commanded_rad_s == 1.0
    assert turning.turn_held_rad_s == pytest.approx(1.0, abs=0.1)
