"""``spot-rl sysid``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from spot_model.console.command_registry import PolicyFile
from trainer.simulate.engine import Device, EngineName, EngineOption, RayAddress, Workers, place_of


def sysid(
    logs: Annotated[list[Path], typer.Argument(help="Log files of one policy, or folders of them.")],
    policy: PolicyFile,
    out: Annotated[Path, typer.Option("--out", help="Folder for the result; nothing in it is overwritten.")],
    config: Annotated[
        Path | None, typer.Option("--config", help="Parameters and settings of the search (YAML).")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue an interrupted search in --out.")] = False,
    workers: Workers = 2,
    engine: EngineOption = EngineName.LOCAL,
    device: Device = "cpu",
    ray_address: RayAddress = None,
) -> None:
    """Identify a robot's physical parameters from its logs (Wasserstein, MMD and CMA-ES, and measured torques)."""
    from spot_model.io.whole import check_new
    from spot_model.policy.policy import load_policy

    loaded = load_policy(policy)
    typer.echo("loading the simulator …", err=True)
    from trainer.sysid.config import default_config, load_sysid_config
    from trainer.sysid.logs import read_identification_logs
    from trainer.sysid.result import OUTPUTS
    from trainer.sysid.run_identification import run_identification

    check_new(*(out / name for name in OUTPUTS))
    settings = load_sysid_config(config) if config is not None else default_config(device)
    log_set = read_identification_logs(logs, loaded)
    for warning in log_set.warnings:
        typer.echo(f"note: {warning}", err=True)
    run_identification(
        log_set,
        policy,
        settings,
        out,
        resume=resume,
        place=place_of(workers, engine, ray_address, device),
        say=typer.echo,
    )
