"""Options that several commands share, and the configuration that they make.

A command's help needs the options alone, so what else it needs is imported where it runs.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from spot_model.errors import BadInputError
from spot_runtime.hal.address import as_people_write_it

if TYPE_CHECKING:
    from spot_runtime.config import RunConfig

CA_VARIABLE = "SPOT_RL_CA_FILE"


ROBOT_ADDRESS = typer.Option(help="Address: HOST, HOST:PORT or unix:/path.", callback=as_people_write_it)
RobotAddress = Annotated[str, ROBOT_ADDRESS]
ConfigFile = Annotated[Path | None, typer.Option(help="YAML configuration.")]
CaFile = Annotated[Path | None, typer.Option(help=f"Certificate to trust beside the vendor's; also {CA_VARIABLE}.")]
CredentialsFile = Annotated[Path | None, typer.Option(help="File with user name and password of the robot.")]
LockStepAddress = Annotated[str | None, typer.Option(help="Admin address of a fake robot in lock-step mode.")]


def resolve_config(
    path: Path | None,
    *,
    ca_file: Path | None,
    credentials_file: Path | None,
    log_dir: Path | None,
    hal: str | None = None,
) -> RunConfig:
    """The configuration of the file, with what the command line and the environment say in its place."""
    from spot_runtime.config import RunConfig, load_config

    config = RunConfig() if path is None else load_config(path)
    from_environment = os.environ.get(CA_VARIABLE)
    ca = ca_file or config.robot.ca_file or (Path(from_environment) if from_environment else None)
    robot = config.robot.model_copy(
        update={
            "ca_file": ca,
            "credentials_file": credentials_file or config.robot.credentials_file,
            "hal": hal or config.robot.hal,
        }
    )
    log = config.log.model_copy(update={"directory": log_dir or config.log.directory})
    for path in (robot.ca_file, robot.credentials_file, log.directory):
        check_encodable(path)
    return config.model_copy(update={"robot": robot, "log": log})


def check_encodable(path: Path | None) -> None:
    """Refuse a path that cannot stand in a log's header or a run's specification, which are UTF-8.

    Raises:
        BadInputError: It holds other bytes.
    """
    try:
        str(path).encode()
    except UnicodeEncodeError as error:
        raise BadInputError(f"path {str(path)!r} is no UTF-8; rename it, or name another") from error
