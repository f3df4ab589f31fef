"""The operator's service's hold on its child processes: the one in control, and the one that makes a robot safe."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from spot_model.process.child_process import ChildProcess, without_secrets
from spot_protos import run_link_pb2
from spot_runtime.config import RunConfig
from spot_runtime.hal.address import parse_address
from spot_runtime.hal.credentials import told_credentials
from spot_runtime.host.service_manager import PROCESS_VARIABLE
from spot_runtime.operator.run.link import is_ready, receive
from spot_runtime.operator.run.run_spec import RunSpec
from spot_runtime.rescue.guardian import start_rescuer
from spot_runtime.rescue.lease_note import WITHIN_S, note_folder, note_path
from spot_runtime.rescue.make_safe import MAY_HAVE_POWER, WAITING

MAX_READ: Final = 256
LAST_WORDS_S: Final = 10.0
"""Longest wait for the last messages of a process that has exited, s."""


class RunProcess:
    """One arming's process. Nothing here waits for it."""

    def __init__(self, process: ChildProcess, connection: socket.socket) -> None:
        self._process, self._socket = process, connection
        self._socket.setblocking(False)
        self._is_all_told = False
        self._gone_s: float | None = None
        self.pid = process.pid

    @staticmethod
    def start(spec: RunSpec) -> RunProcess:
        """Start it; it begins to connect at once. Raises OSError: the system cannot start a process."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        # The watchdog that the service manager meant for us is fed by the control loop while there is one.
        environment = without_secrets(os.environ)
        environment.pop(PROCESS_VARIABLE, None)
        told = spec.model_copy(update={"credentials": told_credentials(os.environ)})
        with theirs:
            # A session of its own: Ctrl-C at the service's terminal is for the service, which then asks this process.
            process = ChildProcess.start(
                "spot_runtime.operator.run.run_child",
                str(theirs.fileno()),
                told=told.model_dump_json(by_alias=True).encode(),
                descriptors=(theirs.fileno(),),
                environment=environment,
                has_own_session=True,
            )
        return RunProcess(process, ours)

    def tell(self, message: run_link_pb2.ToRun) -> bool:
        """Hand over a request. Returns whether the socket took it."""
        try:
            self._socket.send(message.SerializeToString(), socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
        except OSError:
            return False
        return True

    def read(self, timeout_s: float) -> Sequence[run_link_pb2.FromRun]:
        """What it has told; waits for the first message at most ``timeout_s``."""
        if self._is_all_told:
            time.sleep(timeout_s)
            return ()
        if not is_ready(self._socket, timeout_s):
            return ()
        received = receive(self._socket, run_link_pb2.FromRun, MAX_READ)
        self._is_all_told = received.is_end
        return received.messages

    def exit_code(self) -> int | None:
        """Its exit code, negative for a signal; None while it lives, or while messages of it are unread.

        The last message may still lie in the socket when the process has gone.
        """
        code = self._process.exit_code
        if code is None or self._is_all_told:
            return code
        self._gone_s = time.monotonic() if self._gone_s is None else self._gone_s
        return code if time.monotonic() - self._gone_s > LAST_WORDS_S else None

    def ask_to_stop(self) -> None:
        """Without the socket: the first signal asks it to stop in place, sit and power off; one more to damp."""
        self._process.send(signal.SIGTERM)

    def ask_to_damp(self) -> None:
        """Without the socket, and whatever was asked before."""
        self._process.send(signal.SIGTERM)
        self._process.send(signal.SIGINT)

    def press_estop(self) -> None:
        """Without the socket: the e-stop."""
        self._process.send(signal.SIGQUIT)

    def abort(self) -> None:
        """End the process so that it writes every thread's stack, if it is told to (PYTHONFAULTHANDLER)."""
        self._process.send(signal.SIGABRT)

    def kill(self) -> None:
        """End the process at once; the robot's own time-outs end the motion."""
        self._process.kill()

    def close(self) -> None:
        """Give the socket back and reap the process."""
        self._socket.close()
        self._process.end()


KILL_AFTER_S: Final = WITHIN_S + 35.0
"""A process that makes a robot safe and says nothing for so long hangs; while it waits for a lease, it says so."""


class Rescue:
    """One attempt, by a process of its own. Nothing here waits for it."""

    def __init__(self, process: ChildProcess, note: Path) -> None:
        self._process, self._note = process, note
        self._deadline_s = time.monotonic() + KILL_AFTER_S
        self._said = b""
        os.set_blocking(process.output.fileno(), False)

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
        has_ended = self._process.exit_code is not None  # asked before it is heard, so that no word is missed
        self._hear()
        if not has_ended:
            if time.monotonic() > self._deadline_s:
                self._process.kill()
            return None
        code = self._process.end()
        # An exit code may be lost and read as 0; the note is gone only where the robot was made safe.
        is_safe = code == 0 and not self._note.exists()
        return is_safe, self._last_line or f"{MAY_HAVE_POWER}: exit code {code}"

    @property
    def waits(self) -> str:
        """For whose lease it waits, in words; empty where it does not."""
        return self._last_line if self._last_line.startswith(WAITING) else ""

    @property
    def _last_line(self) -> str:
        whole, _, _ = self._said.rpartition(b"\n")
        return whole.rpartition(b"\n")[2].decode(errors="replace").strip()

    def _hear(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while data := os.read(self._process.output.fileno(), 4096):
                self._said = (self._said + data)[-4096:]
                self._deadline_s = time.monotonic() + KILL_AFTER_S
