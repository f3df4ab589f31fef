"""Where a training's metrics go, by rsl-rl's own writers, and Ctrl-C in it."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rsl_rl.utils import wandb_log_writer

from spot_model.errors import BadInputError
from trainer.config.train_config import TrainConfig
from trainer.ppo.checkpoint import find_checkpoint
from trainer.ppo.train import make_runner
from trainer.ppo.training_log import StopRequest, TrainingInterruptedError, TrainingLog

METRICS = {"iteration": 3, "loss/value": 0.5, "steps_per_s": 5.0, "reward": 2.5, "collect_s": 1.0, "learn_s": 1.0}


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
def make_log(tmp_path: Path, tiny: TrainConfig) -> Callable[[str], TrainingLog]:
    return lambda logger: TrainingLog(tmp_path, tiny.model_copy(update={"logger": logger}))


def test_weights_and_biases_get_every_metric_once(
    make_log: Callable[[str], TrainingLog], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wandb = HandMadeWandb()
    monkeypatch.setattr(wandb_log_writer, "wandb", wandb)
    log = make_log("wandb")
    log.open()
    log.log(METRICS)
    log.close()
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
        make_log("wandb").open()


def test_tensorboard_asks_nobody(make_log: Callable[[str], TrainingLog], tmp_path: Path) -> None:
    log = make_log("tensorboard")
    log.open()
    log.log(METRICS)
    log.close()
    assert list((tmp_path / "tensorboard").iterdir())


def test_the_first_signal_is_a_request_and_the_second_acts_as_before() -> None:
    request = StopRequest()
    with request.listening():
        os.kill(os.getpid(), signal.SIGINT)
        assert request.is_made
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_request_saves_at_once_and_says_how_to_go_on(tmp_path: Path, tiny: TrainConfig) -> None:
    runner = make_runner(tiny.model_copy(update={"iterations": 100, "save_every": 50}), tmp_path, "cpu")
    runner.save_if_due(6)
    assert not list(tmp_path.glob("*.pt"))
    runner.stop_request.is_made = True
    with pytest.raises(TrainingInterruptedError, match=r"iteration 7 of 100.*--resume"):
        runner.save_if_due(7)
    assert find_checkpoint(tmp_path).name == "checkpoint_000007.pt"
