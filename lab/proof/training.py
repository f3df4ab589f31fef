"""``spot-rl bench train``: how fast training is, and where the time goes. What brings torch is imported late."""

from __future__ import annotations

import contextlib
import io
import json
import os
import platform
import resource
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from spot_model.console.command_registry import AsJson, Overrides, TorchDevice
from spot_model.robot import facts
from trainer.config.train_config import TrainConfig, load_train_config, train_config_from_data

if TYPE_CHECKING:
    from trainer.ppo.runner import PpoRunner

WARM_UP_ITERATIONS = 2
"""On a GPU, the first loads kernels and the second records graphs."""


def train(
    config: Annotated[Path | None, typer.Option("--config", help="Config file; default: the paper's task.")] = None,
    set_: Overrides = None,
    device: TorchDevice = "cpu",
    iterations: Annotated[int, typer.Option("--iterations", help="How many to time.", min=1)] = 5,
    as_json: AsJson = False,
) -> None:
    """Measure the speed of training: physics, task, learning."""
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # read by torch, when it is imported
    from trainer.ppo.train import is_first_process, local_device
    from trainer.simulate.engine import check_device

    overrides = tuple(set_ or ())
    default = {"name": "bench", "iterations": 1}
    checked = (
        train_config_from_data(default, source="bench", overrides=overrides)
        if config is None
        else load_train_config(config, overrides)
    )
    device = local_device(device)
    check_device(device)
    result = bench_train(checked, device, iterations=iterations)
    if not is_first_process():
        return
    if as_json:
        typer.echo(json.dumps(result))
        return
    for key, value in result.items():
        typer.echo(f"{key:>22} {value}")


def bench_train(config: TrainConfig, device: str, *, iterations: int = 5) -> dict[str, Any]:
    """Train for a few iterations and time physics, task and learning.

    Args:
        config: What to train; its iterations are ignored.
        device: "cpu", or a CUDA device.
        iterations: How many to time, after two for warming up.

    Returns:
        ``processes`` (that torchrun started; the speeds are theirs together), ``device``, ``host`` (processors),
        ``n_envs`` of each,
        ``network``, ``policy_steps_per_s`` (with learning), ``collect_steps_per_s``, ``collect_core_us`` (CPU time of a
        robot's step while collecting, µs, which other work hardly changes), ``core_us`` (the same with learning),
        ``physics_steps_per_s``, the shares of physics, task and learning in an iteration, ``peak_memory_mb``.
    """
    import torch

    from trainer.ppo.train import make_runner

    config = config.model_copy(update={"iterations": iterations + WARM_UP_ITERATIONS, "save_every": 10**9})
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stderr(io.StringIO()):
        runner = make_runner(config, Path(folder), device)
        runner.alg.train_mode()
        for _ in range(WARM_UP_ITERATIONS):
            _iterate(runner, device)
        times = [_iterate(runner, device) for _ in range(iterations)]
        physics_s = _physics_s(runner, device)
    steps = config.ppo.steps_per_iteration
    collect_s, learn_s, collect_core_s, core_s = (sum(column) / iterations for column in zip(*times, strict=True))
    total_s = collect_s + learn_s
    substeps = config.task.physics_rate_hz / facts.POLICY_RATE_HZ
    return {
        "processes": runner.gpu_world_size,
        "device": device if device == "cpu" else torch.cuda.get_device_name(device),
        "host": _processor(),
        "n_envs": config.n_envs,
        "network": list(config.ppo.hidden),
        "policy_steps_per_s": round(runner.gpu_world_size * config.n_envs * steps / total_s),
        "collect_steps_per_s": round(runner.gpu_world_size * config.n_envs * steps / collect_s),
        "collect_core_us": round(1e6 * collect_core_s / (config.n_envs * steps), 1),
        "core_us": round(1e6 * core_s / (config.n_envs * steps), 1),
        "physics_steps_per_s": round(runner.gpu_world_size * config.n_envs * substeps / physics_s),
        "physics_share": round(physics_s * steps / total_s, 4),
        "task_share": round((collect_s - physics_s * steps) / total_s, 4),
        "learning_share": round(learn_s / total_s, 4),
        "peak_memory_mb": round(_peak_memory_mb(device)),
    }


def _iterate(runner: PpoRunner, device: str) -> tuple[float, float, float, float]:
    """One iteration; seconds of collecting and of learning, then CPU time of collecting and of both."""
    start, core_start = _now(device), time.process_time()
    runner.collect()
    runner.check_finite()
    collected, core_s = _now(device), time.process_time() - core_start
    runner.alg.update()
    return collected - start, _now(device) - collected, core_s, time.process_time() - core_start


def _physics_s(runner: PpoRunner, device: str, n: int = 20) -> float:
    """Seconds of one policy period of physics alone, from where training stands."""
    import torch

    from spot_model.plant.captured import Captured

    env = runner.env
    pose = torch.tensor(facts.DEFAULT_POSITION_RAD, device=device, dtype=torch.float32)
    setpoints = [pose.repeat(size, 1) for size in env.sizes]

    def advance() -> None:
        env.side_by_side(lambda i: env.parts[i].backend.step(setpoints[i]))

    period = Captured(advance, env.generators, is_recorded=device != "cpu")
    with torch.inference_mode():
        for _ in range(WARM_UP_ITERATIONS):
            period()
        start = _now(device)
        for _ in range(n):
            period()
        return (_now(device) - start) / n


def _now(device: str) -> float:
    if device != "cpu":
        import torch

        torch.cuda.synchronize(device)
    return time.perf_counter()


def _peak_memory_mb(device: str) -> float:
    if device == "cpu":
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    import torch

    free, total = torch.cuda.mem_get_info(device)
    return (total - free) / 2**20


def _processor() -> str:
    """Name of the host's processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{len(names)} × {names[0]}" if names else platform.machine()


if __name__ == "__main__":
    typer.run(train)
