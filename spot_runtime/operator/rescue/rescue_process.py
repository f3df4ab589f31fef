"""The operator's service's hold on the process that makes a robot safe after its control process has died.

The module is also that process: the specification comes on standard input, what was done goes to standard output.
"""

from __future__ import annotations

import os
import sys
import time
from typing import Final

from pydantic import BaseModel, ConfigDict

from spot_model.errors import SpotRlError
from spot_model.io.child_process import ChildProcess
from spot_runtime.config import RunConfig
from spot_runtime.hal.connection.address import parse_address
from spot_runtime.operator.run.run_spec import MAX_SPEC_BYTES
from spot_runtime.rescue.lease_note import note_folder, note_path
from spot_runtime.rescue.make_safe import MAY_HAVE_POWER, WITHIN_S, make_safe_by_note

KILL_AFTER_S: Final = WITHIN_S + 35.0


class RescueSpec(BaseModel):
    """Which robot, and how it is reached."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    robot: str
    config: RunConfig
    lock_step: str = ""


class Rescue:
    """One attempt. Nothing here waits for it."""

    def __init__(self, process: ChildProcess) -> None:
        self._process = process
        self._deadline_s = time.monotonic() + KILL_AFTER_S

    @staticmethod
    def is_due(robot: str) -> bool:
        """Whether a control process has left this robot without bringing it to rest."""
        return note_path(str(parse_address(robot)), note_folder(os.environ)).exists()

    @staticmethod
    def start(spec: RescueSpec) -> Rescue:
        """Begin. Raises OSError where the system cannot start a process."""
        told = spec.model_dump_json(by_alias=True).encode()
        return Rescue(ChildProcess.start(__name__, told=told, is_heard=True, has_own_session=True))

    def result(self) -> tuple[bool, str] | None:
        """Whether the robot is safe, and what was done; None while it is under way."""
        if self._process.exit_code is None:
            if time.monotonic() > self._deadline_s:
                self._process.kill()
            return None
        words = self._process.output.read(4096)
        code = self._process.end()
        return code == 0, words.decode(errors="replace").strip() or f"{MAY_HAVE_POWER}: exit code {code}"


def main() -> None:
    """Run the process."""
    try:
        spec = RescueSpec.model_validate_json(sys.stdin.buffer.read(MAX_SPEC_BYTES))
        folder = note_folder(os.environ)
        words = make_safe_by_note(spec.robot, spec.config, folder, lock_step=spec.lock_step, within_s=WITHIN_S)
        sys.stdout.write(f"{words}\n")
    except SpotRlError as error:
        sys.stdout.write(f"{error}\n")
        raise SystemExit(error.exit_code) from None


if __name__ == "__main__":
    main()
