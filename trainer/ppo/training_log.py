"""What a training run writes and shows: metrics, TensorBoard, and a bar with the time that is left; and its stop."""

from __future__ import annotations

import json
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rsl_rl.utils import WandbLogWriter
from torch.utils.tensorboard import SummaryWriter

from spot_model.console.progress import Progress
from spot_model.errors import BadInputError, SpotRlError
from spot_model.process.signals import answered
from trainer.config.train_config import TrainConfig


class TrainingInterruptedError(SpotRlError):
    """The user stopped a training; its last iteration is saved."""

    exit_code = 130


class StopRequest:
    """Whether the user has asked a training to stop."""

    def __init__(self) -> None:
        self.is_made = False

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Take the first SIGINT or SIGTERM as a request; a second one ends the program as Ctrl-C does, at once."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        with answered(self._ask, signal.SIGINT, signal.SIGTERM):
            yield

    def _ask(self, _: int) -> None:
        if self.is_made:
            raise KeyboardInterrupt
        self.is_made = True


class TrainingLog:
    """Stands in for rsl-rl's logger.

    Args:
        folder: Of the run.
        config: Of the run.
        is_writer: Whether this process writes; of several, only the first does.
    """

    def __init__(self, folder: Path, config: TrainConfig, *, is_writer: bool = True) -> None:
        self.writer: SummaryWriter | None = None
        self._folder, self._config, self._is_writer = folder, config, is_writer
        self._progress: Progress | None = None
        self._unwritten: dict[str, float] | None = None

    def open(self) -> None:
        """Open the files. Raises BadInputError: Weights & Biases are asked for and not installed."""
        if not self._is_writer:
            return
        if self._config.logger == "tensorboard":
            self.writer = SummaryWriter(log_dir=str(self._folder / "tensorboard"), flush_secs=30)
            return
        try:
            # The run is named after the folder.
            self.writer = WandbLogWriter(log_dir=str(self._folder), project_name="spot-rl")
        except ModuleNotFoundError as error:
            raise BadInputError(
                "logger 'wandb' needs the package wandb, which is not installed: pip install wandb"
            ) from error

    def log(self, metrics: dict[str, float]) -> None:
        """Take one iteration's metrics; :meth:`write` writes them, at the latest when the files are closed."""
        self.write()
        if self.writer is not None:
            self._unwritten = metrics

    def write(self) -> None:
        """Write and show the metrics last taken, if that has not been done."""
        metrics, self._unwritten = self._unwritten, None
        if metrics is None or self.writer is None:
            return
        iteration = int(metrics["iteration"])
        for key, value in metrics.items():
            if key != "unix_s":
                self.writer.add_scalar(key, value, iteration)
        with (self._folder / "metrics.jsonl").open("a", encoding="utf-8") as file:
            file.write(json.dumps(metrics) + "\n")
        if self._progress is None:
            already_s = metrics["collect_s"] + metrics["learn_s"]
            self._progress = Progress("iterations", self._config.iterations, done=iteration, already_s=already_s)
        self._progress.update(iteration + 1, _summary(metrics))

    def close(self) -> None:
        """Write what is left, and close the files."""
        self.write()
        if self.writer is not None:
            self.writer.close()
            if isinstance(self.writer, WandbLogWriter):
                self.writer.stop()
            self.writer = None
        if self._progress is not None:
            self._progress.stop()


def _summary(metrics: dict[str, float]) -> str:
    parts = [f"{metrics['steps_per_s']:,.0f} steps/s"]
    shown = (("reward", "return {:.2f}"), ("episode_length", "{:.0f} ticks an episode"), ("fall_share", "{:.0%} fell"))
    parts += [words.format(metrics[key]) for key, words in shown if key in metrics]
    parts += [f"{metrics['contacts_lost']:.2%} of contacts lost"] if metrics.get("contacts_lost") else []
    return "  ".join(parts)
