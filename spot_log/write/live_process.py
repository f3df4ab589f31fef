"""Starts the live view's process and ends it."""

from __future__ import annotations

import os
import select
import shutil
import socket
from pathlib import Path
from typing import Final

from typing_extensions import Self

from spot_log.write.live_tap import SOCKET_VARIABLE
from spot_model.errors import BadInputError, SpotRlError
from spot_model.process.child_process import HEARD, ChildProcess
from spot_model.process.private_folder import make_private_folder

FOLDER_PREFIX: Final = "spot-rl-live-"
SOCKET_NAME: Final = "live.sock"
START_TIMEOUT_S: Final = 20.0
STOP_TIMEOUT_S: Final = 5.0


class LiveViewError(SpotRlError):
    """The live view cannot be served."""

    exit_code = 98


class LiveProcess:
    """Serves Foxglove on loopback while it is entered; logs that begin meanwhile show up there."""

    def __init__(self, port: int) -> None:
        """Serve on ``port``; 0 takes a free one."""
        self.port = port
        self._process: ChildProcess | None = None
        self._folder: Path | None = None

    def __enter__(self) -> Self:
        """Start it.

        Raises:
            BadInputError: foxglove-sdk is not installed.
            LiveViewError: The port is taken, or the process does not start.
        """
        try:
            import foxglove  # noqa: F401
        except ModuleNotFoundError as error:
            raise BadInputError(
                "the live view needs foxglove-sdk; install the extra: pip install 'spot-rl[live]'"
            ) from error
        self._folder = make_private_folder(os.environ, FOLDER_PREFIX, SOCKET_NAME, socket.SOCK_SEQPACKET)
        path = self._folder / SOCKET_NAME
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
                # It answers under its name, so that it is not taken for one that was left behind.
                listener.bind(f"{path}.new")
                listener.listen(4)
                Path(f"{path}.new").rename(path)
                arguments = (str(listener.fileno()), str(self.port))
                self._process = ChildProcess.start(
                    "spot_log.write.live_child", *arguments, descriptors=(listener.fileno(),), output=HEARD
                )
            self.port = self._wait_ready(self._process)
        except BaseException:
            self.stop()
            raise
        os.environ[SOCKET_VARIABLE] = str(path)
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def url(self) -> str:
        """What to open in Foxglove."""
        return f"ws://127.0.0.1:{self.port}"

    @property
    def pid(self) -> int:
        """The process's number; 0: none runs."""
        return 0 if self._process is None else self._process.pid

    def stop(self) -> None:
        """End it; a second call does nothing."""
        process, self._process = self._process, None
        folder, self._folder = self._folder, None
        if folder is not None:
            os.environ.pop(SOCKET_VARIABLE, None)
            shutil.rmtree(folder, ignore_errors=True)
        if process is not None:
            process.end(STOP_TIMEOUT_S)

    def _wait_ready(self, process: ChildProcess) -> int:
        readable = select.select([process.output], [], [], START_TIMEOUT_S)[0]
        words = process.output.readline().decode(errors="replace").strip() if readable else "no answer"
        if not words.isdecimal():
            raise LiveViewError(f"the live view cannot be served on port {self.port}: {words}; name another port")
        return int(words)
