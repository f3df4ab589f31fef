"""Options that say where a command computes, and whether that place exists."""

from __future__ import annotations

from enum import Enum
from typing import Annotated

import typer

from spot_model.errors import BadInputError
from trainer.simulate.engine import Place


def check_device(device: str) -> None:
    """Refuse a device that is not there.

    Raises:
        BadInputError: No such device; the message says what there is.
    """
    if device == "cpu":
        return
    import torch

    if not device.startswith("cuda"):
        raise BadInputError(f"device {device!r} is unknown; allowed: cpu, cuda, cuda:N")
    if not torch.cuda.is_available():
        raise BadInputError(
            f"device {device!r}: there is no usable NVIDIA GPU here (torch {torch.__version__}); "
            "use --device cpu, or a machine with a GPU and a CUDA build of torch"
        )
    index = torch.device(device).index or 0
    if index >= torch.cuda.device_count():
        raise BadInputError(f"device {device!r}: there are {torch.cuda.device_count()} GPUs, cuda:0 upwards")


class EngineName(str, Enum):
    """Kinds of :class:`~trainer.simulate.engine.Place`."""

    LOCAL = "local"
    RAY = "ray"


Workers = Annotated[int, typer.Option("--workers", min=1, max=1024, help="Processes; the result is the same.")]
EngineOption = Annotated[
    EngineName, typer.Option("--engine", help="Where to compute: processes on this machine, or a Ray cluster.")
]
Device = Annotated[
    str, typer.Option("--device", help="What simulates: cpu, or cuda for an NVIDIA GPU, which one process fills.")
]
RayAddress = Annotated[
    str | None, typer.Option("--ray-address", help="A running Ray cluster; by default one is started here.")
]


def place_of(workers: int, engine: EngineName, ray_address: str | None, device: str) -> Place:
    """The place that these options name.

    Raises:
        BadInputError: The device does not exist, or does not go with the engine.
    """
    check_device(device)
    return Place(workers if device == "cpu" else 1, engine is EngineName.RAY, ray_address, device)
