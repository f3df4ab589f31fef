"""``spot-rl bench sysid``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer


def sysid(
    policy: Annotated[Path, typer.Option("--policy", help="Policy to run.")] = Path("policies/walk.onnx"),
    workers: Annotated[int, typer.Option("--workers", min=1, max=256, help="Processes.")] = 2,
    generations: Annotated[int, typer.Option("--generations", min=1, help="Generations to time.")] = 3,
    population: Annotated[int, typer.Option("--population", min=4, help="Candidates of a generation.")] = 10,
    device: Annotated[str, typer.Option("--device", help="Where the physics runs: cpu, or cuda.")] = "cpu",
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Measure the speed of an identification against a plain mj_step loop."""
    from proof.identification.speed import bench_sysid

    result = bench_sysid(policy, workers=workers, generations=generations, population=population, device=device)
    if as_json:
        typer.echo(json.dumps(result))
        return
    for key, value in result.items():
        typer.echo(f"{key:>27} {value:g}")
