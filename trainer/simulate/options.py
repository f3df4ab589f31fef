"""Options that say where a command computes."""

from __future__ import annotations

from enum import Enum
from typing import Annotated

import typer


class EngineName(str, Enum):
    """Kinds of :class:`~trainer.simulate.engine.Place`."""

    LOCAL = "local"
    RAY = "ray"


Workers = Annotated[int, typer.Option("--workers", min=1, max=1024, help="Processes; the result is the same.")]
EngineOption = Annotated[
    EngineName, typer.Option("--engine", help="Where to compute: processes on this machine, or a Ray cluster.")
]
RayAddress = Annotated[
    str | None, typer.Option("--ray-address", help="A running Ray cluster; by default one is started here.")
]
