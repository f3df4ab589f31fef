"""``spot-rl collect``: run all sequences that an identification needs, one after another; resumable."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from spot_model.console.command_line import INTERRUPTED_EXIT_CODE
from spot_model.console.command_registry import PolicyFile
from spot_model.errors import BadInputError, SpotRlError
from spot_model.process.child_process import module_command
from spot_model.process.signals import run_in_foreground
from spot_tools.options import ROBOT_ADDRESS, CaFile, CredentialsFile, LockStepAddress


class CollectionError(SpotRlError):
    """A collection is not complete."""

    exit_code = 4


class CollectionInterruptedError(SpotRlError):
    """Somebody ended the collection."""

    exit_code = INTERRUPTED_EXIT_CODE


def collect(
    policy: PolicyFile,
    out: Annotated[Path, typer.Option(help="Folder of the logs; complete runs in it are kept.")],
    robot: Annotated[str, ROBOT_ADDRESS] = "",
    plan: Annotated[
        bool, typer.Option("--plan", help="Record nothing: say what spot-rl sysid would determine from it.")
    ] = False,
    parameters: Annotated[
        Path | None, typer.Option(help="For --plan: parameters of the identification, as spot-rl sysid --config.")
    ] = None,
    sequences: Annotated[
        str,
        typer.Option(
            help="all (forward, six_directions, random, user), or a comma-separated list of names and YAML files."
        ),
    ] = "all",
    repeats: Annotated[int, typer.Option(min=1, max=1000, help="Runs of each sequence.")] = 5,
    other_gains: Annotated[
        str | None, typer.Option(help="Also run the first sequence once per repeat with other gains, KP,KD.")
    ] = None,
    config: Annotated[Path | None, typer.Option(help="Run configuration (YAML).")] = None,
    ca_file: CaFile = None,
    credentials_file: CredentialsFile = None,
    label: Annotated[list[str] | None, typer.Option(help="Label of the logs, KEY=VALUE; repeatable.")] = None,
    lock_step: LockStepAddress = None,
    attempts: Annotated[int, typer.Option(min=1, max=20, help="Attempts for a run that does not complete.")] = 2,
) -> None:
    """Record the paper's command sequences several times on a robot, for spot-rl sysid."""
    from trainer.collect.collect_run import Collection, run_arguments

    if plan:
        _plan(policy, out, sequences, repeats, parameters)
        return
    if not robot or parameters is not None:
        raise BadInputError("give --robot HOST to record, or --plan, with or without --parameters")
    collection = Collection.prepare(
        policy=policy, folder=out, sequences=sequences, repeats=repeats, other_gains=other_gains
    )
    options = {
        "--robot": robot,
        "--config": config,
        "--ca-file": ca_file,
        "--credentials-file": credentials_file,
        "--lock-step": lock_step,
    }
    shared = run_arguments(options, label or ())
    left = collection.record(shared, _start, attempts=attempts, say=lambda text: typer.echo(text, err=True))
    if left:
        names = ", ".join(f"{r.sequence.name} repeat {r.repeat}" for r in left)
        raise CollectionError(
            f"{len(left)} of {collection.n_planned} runs are missing: {names}; give the command again"
        )
    typer.echo(f"{collection.n_planned} whole runs in {out}")


def _plan(policy: Path, out: Path, sequences: str, repeats: int, parameters: Path | None) -> None:
    from spot_model.io.whole import check_new, write_new
    from spot_model.policy.policy import load_policy
    from trainer.collect.plan import PLAN_NAME, make_plan, plan_text
    from trainer.sysid.config import SysidConfig, load_sysid_config

    check_new(out / PLAN_NAME)
    config = SysidConfig() if parameters is None else load_sysid_config(parameters)
    made = make_plan(load_policy(policy), config, sequences, repeats, lambda text: typer.echo(text, err=True))
    out.mkdir(parents=True, exist_ok=True)
    write_new(out / PLAN_NAME, made.model_dump_json(by_alias=True, indent=1) + "\n")
    typer.echo(plan_text(made))


def _start(arguments: list[str]) -> int:
    """One run, to its end; after a Ctrl-C no other begins."""
    ended = run_in_foreground(module_command("spot_model", *arguments))
    if ended.is_interrupted:
        raise CollectionInterruptedError("interrupted; whole runs are kept: give the command again to go on")
    return ended.code
