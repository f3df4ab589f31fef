"""Serve one robot's operator, and bring a robot to rest whose control process has died."""

from __future__ import annotations

import os
import signal
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from spot_model.errors import BadInputError
from spot_model.process.signals import STOP_SIGNALS, answered, exit_on_termination
from spot_runtime.hal.address import parse_address
from spot_runtime.rescue.lease_note import WITHIN_S, note_folder
from spot_tools.options import (
    CaFile,
    ConfigFile,
    CredentialsFile,
    LockStepAddress,
    RobotAddress,
    check_encodable,
    resolve_config,
)

if TYPE_CHECKING:
    from spot_runtime.config import RunConfig
    from spot_runtime.host.journal import Console


def serve(
    robot: RobotAddress,
    policies: Annotated[
        Path | None,
        typer.Option(help="Folder of the policies that may be armed, by name; else ./policies, or the built-in ones."),
    ] = None,
    listen: Annotated[
        str | None, typer.Option(help="unix:/path or HOST:PORT; other hosts need the configuration's tls_ files.")
    ] = None,
    config: ConfigFile = None,
    ca_file: CaFile = None,
    credentials_file: CredentialsFile = None,
    log_dir: Annotated[Path | None, typer.Option(help="Folder of the logs.")] = None,
    live_port: Annotated[
        int | None, typer.Option(min=1, max=65535, help="Also show the run live in Foxglove, on this local port.")
    ] = None,
    lock_step: LockStepAddress = None,
) -> None:
    """Start the operator's service for a robot; it is idle, without a lease, until 'spot-rl ctl arm'."""
    from spot_log.write.live_process import LiveProcess
    from spot_log.write.run_writer import make_log_folder
    from spot_runtime.config import for_lock_step
    from spot_runtime.host.journal import Console
    from spot_runtime.session.run import recover_at_start

    settings = resolve_config(config, ca_file=ca_file, credentials_file=credentials_file, log_dir=log_dir)
    settings = settings if lock_step is None else for_lock_step(settings)
    changes = {"policies": policies, "listen": listen, "live_port": live_port}
    service = settings.service.model_copy(update={k: v for k, v in changes.items() if v is not None})
    settings = settings.model_copy(update={"service": service})
    parse_address(robot)
    if service.policies is not None:
        check_encodable(service.policies)
    if service.policies is not None and not service.policies.is_dir():
        raise BadInputError(f"there is no folder {service.policies} with policies; name it with --policies")
    make_log_folder(settings.log.directory)
    console = Console()
    try:
        recover_at_start(settings.log.directory, console)
        with exit_on_termination(), ExitStack() as stack:
            if service.live_port:
                live = stack.enter_context(LiveProcess(service.live_port))
                console.say(f"live view: open {live.url} in Foxglove, with the layout deploy/spot-rl.foxglove.json")
            _serve(robot, settings, console, lock_step or "")
    finally:
        console.close()


def _serve(robot: str, config: RunConfig, console: Console, lock_step: str) -> None:
    from spot_runtime.host.journal import Journal, tell_by
    from spot_runtime.host.service_manager import ServiceManager
    from spot_runtime.operator.server.server import OperatorServer
    from spot_runtime.operator.server.supervisor import Supervisor

    manager = ServiceManager.from_environment(os.environ)
    tell = tell_by(Journal.if_heard(), console)
    supervisor = Supervisor(robot, config, manager=manager, tell=tell, lock_step=lock_step)
    ends: list[int] = []

    def end(number: int) -> None:
        if number == signal.SIGQUIT:
            supervisor.estop()
        ends.append(number)

    with answered(end, *STOP_SIGNALS):
        server = OperatorServer(supervisor, config)
        try:
            supervisor.begin()
            console.say(f"policies that may be armed: those in {supervisor.policies.folder}")
            console.say(f"idle; operators reach this service at {server.address}")
            manager.ready()
            manager.status("idle")
            while not ends:
                supervisor.turn()
            manager.stopping()
            console.say("ending")
            supervisor.shut_down()
        finally:
            server.close()


def make_safe(
    robot: RobotAddress,
    config: ConfigFile = None,
    ca_file: CaFile = None,
    credentials_file: CredentialsFile = None,
    state_dir: Annotated[
        Path | None, typer.Option(help="Folder of the note that the dead process left; default: the service's folder.")
    ] = None,
    within: Annotated[
        float, typer.Option(min=0.0, max=600.0, help="Seconds without an answer of the robot after which it gives up.")
    ] = WITHIN_S,
    lock_step: LockStepAddress = None,
) -> None:
    """Sit a robot down and cut its power after its control process died, unless another client commands it.

    Does nothing if no process on this computer left a robot under control; never uses another client's lease, but waits
    until it is free.
    """
    from spot_runtime.rescue.make_safe import make_safe_by_note, when_new

    settings = resolve_config(config, ca_file=ca_file, credentials_file=credentials_file, log_dir=None)
    folder = state_dir or note_folder(os.environ)
    tell = when_new(lambda words: typer.echo(words, err=True))
    typer.echo(make_safe_by_note(robot, settings, folder, lock_step=lock_step or "", within_s=within, tell=tell))
