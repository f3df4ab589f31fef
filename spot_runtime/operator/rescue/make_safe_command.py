"""Bring a robot to rest whose control process has died."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Optional

import typer

from spot_runtime.rescue.lease_note import note_folder
from spot_runtime.rescue.make_safe import WITHIN_S, make_safe_by_note
from spot_runtime.session.run_command import resolve_config


def make_safe(
    robot: Annotated[str, typer.Option(help="Address: HOST, HOST:PORT or unix:/path.")],
    config: Annotated[Optional[Path], typer.Option(help="YAML configuration.")] = None,  # noqa: UP045
    ca_file: Annotated[
        Optional[Path], typer.Option(help="Certificate to trust beside the vendor's.")  # noqa: UP045
    ] = None,
    credentials_file: Annotated[
        Optional[Path], typer.Option(help="File with user name and password of the robot.")  # noqa: UP045
    ] = None,
    state_dir: Annotated[
        Optional[Path], typer.Option(help="Where the dead process left its note; the service's own folder if none.")  # noqa: UP045
    ] = None,
    within: Annotated[
        float, typer.Option(min=0.0, max=600.0, help="Seconds after which no new try is made.")
    ] = WITHIN_S,
    lock_step: Annotated[
        Optional[str], typer.Option(help="Admin address of a fake robot in lock-step mode.")  # noqa: UP045
    ] = None,
) -> None:
    """Let a robot sit and cut its power whose control process died, if nobody has had it since.

    Does nothing where no process of this computer has left a robot so, and never touches anybody else's lease.
    """
    settings = resolve_config(config, ca_file=ca_file, credentials_file=credentials_file, log_dir=None)
    folder = state_dir or note_folder(os.environ)
    typer.echo(make_safe_by_note(robot, settings, folder, lock_step=lock_step or "", within_s=within))
