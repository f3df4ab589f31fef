"""Bring a robot to rest whose control process has died."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from spot_runtime.rescue.lease_note import note_folder
from spot_runtime.rescue.make_safe import WITHIN_S, make_safe_by_note
from spot_tools.options import CaFile, ConfigFile, CredentialsFile, LockStepAddress, RobotAddress, resolve_config


def make_safe(
    robot: RobotAddress,
    config: ConfigFile = None,
    ca_file: CaFile = None,
    credentials_file: CredentialsFile = None,
    state_dir: Annotated[
        Path | None, typer.Option(help="Folder of the note that the dead process left; default: the service's folder.")
    ] = None,
    within: Annotated[
        float, typer.Option(min=0.0, max=600.0, help="Seconds after which it stops retrying.")
    ] = WITHIN_S,
    lock_step: LockStepAddress = None,
) -> None:
    """Sit a robot down and cut its power after its control process died, unless another client has it.

    Does nothing if no process on this computer left a robot under control; never uses another client's lease.
    """
    settings = resolve_config(config, ca_file=ca_file, credentials_file=credentials_file, log_dir=None)
    folder = state_dir or note_folder(os.environ)
    typer.echo(make_safe_by_note(robot, settings, folder, lock_step=lock_step or "", within_s=within))
