"""The robot's eyes: they ask the cameras' process for pictures, and find out how this computer can draw them."""

from __future__ import annotations

import logging
import os
import socket
import threading
from collections.abc import Sequence
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fake_robot.network.requests import CameraView
from fake_robot.scenario.scenario import Scenario
from spot_model.process.child_process import UNHEARD, ChildProcess, without_secrets

_LOGGER = logging.getLogger(__name__)

BACKENDS = ("egl", "osmesa")
"""OpenGL without a display, as MuJoCo names it: of the graphics driver, or of Mesa alone."""
PROGRAM = "fake_robot.eyes.draw"
_START_S, _PICTURE_S = 30.0, 10.0


class _BlindError(Exception):
    """What draws gave no answer; the message says why."""


class Eyes:
    """Pictures of the scene. The process that draws starts with the first one. Safe from any thread.

    ``backends`` are values of ``MUJOCO_GL`` to try in turn, by default what the environment says or :data:`BACKENDS`.
    ``program`` is what draws: a module, or the words of a program; the number of its socket is added.
    """

    def __init__(
        self, scenario: Scenario, backends: Sequence[str] | None = None, program: str | Sequence[str] = PROGRAM
    ) -> None:
        asked = os.environ.get("MUJOCO_GL")
        self._backends = tuple(backends or ((asked,) if asked else BACKENDS))
        self._scenario, self._program = scenario, program
        self._lock = threading.Lock()
        self._has_tried = False
        self._connection: Connection | None = None
        self._process: ChildProcess | None = None
        self.backend = ""
        """What draws; empty before the first picture, and where nothing can."""

    def look(self, position: NDArray[np.float64], view: CameraView) -> NDArray[Any] | None:
        """What a camera sees; None if this computer cannot draw it. See :meth:`fake_robot.eyes.draw.Scene.draw`."""
        with self._lock:
            if not self._has_tried:
                self._has_tried = True
                self._open()
            if self._connection is None:
                return None
            try:
                picture: NDArray[Any] = _ask(self._connection, (position, view), _PICTURE_S)
                return picture
            except _BlindError as error:
                _LOGGER.warning("the cameras show a test card from now on: what draws them failed: %s", error)
                self._end()
                return None

    def close(self) -> None:
        """See no more; ends the process that draws."""
        with self._lock:
            self._has_tried = True
            self._end()

    def _open(self) -> None:
        reasons = []
        for backend in self._backends:
            self._connection = self._start(backend)
            try:
                reason = _ask(self._connection, self._scenario, _START_S)
            except _BlindError as error:
                reason = error
            if reason is None:
                self.backend = backend
                return
            reasons.append(f"{backend}: {reason}")
            self._end()
        _LOGGER.warning(
            "the cameras show a test card, for MuJoCo cannot draw here without a display (%s); install Mesa's EGL "
            "(libegl1 and libgl1-mesa-dri on Debian) or libosmesa6, and the extra spot-rl[cameras]",
            "; ".join(reasons),
        )

    def _start(self, backend: str) -> Connection:
        ours, theirs = socket.socketpair()
        with theirs:
            self._process = ChildProcess.start(
                self._program,
                str(theirs.fileno()),
                told=b"",
                descriptors=(theirs.fileno(),),
                environment={**without_secrets(os.environ), "MUJOCO_GL": backend, "LP_NUM_THREADS": "1"},
                output=UNHEARD,
                errors=UNHEARD,
                has_own_session=True,
            )
        return Connection(ours.detach())

    def _end(self) -> None:
        self.backend = ""
        if self._connection is not None:
            self._connection.close()
            self._connection = None
        if self._process is not None:
            self._process.end(0.0)
            self._process = None


def _ask(connection: Connection, question: object, timeout_s: float) -> Any:
    try:
        connection.send(question)
        if not connection.poll(timeout_s):
            raise _BlindError(f"no answer within {timeout_s:g} s")
        return connection.recv()
    except (EOFError, ConnectionError) as error:
        raise _BlindError("its process ended") from error
