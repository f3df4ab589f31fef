"""Bring a robot to rest whose control process has died."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Optional

import typer

from spot_runtime.config import RunConfig
from spot_runtime.hal.connection.address import parse_address
from spot_runtime.operator.rescue.lease_note import HeldNote, note_folder, note_path
from spot_runtime.operator.rescue.make_safe import WITHIN_S, NotSafeError, Safety
from spot_runtime.operator.rescue.make_safe import make_safe as make_one_safe
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
    typer.echo(mend(robot, settings, folder, lock_step=lock_step or "", within_s=within))


def mend(robot: str, config: RunConfig, folder: Path, *, lock_step: str, within_s: float) -> str:
    """Make one robot safe if there is a note of it. Returns what was done.

    Raises:
        NotSafeError: It could not be done; the note stays, for the next try.
        SpotRlError: The note cannot be read, its writer lives, or an address or a file is not valid.
    """
    address = str(parse_address(robot))
    found = HeldNote.find(note_path(address, folder))
    if found is None:
        return f"nothing to do: no process of this computer has left {address} with power"
    held, note = found
    try:
        attempt = make_one_safe(note, config, lock_step=lock_step, within_s=within_s)
    except NotSafeError:
        held.let_go()
        raise
    held.remove()
    verb = "was left to its holder" if attempt.safety is Safety.NOT_OURS else "is safe"
    return f"{address} {verb} after {attempt.took_s:.1f} s: {attempt.safety.value}"
