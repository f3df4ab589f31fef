"""Options that say where a command computes."""

from __future__ import annotations

from enum import Enum
from typing import Annotated

import typer

from trainer.simulate.device import check_device
from trainer.simulate.engine import Place


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
