"""``spot-rl bench train``."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Annotated

import typer


def train(
    config: Annotated[Path | None, typer.Option("--config", help="Config file; default: the paper's task.")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="Override: key.path=value; repeatable.")] = None,
    device: Annotated[str, typer.Option("--device", help="cpu, cuda or cuda:N.")] = "cpu",
    iterations: Annotated[int, typer.Option("--iterations", help="How many to time.", min=1)] = 5,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Measure the speed of training: physics, task, learning."""
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    from proof.training.speed import bench_train
    from trainer.config.train_config import config_from_data, load_config
    from trainer.ppo.train import is_first_process, local_device
    from trainer.simulate.device import check_device

    overrides = tuple(set_ or ())
    if config is None:
        data = {"name": "bench", "iterations": 1}
        checked = config_from_data(data, source="bench", overrides=overrides)
    else:
        checked = load_config(config, overrides)
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
