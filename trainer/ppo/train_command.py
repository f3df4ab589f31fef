"""``spot-rl train``."""

from __future__ import annotations

import os
from datetime import datetime, timezone
from pathlib import Path
from typing import Annotated

import typer

from spot_model.console.command_registry import Overrides, TorchDevice, TrainingConfig


def train(
    config: TrainingConfig = None,
    set_: Overrides = None,
    resume: Annotated[Path | None, typer.Option("--resume", help="Run folder of a training to continue.")] = None,
    device: TorchDevice = "cpu",
    out: Annotated[Path | None, typer.Option("--out", help="Run folder; default runs/NAME-TIME.")] = None,
) -> None:
    """Train a policy with PPO, on two cores or on GPUs (several: torchrun)."""
    # Spinning threads take the cores from the physics; torch reads this when it is first imported.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    from spot_model.errors import BadInputError
    from trainer.config.train_config import load_train_config

    overrides = tuple(set_ or ())
    if (config is None) == (resume is None):
        raise BadInputError("give either --config CONFIG or --resume RUN")
    # A mistake in the config is told before torch is loaded, which takes seconds.
    checked = load_train_config(config, overrides) if config is not None else None
    typer.echo("loading torch …", err=True)
    from trainer.ppo.checkpoint import command_line
    from trainer.ppo.train import resume as resume_run
    from trainer.ppo.train import train_policy as train_run

    if resume is not None:
        last = resume_run(resume, device=device, iterations=_iterations(overrides))
    else:
        assert checked is not None  # noqa: S101 - one of the two is given
        stamp = datetime.now(tz=timezone.utc).strftime("%Y%m%d-%H%M%S")
        last = train_run(
            checked, out or Path("runs") / f"{checked.name}-{stamp}", device=device, command=command_line()
        )
    typer.echo(f"checkpoint {last}")


def _iterations(overrides: tuple[str, ...]) -> int | None:
    from spot_model.errors import BadInputError

    value = None
    for override in overrides:
        key, _, text = override.partition("=")
        if key != "iterations" or not text.isdigit():
            raise BadInputError(f"override {override!r}: a resumed run keeps its config; allowed: iterations=N")
        value = int(text)
    return value
