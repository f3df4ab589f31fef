"""Velocity commands from the keys of a terminal; letting go of the key is the dead-man."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import tty
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from spot_model.errors import BadInputError
from spot_model.robot.state import Array
from spot_runtime.config import OperatorConfig
from spot_runtime.sources.base import Shaper, Wanted

HELP: Final = "hold w/s: forward, back · a/d: left, right · q/e: turn · space: stand still · x: stop and sit"
DIRECTIONS: Final = {
    "w": (1.0, 0.0, 0.0),
    "s": (-1.0, 0.0, 0.0),
    "a": (0.0, 1.0, 0.0),
    "d": (0.0, -1.0, 0.0),
    "q": (0.0, 0.0, 1.0),
    "e": (0.0, 0.0, -1.0),
}
QUIT: Final = "x"


class KeyboardSource:
    """One key at a time, as terminals repeat only the newest; silence for longer than the repeat delay is release."""

    name = "keyboard"

    def __init__(
        self, config: OperatorConfig, read_keys: Callable[[], str], close: Callable[[], None] = lambda: None
    ) -> None:
        """Use ``read_keys``, which gives the keys pressed since its last call and never blocks."""
        self._read_keys, self._close = read_keys, close
        self._top = np.array([config.top_v_x_m_s, config.top_v_y_m_s, config.top_yaw_rate_rad_s])
        self._silence_ns = round(config.keyboard_silence_s * 1e9)
        self._shaper = Shaper(config.acceleration_m_s2, config.release_s)
        self._wanted: Array | None = None
        self._pressed_ns = 0
        self._is_finished = False

    def sample(self, active_s: float, host_stamp_ns: int) -> Wanted:
        """See the protocol."""
        del active_s
        for key in self._read_keys():
            self._pressed_ns = host_stamp_ns
            if key in DIRECTIONS:
                self._wanted = np.array(DIRECTIONS[key]) * self._top
            elif key == QUIT:
                self._is_finished = True
            else:
                self._wanted = None
        if host_stamp_ns - self._pressed_ns > self._silence_ns:
            self._wanted = None
        return Wanted(self._shaper.follow(self._wanted, host_stamp_ns), self._is_finished)

    def close(self) -> None:
        """Give the keys back."""
        self._close()


class TerminalKeys:
    """Keys of the controlling terminal as they are pressed, without echo."""

    def __init__(self) -> None:
        """Switch the terminal; :meth:`close` switches it back.

        Raises:
            BadInputError: Standard input is not a terminal.
        """
        if not sys.stdin.isatty():
            raise BadInputError("--keyboard needs a terminal, and standard input is none; use --sequence instead")
        self._descriptor = sys.stdin.fileno()
        self._before: list[Any] | None = termios.tcgetattr(self._descriptor)
        # Not raw mode: Ctrl-C must still reach us as SIGINT.
        tty.setcbreak(self._descriptor)

    def read(self) -> str:
        """What was pressed since the last call; :data:`QUIT` if the terminal has gone."""
        keys = b""
        while select.select([self._descriptor], [], [], 0.0)[0]:
            try:
                chunk = os.read(self._descriptor, 64)
            except OSError:
                chunk = b""
            if not chunk:
                return QUIT
            keys += chunk
        return keys.decode("ascii", errors="ignore")

    def close(self) -> None:
        """Give the terminal back as it was, if it is still there."""
        before, self._before = self._before, None
        if before is not None:
            with contextlib.suppress(termios.error):
                termios.tcsetattr(self._descriptor, termios.TCSADRAIN, before)
