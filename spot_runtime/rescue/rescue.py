"""The operator's service's hold on the process that makes a robot safe after its control process has died."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Final

from spot_model.io.child_process import ChildProcess
from spot_runtime.config import RunConfig
from spot_runtime.hal.connection.address import parse_address
from spot_runtime.rescue.guardian import start_rescuer
from spot_runtime.rescue.lease_note import note_folder, note_path
from spot_runtime.rescue.make_safe import MAY_HAVE_POWER, WITHIN_S

KILL_AFTER_S: Final = WITHIN_S + 35.0


class Rescue:
    """One attempt, by a process of its own. Nothing here waits for it."""

    def __init__(self, process: ChildProcess, note: Path) -> None:
        self._process, self._note = process, note
        self._deadline_s = time.monotonic() + KILL_AFTER_S

    @staticmethod
    def is_due(robot: str) -> bool:
        """Whether a control process has left this robot without bringing it to rest."""
        return note_path(str(parse_address(robot)), note_folder(os.environ)).exists()

    @staticmethod
    def start(robot: str, config: RunConfig, lock_step: str) -> Rescue:
        """Begin. Raises OSError where the system cannot start a process."""
        address, folder = str(parse_address(robot)), note_folder(os.environ)
        return Rescue(start_rescuer(address, config, folder, lock_step=lock_step), note_path(address, folder))

    def result(self) -> tuple[bool, str] | None:
        """Whether the robot is safe, and what was done; None while it is under way."""
        if self._process.exit_code is None:
            if time.monotonic() > self._deadline_s:
                self._process.kill()
            return None
        words = self._process.output.read(4096)
        code = self._process.end()
        # An exit code may be lost and read as 0; the note is gone only where the robot was made safe.
        is_safe = code == 0 and not self._note.exists()
        return is_safe, words.decode(errors="replace").strip() or f"{MAY_HAVE_POWER}: exit code {code}"
