"""What a user may ask of a fake robot, and the folder in which it keeps certificates and password between runs."""

from __future__ import annotations

import os
import secrets
import stat
from dataclasses import dataclass
from pathlib import Path

from fake_robot.services.auth import Credentials
from fake_robot.start.certificates import locked_folder, write_private
from spot_model.errors import BadInputError, SpotRlError

DEFAULT_USERNAME = "user"
PASSWORD_FILE = "password"  # noqa: S105 - a file's name
MAX_PASSWORD_BYTES = 1024


class StateFolderError(SpotRlError):
    """The folder cannot be used."""


def default_state_folder() -> Path:
    """``$XDG_STATE_HOME/spot-rl/fake-robot``, by default in ``~/.local/state``."""
    base = os.environ.get("XDG_STATE_HOME")
    root = Path(base) if base and Path(base).is_absolute() else Path.home() / ".local" / "state"
    return root / "spot-rl" / "fake-robot"


def ensure_credentials(folder: Path, *, username: str = DEFAULT_USERNAME) -> Credentials:
    """The user name, and the password that the folder holds; one is made up on the first run.

    Raises:
        StateFolderError: The folder or the file cannot be used.
    """
    path = folder / PASSWORD_FILE
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        with locked_folder(folder):
            if not path.exists():
                write_private(path, secrets.token_urlsafe(12).encode() + b"\n")
        return Credentials(username, read_password(path))
    except OSError as error:
        told = error.strerror or error
        raise StateFolderError(f"the folder {folder} cannot be used: {told}; choose --state-dir") from error


def read_password(path: Path) -> str:
    """Read a password from the first line of a file that only its owner can read. Raises BadInputError."""
    try:
        mode = path.stat().st_mode
        content = path.read_bytes()[: MAX_PASSWORD_BYTES + 1]
    except OSError as error:
        raise BadInputError(f"the password file {path} cannot be read: {error.strerror}") from error
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise BadInputError(f"the password file {path} can be read by others (mode {mode & 0o777:o}); chmod 600 it")
    try:
        password = content.decode().partition("\n")[0].rstrip("\r")
    except UnicodeDecodeError:
        password = ""
    if not password or len(content) > MAX_PASSWORD_BYTES:
        raise BadInputError(f"the password file {path} must hold one line of 1 to {MAX_PASSWORD_BYTES} bytes of text")
    return password


@dataclass(frozen=True)
class FakeOptions:
    """What the command line asked for."""

    scenario: str = ""
    lock_step: bool = False
    address: str = "127.0.0.1"
    port: int = 8443
    socket: Path | None = None
    admin: str = ""
    state_dir: Path | None = None
    username: str = DEFAULT_USERNAME
    password_file: Path | None = None
