import json
from pathlib import Path

import typer
from typer.testing import CliRunner

from proof.training import train
from spot_model.errors import BadInputError
from tests.trainer.conftest import commands

CONFIG = str(Path(__file__).parents[2] / "policies" / "walk.yaml")


def fails(*words: str) -> str:
    result = CliRunner().invoke(commands(), list(words))
    assert isinstance(result.exception, BadInputError), result.output
    return str(result.exception)


def test_train_says_what_is_wrong() -> None:
    assert "give either --config CONFIG or --resume RUN" in fails("train")
    assert "'gate' is unknown" in fails("train", "--config", CONFIG, "--set", "rewards.gate=1")
    assert "does not exist" in fails("train", "--config", "nowhere.yaml")
    assert "a resumed run keeps its config" in fails("train", "--resume", "runs/x", "--set", "seed=3")
    assert "'tpu' is unknown" in fails("train", "--config", CONFIG, "--device", "tpu")


def test_export_and_evaluate_say_what_is_wrong(tmp_path: Path) -> None:
    assert "has no checkpoint_" in fails("export", str(tmp_path))
    policy = str(Path(CONFIG).with_name("walk.onnx"))
    assert "must divide the policy's period" in fails("evaluate", policy, "--timestep", "0.003")
    assert "must be one of Euler" in fails("evaluate", policy, "--integrator", "magic")


def test_train_export_end_to_end(tmp_path: Path) -> None:
    run, out = tmp_path / "run", tmp_path / "p.onnx"
    small = ["n_envs=4", "iterations=1", "ppo.hidden=[8]", "ppo.mini_batches=1", "ppo.steps_per_iteration=4"]
    options = [word for override in small for word in ("--set", override)]
    result = CliRunner().invoke(commands(), ["train", "--config", CONFIG, "--out", str(run), *options])
    assert result.exit_code == 0, result.output
    assert "checkpoint_000001.pt" in result.output
    result = CliRunner().invoke(commands(), ["export", str(run), "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "warning: policy walk falls at" in result.output
    assert out.is_file()


def test_bench_prints_one_json_object() -> None:
    small = ["n_envs=4", "ppo.hidden=[8]", "ppo.mini_batches=1", "ppo.steps_per_iteration=2"]
    options = [word for override in small for word in ("--set", override)]
    bench = typer.Typer()
    bench.command()(train)
    result = CliRunner().invoke(bench, ["--json", "--iterations", "1", *options])
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["device"] == "cpu"
