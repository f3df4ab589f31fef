"""What a training run writes and shows: metrics, TensorBoard, checkpoints, and a bar with the time that is left."""

from __future__ import annotations

import json
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsl_rl.utils import WandbLogWriter
from torch.utils.tensorboard import SummaryWriter

from spot_model.errors import BadInputError, SpotRlError
from spot_model.io.progress import Progress
from trainer.ppo.checkpoint import save_checkpoint

if TYPE_CHECKING:
    from trainer.ppo.runner import PpoRunner
    from trainer.ppo.vec_env import TaskVecEnv


class TrainingInterruptedError(SpotRlError):
    """The user stopped a training; its last iteration is saved."""

    exit_code = 130


class StopRequest:
    """Whether the user has asked a training to stop."""

    def __init__(self) -> None:
        self.is_made = False

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Take the first SIGINT or SIGTERM as a request; a second one acts as usual, at once."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

        def give_back() -> None:
            for number, handler in before.items():
                signal.signal(number, handler)

        def ask(*_: Any) -> None:
            self.is_made = True
            give_back()

        for number in before:
            signal.signal(number, ask)
        try:
            yield
        finally:
            give_back()


class TrainingLog:
    """Stands in for rsl-rl's logger; only the first of several processes writes."""

    def __init__(
        self,
        folder: Path,
        env: TaskVecEnv,
        *,
        save_every: int,
        total_iterations: int,
        steps_per_iteration: int,
        is_first: bool = True,
        logger: str = "tensorboard",
    ) -> None:
        self.writer: SummaryWriter | None = None
        self._folder = folder
        self._env = env
        self._save_every = save_every
        self._total = total_iterations
        self._steps_per_iteration = steps_per_iteration
        self._is_first = is_first
        self._logger = logger
        self._progress: Progress | None = None
        self._unwritten: dict[str, float] | None = None
        self.stop_request = StopRequest()

    def init_logging_writer(self) -> None:
        """Open the files.

        Raises:
            BadInputError: Weights & Biases are asked for and not installed.
        """
        if not self._is_first:
            return
        if self._logger == "tensorboard":
            self.writer = SummaryWriter(log_dir=str(self._folder / "tensorboard"), flush_secs=30)
            return
        try:
            # The run is named after the folder.
            self.writer = WandbLogWriter(log_dir=str(self._folder), project_name="spot-rl")
        except ModuleNotFoundError as error:
            raise BadInputError(
                "logger 'wandb' needs the package wandb, which is not installed: pip install wandb"
            ) from error

    def log(
        self,
        iteration: int,
        *,
        collect_time: float,
        learn_time: float,
        loss_dict: dict[str, float],
        learning_rate: float,
        action_std: float,
    ) -> None:
        """Take one iteration's metrics; :meth:`write` writes them, at the latest when the files are closed."""
        self.write()
        metrics: dict[str, float] = {
            "iteration": iteration,
            "steps": (iteration + 1) * self._steps_per_iteration,
            "collect_s": collect_time,
            "learn_s": learn_time,
            "steps_per_s": self._steps_per_iteration / (collect_time + learn_time),
            "learning_rate": learning_rate,
            "action_std": action_std,
            "command_share": self._env.task.command_share,
            **{f"loss/{key}": float(value) for key, value in loss_dict.items()},
            **self._env.task.drain_stats(),
            "unix_s": time.time(),
        }
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
            self._progress = Progress("iterations", self._total, done=iteration, already_s=already_s)
        self._progress.update(iteration + 1, _summary(metrics))

    def checkpoint(self, runner: PpoRunner, iteration: int) -> None:
        """Save if it is time, or the end.

        Raises:
            TrainingInterruptedError: The user asked to stop; the checkpoint is written.
        """
        done = iteration + 1
        path = self._folder / f"checkpoint_{done:06d}.pt"
        is_time = self.stop_request.is_made or done % self._save_every == 0 or done == self._total
        if is_time and self._is_first and not path.exists():
            save_checkpoint(path, runner, done)
        if self.stop_request.is_made and done < self._total:
            raise TrainingInterruptedError(
                f"stopped after iteration {done} of {self._total}; {path} is saved: go on with "
                f"spot-rl train --resume {self._folder}"
            )

    def stop_logging_writer(self) -> None:
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
    told = (("reward", "return {:.2f}"), ("episode_length", "{:.0f} ticks an episode"), ("fall_share", "{:.0%} fell"))
    parts += [words.format(metrics[key]) for key, words in told if key in metrics]
    return "  ".join(parts)
