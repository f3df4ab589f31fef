"""What a user may ask of a fake robot on the command line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from fake_robot.start.state_folder import DEFAULT_USERNAME


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
