"""Options that commands of several packages share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]
PolicyFile = Annotated[Path, typer.Option("--policy", help="ONNX file with its contract.")]
Overrides = Annotated[list[str] | None, typer.Option("--set", help="Override: key.path=value; repeatable.")]
TorchDevice = Annotated[str, typer.Option("--device", help="cpu, cuda or cuda:N.")]
ScenarioName = Annotated[str, typer.Option("--scenario", help="Scenario of the fake robot.")]

WALK = Path("policies/walk.onnx")
"""The policy of commands that need any that walks."""
