"""``spot-rl sysid``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from spot_model.console.command_registry import PolicyFile
from trainer.simulate.engine import Device, EngineName, EngineOption, RayAddress, Workers, place_of


def sysid(
    policy: PolicyFile,
    out: Annotated[Path, typer.Option("--out", help="Folder for the result; nothing in it is overwritten.")],
    logs: Annotated[list[Path] | None, typer.Argument(help="Log files of one policy, or folders of them.")] = None,
    config: Annotated[
        Path | None, typer.Option("--config", help="Parameters and settings of the search (YAML).")
    ] = None,
    plan: Annotated[
        str | None,
        typer.Option(
            help="Without logs: say what recordings of these sequences would determine (as collect --sequences)."
        ),
    ] = None,
    repeats: Annotated[int, typer.Option(min=1, max=100, help="Runs of each sequence, for --plan.")] = 5,
    resume: Annotated[bool, typer.Option("--resume", help="Continue an interrupted search in --out.")] = False,
    workers: Workers = 2,
    engine: EngineOption = EngineName.LOCAL,
    device: Device = "cpu",
    ray_address: RayAddress = None,
) -> None:
    """Identify a robot's physical parameters from its logs (Wasserstein, MMD and CMA-ES, and measured torques)."""
    from spot_model.errors import BadInputError
    from spot_model.io.whole import check_new, write_new
    from spot_model.policy.policy import load_policy

    if bool(logs) == (plan is not None):
        raise BadInputError("give either LOGS to identify from, or --plan with the sequences that you mean to record")
    loaded = load_policy(policy)
    typer.echo("loading the simulator …", err=True)
    from trainer.sysid.config import default_config, load_sysid_config
    from trainer.sysid.logs import read_identification_logs
    from trainer.sysid.plan import PLAN_NAME, make_plan, plan_text
    from trainer.sysid.result import OUTPUTS
    from trainer.sysid.run_identification import run_identification

    settings = load_sysid_config(config) if config is not None else default_config(device)
    if plan is not None:
        check_new(out / PLAN_NAME)
        made = make_plan(loaded, settings, plan, repeats, say=lambda text: typer.echo(text, err=True))
        out.mkdir(parents=True, exist_ok=True)
        write_new(out / PLAN_NAME, made.model_dump_json(by_alias=True, indent=1) + "\n")
        typer.echo(plan_text(made))
        return
    check_new(*(out / name for name in OUTPUTS))
    log_set = read_identification_logs(logs or [], loaded)
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
