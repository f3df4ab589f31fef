"""A fake robot in a process of its own, reached like any robot: for scripts, benchmarks and tests.

As a program: real-time priority (0 for none), CPUs with commas between them (empty for all), then the words of
``spot-rl``. It has the rights of a robot's computer, and must not compete with the program that drives it.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Final

from typing_extensions import Self

from spot_model.console.command_line import main
from spot_model.errors import SpotRlError
from spot_model.process.child_process import HEARD, ChildProcess

START_TIMEOUT_S: Final = 60.0
STOP_TIMEOUT_S: Final = 10.0


class FakeProcessError(SpotRlError):
    """The fake robot did not start."""

    exit_code = 77


@dataclass(frozen=True)
class FakeAddress:
    """How the fake robot is reached."""

    robot: str
    """``HOST:PORT`` for ``spot-rl run --robot``."""
    sdk_host: str
    """Host argument of a program of the vendor's SDK."""
    ca_file: Path
    admin: str
    environment: dict[str, str] = field(repr=False)
    """With user name and password, and what lets the vendor's SDK trust the fake's certificate."""


class FakeProcess:
    """Runs ``spot-rl fake-robot`` while it is entered; the process ends with ours, whatever happens."""

    def __init__(
        self,
        *,
        scenario: str | os.PathLike[str] | Mapping[str, Any] = "default",
        is_lock_step: bool = False,
        fifo_priority: int = 0,
        cpus: Sequence[int] = (),
        state_dir: Path | None = None,
        is_silent: bool = False,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        """Choose what runs.

        ``scenario`` is a file, the name of a shipped one, or the keys of one. A ``fifo_priority`` of 0 is none, and no
        ``cpus`` are all. Without a ``state_dir``, a user's certificates and password are kept in one. If ``is_silent``,
        what the fake logs is shown only in the error of a start that fails.
        """
        words = ["fake-robot", "--port", "0", "--json", "--until-stdin-closes"]
        words += ["--lock-step"] if is_lock_step else []
        words += [] if state_dir is None else ["--state-dir", str(state_dir)]
        stay = ",".join(str(cpu) for cpu in cpus)
        self._arguments = [str(fifo_priority), stay, *words]
        self._scenario, self._is_silent, self._environment = scenario, is_silent, environment
        self._stack = ExitStack()
        self.ready: Mapping[str, Any] = {}
        """What it prints once it serves, as ``fake-robot --json``."""

    def __enter__(self) -> Self:
        """Start it and wait until it serves.

        Raises:
            FakeProcessError: It ended, or does not serve within a minute; the message holds its last words.
        """
        with ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="spot-rl-")))
            scenario = self._scenario
            if isinstance(scenario, Mapping):
                file = folder / "scenario.yaml"
                file.write_text(json.dumps(dict(scenario)), encoding="utf-8")  # JSON is YAML
                scenario = file
            log = stack.enter_context((folder / "log").open("w+b")) if self._is_silent else None
            process = ChildProcess.start(
                "fake_robot.start.process",
                *self._arguments,
                "--scenario",
                os.fspath(scenario),
                environment=self._environment,
                output=HEARD,
                errors=log,
                has_own_session=True,
            )
            stack.callback(process.end, STOP_TIMEOUT_S)
            self.ready = json.loads(_first_line(process, log))
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self) -> None:
        """End it; a second call does nothing."""
        self._stack.close()

    @property
    def address(self) -> FakeAddress:
        """How it is reached, once it is entered."""
        ready = self.ready
        robot, environment = f"{ready['host']}:{ready['port']}", dict(ready["environment"])
        return FakeAddress(robot, ready["sdk_host"], Path(ready["ca_file"]), ready["admin"], environment)


def _first_line(process: ChildProcess, log: IO[bytes] | None) -> bytes:
    deadline_s = time.monotonic() + START_TIMEOUT_S
    received = b""
    while b"\n" not in received:
        left_s = deadline_s - time.monotonic()
        if left_s <= 0.0 or not select.select([process.output], [], [], left_s)[0]:
            raise FakeProcessError(f"the fake robot did not serve within {START_TIMEOUT_S:g} s; {_last_words(log)}")
        chunk = os.read(process.output.fileno(), 65536)
        if not chunk:
            process.end()
            words = f"the fake robot ended before it served ({process.end_in_words}); {_last_words(log)}"
            raise FakeProcessError(words)
        received += chunk
    return received.partition(b"\n")[0]


def _last_words(log: IO[bytes] | None) -> str:
    if log is None:
        return "see above"
    log.seek(0)
    return f"it said: {log.read().decode(errors='replace').strip() or 'nothing'}"


if __name__ == "__main__":
    priority, stay, *words = sys.argv[1:]
    if stay:
        os.sched_setaffinity(0, [int(cpu) for cpu in stay.split(",")])
    if int(priority):
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(int(priority)))
    main(words)
