"""``logger``: where a training's metrics go, by rsl-rl's own writers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rsl_rl.utils import wandb_log_writer

from spot_model.errors import BadInputError
from trainer.ppo.training_log import TrainingLog

METRICS: dict[str, Any] = {
    "collect_time": 1.0,
    "learn_time": 1.0,
    "loss_dict": {"value": 0.5},
    "learning_rate": 1e-3,
    "action_std": 1.0,
}


class HandMadeWandb:
    """Counts what it is given, in the place of the package wandb."""

    def __init__(self) -> None:
        self.begun: list[dict[str, Any]] = []
        self.logged: list[tuple[dict[str, float], int]] = []
        self.finished = 0

    def init(self, **words: Any) -> None:
        self.begun.append(words)

    def log(self, values: dict[str, float], step: int) -> None:
        self.logged.append((values, step))

    def finish(self) -> None:
        self.finished += 1


@pytest.fixture
def make_log(tmp_path: Path) -> Callable[[str], TrainingLog]:
    env: Any = SimpleNamespace(task=SimpleNamespace(command_share=1.0, drain_stats=lambda: {"reward": 2.5}))

    def make(logger: str) -> TrainingLog:
        return TrainingLog(tmp_path, env, save_every=9, total_iterations=9, steps_per_iteration=10, logger=logger)

    return make


def test_weights_and_biases_get_every_metric_once(
    make_log: Callable[[str], TrainingLog], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wandb = HandMadeWandb()
    monkeypatch.setattr(wandb_log_writer, "wandb", wandb)
    log = make_log("wandb")
    log.init_logging_writer()
    log.log(3, **METRICS)
    log.stop_logging_writer()
    assert [b["name"] for b in wandb.begun] == [tmp_path.name]
    assert wandb.finished == 1
    told = {name: value for values, _ in wandb.logged for name, value in values.items()}
    assert {step for _, step in wandb.logged} == {3}
    assert (told["reward"], told["loss/value"], told["steps_per_s"]) == (2.5, 0.5, 5.0)
    assert list(tmp_path.glob("events.out.tfevents.*"))


def test_without_the_package_the_next_step_is_said(
    make_log: Callable[[str], TrainingLog], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(wandb_log_writer, "wandb", None)
    with pytest.raises(BadInputError, match=r"logger 'wandb' needs the package.*pip install wandb"):
        make_log("wandb").init_logging_writer()


def test_tensorboard_asks_nobody(make_log: Callable[[str], TrainingLog], tmp_path: Path) -> None:
    log = make_log("tensorboard")
    log.init_logging_writer()
    log.log(0, **METRICS)
    log.stop_logging_writer()
    assert list((tmp_path / "tensorboard").iterdir())
