"""A process that this one starts: told what to do on its standard input, ended for sure.

A module of ours finds no module in the current folder, and no password in its environment: any user who may list
processes can read that, and whatever runs in the process does. What needs one is told it on its standard input.
"""

from __future__ import annotations

import contextlib
import os
import re
import select
import signal
import subprocess
import sys
import time
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Final

from spot_model.process.python_path import VARIABLE, absolute_entries

if TYPE_CHECKING:
    from typing_extensions import Self

END_TIMEOUT_S = 5.0
LAUNCH: Final = Path(__file__).absolute().parents[1] / "launch.py"
HEARD: Final = subprocess.PIPE
"""For :attr:`ChildProcess.output` to read."""
UNHEARD: Final = subprocess.DEVNULL
LOOK_PERIOD_S: Final = 0.2
SECRET: Final = re.compile(r"PASSW|PASSPHRASE|TOKEN|SECRET|CREDENTIAL|COOKIE|_KEY$|^PYTHONINSPECT$", re.IGNORECASE)
"""Names of variables that a process of ours does without; the last would take its exit code away."""


class LivingProcess:
    """A process that this one did not start, watched to its end.

    A descriptor tells its end, so that no other process of its number can be mistaken for it. Where the system gives
    none (Linux before 5.3, a sandbox), the process table is read now and then.

    Args:
        pid: Its number; 0: there is none, which counts as ended.
    """

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._descriptor: int | None = None
        with contextlib.suppress(OSError):
            self._descriptor = os.pidfd_open(pid) if pid else None
        self._began = _began(pid)

    def has_ended(self, within_s: float | None = 0.0) -> bool:
        """Whether it has ended, or does so within a time; None: whenever that is."""
        if self._descriptor is not None:
            return ends(self._descriptor, within_s)
        began_s = time.monotonic()
        while self._is_there():
            if within_s is not None and time.monotonic() - began_s >= within_s:
                return False
            time.sleep(LOOK_PERIOD_S)
        return True

    def send(self, number: signal.Signals) -> None:
        """Send it a signal; one that has ended gets none."""
        with contextlib.suppress(ProcessLookupError):
            if self._descriptor is not None:
                signal.pidfd_send_signal(self._descriptor, number)
            elif self._is_there():
                os.kill(self._pid, number)

    def _is_there(self) -> bool:
        """Whether the process table has it still; a table that cannot be read tells of no end."""
        now = _began(self._pid)
        return self._began is not None and now is not None and (now == self._began or "" in (now, self._began))


def _began(pid: int) -> str | None:
    """When a process began, in the kernel's words; empty where they cannot be read, None where there is no process."""
    try:
        words = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    except (FileNotFoundError, ProcessLookupError):
        return None
    except OSError:
        return ""
    return None if words[0] in "ZX" else words[19]


def ends(descriptor: int, within_s: float | None) -> bool:
    """Whether the process of a descriptor has ended, or does so within a time; None: whenever that is."""
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    return bool(poll.poll(None if within_s is None else max(0.0, 1e3 * within_s)))


def module_command(module: str, *arguments: str) -> list[str]:
    """The words that run a module of this installation as a program, as ``python -m`` would from any other folder."""
    return [sys.executable, str(LAUNCH), module, *arguments]


def without_secrets(environment: Mapping[str, str]) -> dict[str, str]:
    """An environment for a process that needs no password, and finds no module in the current folder."""
    kept = {name: value for name, value in environment.items() if not SECRET.search(name)}
    if VARIABLE in kept:
        kept[VARIABLE] = absolute_entries(kept[VARIABLE])
    return kept


class ChildProcess:
    """Runs a program, mostly a module of ours. Nothing here waits unless it says so.

    A descriptor of the process tells whether it lives, and takes signals to it. Popen by itself reads a child whose
    status it cannot get as one that ended with exit code 0, though it may still run, and sends it no signal any more.
    """

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self._process = process
        self.pid = process.pid
        self._descriptor: int | None = None
        with contextlib.suppress(OSError):
            self._descriptor = os.pidfd_open(process.pid)
        if self._descriptor is not None:
            weakref.finalize(self, os.close, self._descriptor)

    @classmethod
    def start(
        cls,
        program: str | Sequence[str],
        *arguments: str,
        told: bytes | None = None,
        descriptors: Sequence[int] = (),
        environment: Mapping[str, str] | None = None,
        output: IO[bytes] | int | None = None,
        errors: IO[bytes] | int | None = None,
        has_own_session: bool = False,
        reads_terminal: bool = False,
    ) -> Self:
        """Start a module of this installation, or another program.

        Args:
            program: The module's name, or the words of the other program.
            arguments: Its command line.
            told: Its standard input, which ends after it; the call does not wait until it has been read. None: a
                pipe that ends with this process, or with :meth:`end`.
            descriptors: What it inherits beside standard input, output and error.
            environment: Its own; this process's if None, for a module :func:`without_secrets`.
            output: Where its standard output goes, as subprocess has it: this process's own if None; :data:`HEARD`.
            errors: Where its standard error goes, likewise.
            has_own_session: Whether a terminal's Ctrl-C is kept from it.
            reads_terminal: Whether it has this process's standard input, which then says nothing of an end.

        Raises:
            OSError: The system cannot start a process.
        """
        with contextlib.ExitStack() as stack:
            given: IO[bytes] | int | None = None if reads_terminal else subprocess.PIPE
            if told is not None:
                given = stack.enter_context(os.fdopen(os.memfd_create("told"), "w+b"))
                given.write(told)
                given.seek(0)
            words = program
            if isinstance(program, str):
                words, environment = module_command(program), environment or without_secrets(os.environ)
            process = subprocess.Popen(  # noqa: S603 - its callers' own command lines
                [*words, *arguments],
                stdin=given,
                stdout=output,
                stderr=errors,
                pass_fds=descriptors,
                env=None if environment is None else dict(environment),
                start_new_session=has_own_session,
            )
        return cls(process)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    @property
    def output(self) -> IO[bytes]:
        """Its standard output. Raises ValueError where that is not heard."""
        if self._process.stdout is None:
            raise ValueError("the output of this process is not heard")
        return self._process.stdout

    @property
    def exit_code(self) -> int | None:
        """Its exit code, negative for a signal; None while it lives."""
        return self._process.poll() if self._has_ended(0.0) else None

    @property
    def end_in_words(self) -> str:
        """How it ended."""
        code = self.exit_code
        if code is None:
            return "it still runs"
        return f"killed by signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"

    def send(self, number: signal.Signals) -> None:
        """Send it a signal; one that has ended gets none."""
        if self._descriptor is None:
            self._process.send_signal(number)
            return
        with contextlib.suppress(ProcessLookupError):
            signal.pidfd_send_signal(self._descriptor, number)

    def kill(self) -> None:
        """End it at once."""
        self.send(signal.SIGKILL)

    def wait(self, timeout_s: float | None = None) -> int | None:
        """Wait for its end, at most this long. Returns its exit code; None if it still lives."""
        return self._process.wait() if self._has_ended(timeout_s) else None

    def hear_out(self, timeout_s: float) -> tuple[int | None, bytes]:
        """Its exit code, and what it says from now to its end; None and nothing where that does not come in time."""
        try:
            said, _ = self._process.communicate(timeout=timeout_s)
        except subprocess.TimeoutExpired:
            return None, b""
        return self._process.returncode, said or b""

    def end(self, timeout_s: float = END_TIMEOUT_S) -> int:
        """Wait for its end, kill it if that does not come in time, and reap it. Returns its exit code."""
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.close()
        if not self._has_ended(timeout_s):
            self.kill()
            self._has_ended(None)
        code = self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()
        return code

    def _has_ended(self, within_s: float | None) -> bool:
        if self._descriptor is not None:
            return ends(self._descriptor, within_s)
        # It was gone at once, or the system gives no such descriptors.
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(None if within_s is None else max(0.0, within_s))
        return self._process.returncode is not None
