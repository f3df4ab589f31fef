"""A fake robot in a process of its own, reached like any robot: for the demo, benchmarks and tests."""

from __future__ import annotations

import json
import os
import select
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from typing_extensions import Self

from spot_model.errors import SpotRlError
from spot_model.io.child_process import ChildProcess

START_TIMEOUT_S: Final = 30.0
STOP_TIMEOUT_S: Final = 10.0


class FakeProcessError(SpotRlError):
    """The fake robot did not start."""

    exit_code = 91


@dataclass(frozen=True)
class FakeAddress:
    """How the fake robot is reached."""

    robot: str
    """``HOST:PORT`` for ``spot-rl run --robot``."""
    ca_file: Path
    admin: str
    environment: dict[str, str]
    """With user name and password."""


class FakeProcess:
    """Runs ``spot-rl fake-robot`` while it is entered; the process ends with ours, whatever happens."""

    def __init__(
        self,
        *,
        scenario: str = "default",
        is_lock_step: bool = False,
        fifo_priority: int = 0,
        cpus: Sequence[int] = (),
        state_dir: Path | None = None,
    ) -> None:
        """Choose what runs.

        Args:
            scenario: A file, or the name of a shipped one.
            is_lock_step: Whether robot time passes only when asked.
            fifo_priority: Real-time priority; 0 for none.
            cpus: Where it stays; empty for all.
            state_dir: Folder of its certificates and password; one a user if None.
        """
        words = ["fake-robot", "--scenario", scenario, "--port", "0", "--json", "--until-stdin-closes"]
        words += ["--lock-step"] if is_lock_step else []
        words += [] if state_dir is None else ["--state-dir", str(state_dir)]
        stay = ",".join(str(cpu) for cpu in cpus)
        self._arguments = [str(fifo_priority), stay, *words]
        self._process: ChildProcess | None = None

    def __enter__(self) -> Self:
        """Start it and wait until it serves.

        Raises:
            FakeProcessError: It does not serve within 30 s; the message holds its last words.
        """
        self._process = ChildProcess.start("proof.fake_launch", *self._arguments, is_heard=True, has_own_session=True)
        try:
            self.address = _address(json.loads(self._first_line(self._process)))
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self) -> None:
        """End it; a second call does nothing."""
        process, self._process = self._process, None
        if process is not None:
            process.end(STOP_TIMEOUT_S)

    @staticmethod
    def _first_line(process: ChildProcess) -> bytes:
        deadline_s = time.monotonic() + START_TIMEOUT_S
        received = b""
        while b"\n" not in received:
            left_s = deadline_s - time.monotonic()
            if left_s <= 0.0 or not select.select([process.output], [], [], left_s)[0]:
                raise FakeProcessError(f"the fake robot did not serve within {START_TIMEOUT_S:g} s; run it by itself")
            chunk = os.read(process.output.fileno(), 65536)
            if not chunk:
                process.end()
                raise FakeProcessError(f"the fake robot ended before it served ({process.end_in_words}); see above")
            received += chunk
        return received.partition(b"\n")[0]


def _address(ready: dict[str, object]) -> FakeAddress:
    environment = {
        "BOSDYN_CLIENT_USERNAME": str(ready["username"]),
        "BOSDYN_CLIENT_PASSWORD": str(ready["password"]),
        "SPOT_RL_CA_FILE": str(ready["ca_file"]),
    }
    robot = f"{ready['host']}:{ready['port']}"
    return FakeAddress(robot, Path(str(ready["ca_file"])), str(ready["admin"]), environment)
