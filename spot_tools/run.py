"""Run a policy or a joint experiment on a robot."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from spot_model.console.command_registry import OptionalPolicyFile
from spot_model.errors import BadInputError
from spot_model.process.signals import exit_on_termination
from spot_model.text import plain_lines
from spot_tools.options import CaFile, ConfigFile, CredentialsFile, LockStepAddress, RobotAddress, resolve_config

if TYPE_CHECKING:
    from spot_model.policy.policy import Policy
    from spot_runtime.config import RunConfig
    from spot_runtime.host.journal import Console
    from spot_runtime.session.summary import RunSummary
    from spot_runtime.sources import CommandSource


@exit_on_termination()
def run(
    robot: RobotAddress,
    policy: OptionalPolicyFile = None,
    experiment: Annotated[
        Path | None,
        typer.Option(help="In place of a policy: a joint experiment (YAML), which the standing robot follows."),
    ] = None,
    hal: Annotated[str | None, typer.Option(help="Adapter: spot, or one of your own.")] = None,
    sequence: Annotated[str | None, typer.Option(help="Velocity commands: a built-in name or a YAML file.")] = None,
    keyboard: Annotated[bool, typer.Option("--keyboard", help="Velocity commands from the keyboard.")] = False,
    gamepad: Annotated[bool, typer.Option("--gamepad", help="Velocity commands from a gamepad.")] = False,
    duration: Annotated[
        float | None, typer.Option(help="End after this many seconds of control; the sequence repeats.")
    ] = None,
    config: ConfigFile = None,
    ca_file: CaFile = None,
    credentials_file: CredentialsFile = None,
    log_dir: Annotated[Path | None, typer.Option("--log-dir", "--out", help="Folder of the log.")] = None,
    label: Annotated[list[str] | None, typer.Option(help="Label of the log, KEY=VALUE; repeatable.")] = None,
    repeat: Annotated[int, typer.Option(min=0, max=999_999, help="Number of this repetition, for the log.")] = 0,
    lock_step: LockStepAddress = None,
    summary_json: Annotated[Path | None, typer.Option(help="Also write the summary here, as JSON.")] = None,
) -> None:
    """Run a policy on a robot: connect, stand, hand over, follow velocity commands, hand back, sit, power off.

    With --experiment a joint experiment runs in the policy's place, under the same safety core.
    """
    from spot_log.write.logger_process import LoggerProcess
    from spot_log.write.run_writer import free_path, make_log_folder
    from spot_model.io.joint_experiment import load_joint_experiment
    from spot_model.io.whole import check_new, write_new
    from spot_model.policy.joint_script import joint_script
    from spot_model.policy.policy import load_policy
    from spot_runtime.admission import admission, check_scripts_allowed
    from spot_runtime.config import for_lock_step
    from spot_runtime.hal.registry import HalRequest, find_adapter
    from spot_runtime.host.instance_lock import InstanceLock
    from spot_runtime.host.journal import Console, Journal, tell_by
    from spot_runtime.host.service_manager import ServiceManager
    from spot_runtime.rescue.guarded import guarded
    from spot_runtime.session.labels import parse_labels
    from spot_runtime.session.run import RunRequest, log_file_name, recover_at_start, run_once
    from spot_tools.sources import JointScriptSource

    if summary_json is not None:
        check_new(summary_json)
    settings = resolve_config(config, ca_file=ca_file, credentials_file=credentials_file, log_dir=log_dir, hal=hal)
    settings = settings if lock_step is None else for_lock_step(settings)
    wanted = HalRequest(robot, settings, lock_step or "")
    adapter = find_adapter(wanted)
    labels = parse_labels(label or [])
    console = Console()
    loaded: Policy
    source: CommandSource
    if experiment is not None:
        if policy is not None or sequence is not None or keyboard or gamepad or duration is not None:
            raise BadInputError(
                "--experiment is a whole run; leave out --policy, --sequence, --keyboard, --gamepad and --duration"
            )
        check_scripts_allowed(settings.service)
        loaded = joint_script(load_joint_experiment(experiment))
        source = JointScriptSource(loaded)
    elif policy is None:
        raise BadInputError("nothing to run; give --policy NAME or FILE.onnx, or --experiment FILE.yaml")
    else:
        loaded = load_policy(policy, provider=settings.control.inference, admit=admission(settings.service, policy))
        source = make_source(
            settings, loaded, console, sequence=sequence, is_keyboard=keyboard, is_gamepad=gamepad, duration_s=duration
        )
    directory = settings.log.directory
    make_log_folder(directory)
    path = free_path(directory / log_file_name(loaded.contract.name, source.name, repeat))
    request = RunRequest(robot, loaded, source, settings, path, repeat, labels)

    recover_at_start(directory, console)
    manager = ServiceManager.from_environment(os.environ)
    tell = tell_by(Journal.if_heard(), console)
    try:
        adapter.check()
        with InstanceLock(adapter.robot):
            make_hal = guarded(adapter, wanted, tell=tell)
            summary = run_once(request, make_hal, LoggerProcess.start, console, manager=manager, tell=tell)
    finally:
        source.close()
        console.close()
    _say_last(summary_text(summary))
    if summary_json is not None:
        try:
            write_new(summary_json, summary.to_json() + "\n")
        except (OSError, BadInputError) as error:
            typer.echo(f"the summary {summary_json} cannot be written: {error}", err=True)
    raise typer.Exit(summary.exit_code)


def _say_last(text: str) -> None:
    """Print to standard output; a reader that has gone must not change the exit code."""
    try:
        typer.echo(plain_lines(text))
    except OSError:
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, sys.stdout.fileno())
        os.close(nothing)


def make_source(
    config: RunConfig,
    policy: Policy,
    console: Console,
    *,
    sequence: str | None,
    is_keyboard: bool,
    is_gamepad: bool,
    duration_s: float | None,
) -> CommandSource:
    """The one source of velocity commands that was asked for; the standing sequence where none was.

    Raises:
        BadInputError: More than one was asked for, or the one is not available.
    """
    import numpy as np

    from spot_model.io.velocity_sequence import load_sequence
    from spot_tools.sources import ScriptedSource, manual_source

    if (sequence is not None) + is_keyboard + is_gamepad > 1:
        raise BadInputError("--sequence, --keyboard and --gamepad exclude each other; give one")
    if duration_s is not None and not 0.0 < duration_s <= 86_400.0:
        raise BadInputError(f"--duration is {duration_s}; allowed: above 0, at most 86400 s")
    if is_keyboard or is_gamepad:
        return manual_source(config.operator, console.say, is_gamepad=is_gamepad)
    wanted = load_sequence(sequence or "standing")
    contract = policy.contract
    low, high = contract.velocity_command_low, contract.velocity_command_high
    clipped = wanted.clipped(np.array(low), np.array(high))
    if clipped != wanted:
        console.say(f"sequence {wanted.name}: commands are cut to the policy's range, {low} to {high}")
    return ScriptedSource(clipped, duration_s=duration_s)


def summary_text(end: RunSummary) -> str:
    """The end of a run, in a few lines for a person."""
    lines = [f"outcome            {end.outcome}: {end.sentence}"]
    if end.ticks:
        lines += [
            f"control            {end.control_robot_s:.1f} s of robot time in {end.control_wall_s:.1f} s",
            f"policy ticks       {end.ticks} at {end.rate_hz:.3f} Hz of robot time, {end.skipped_ticks} skipped",
            _pair("tick compute", end.tick_compute_p50_us, end.tick_compute_p99_us, "µs"),
            _pair("state to command", end.state_to_command_p50_ms, end.state_to_command_p99_ms, "ms"),
            _pair("state age, receipt", end.state_age_p50_ms, end.state_age_p99_ms, "ms"),
            _pair("state age, robot", end.acquisition_age_p50_ms, end.acquisition_age_p99_ms, "ms"),
        ]
    lost = end.log_dropped + end.log_unwritten
    lines.append(f"log                {end.log_path or 'none is left'} ({lost} messages lost)")
    if end.log_problem:
        lines.append(f"log's problem      {end.log_problem}")
    return "\n".join(lines)


def _pair(name: str, p50: float, p99: float, unit: str) -> str:
    digits = 0 if unit == "µs" else 2
    return f"{name:<18} p50 {p50:.{digits}f} {unit}, p99 {p99:.{digits}f} {unit}"
