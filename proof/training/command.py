"""``spot-rl bench train``; ``python -m proof.training.command`` where the package is not installed."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Annotated

import typer

from spot_model.console.options import AsJson, Overrides, TorchDevice


def train(
    config: Annotated[Path | None, typer.Option("--config", help="Config file; default: the paper's task.")] = None,
    set_: Overrides = None,
    device: TorchDevice = "cpu",
    iterations: Annotated[int, typer.Option("--iterations", help="How many to time.", min=1)] = 5,
    as_json: AsJson = False,
) -> None:
    """Measure the speed of training: physics, task, learning."""
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    from proof.training.speed import bench_train
    from trainer.config.train_config import config_from_data, load_config
    from trainer.ppo.train import is_first_process, local_device
    from trainer.simulate.engine import check_device

    overrides = tuple(set_ or ())
    default = {"name": "bench", "iterations": 1}
    checked = (
        config_from_data(default, source="bench", overrides=overrides)
        if config is None
        else load_config(config, overrides)
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


if __name__ == "__main__":
    typer.run(train)
