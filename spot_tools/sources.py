"""What commands a robot in one run: a sequence, a joint experiment, the keys of a terminal, or a gamepad."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import tty
from collections.abc import Callable
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from spot_model.errors import BadInputError
from spot_model.io.velocity_sequence import VelocitySequence
from spot_model.policy.joint_script import JointScript
from spot_model.robot.facts import Array
from spot_runtime.config import OperatorConfig
from spot_runtime.sources import CommandSource, Shaper, Wanted

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


# Played ---------------------------------------------------------------------------------------------------------------


class ScriptedSource:
    """Plays a sequence once, or for a given time."""

    def __init__(self, sequence: VelocitySequence, *, duration_s: float | None = None) -> None:
        """Play ``sequence``, or (with ``duration_s``, above 0) over and over until that time is up."""
        self.name = sequence.name
        self._commands, self._duration_s = sequence.commands, sequence.duration_s
        self._total_s = sequence.duration_s if duration_s is None else duration_s

    def sample(self, active_s: float, host_stamp_ns: int) -> Wanted:
        """See the protocol."""
        del host_stamp_ns
        if active_s >= self._total_s:
            return Wanted(self._commands.at(self._duration_s), is_finished=True)
        return Wanted(self._commands.at(active_s % self._duration_s))

    def close(self) -> None:
        """Nothing is held."""


class JointScriptSource:
    """Plays the motion of an experiment once."""

    def __init__(self, script: JointScript) -> None:
        self.name, self._motion = script.experiment.name, script.motion

    def sample(self, active_s: float, host_stamp_ns: int) -> Wanted:
        """See the protocol; offsets of the set-points, shape (12,)."""
        del host_stamp_ns
        return Wanted(self._motion.at(active_s), is_finished=active_s >= self._motion.duration_s)

    def close(self) -> None:
        """Nothing is held."""


# From a terminal: letting go of the key is the dead-man ---------------------------------------------------------------


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
        """Switch the terminal; :meth:`close` switches it back. Raises BadInputError."""
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


# From a gamepad: a held shoulder button is the dead-man --------------------------------------------------------------


class PadReading(NamedTuple):
    """One look at a gamepad."""

    axes: tuple[float, ...]
    """Each −1 to 1."""
    buttons: tuple[bool, ...]
    is_attached: bool


class Pad(Protocol):
    """A gamepad that can be looked at without waiting."""

    def read(self) -> PadReading:
        """How it stands now."""

    def close(self) -> None:
        """Give it back."""


class GamepadSource:
    """Follows the sticks while the dead-man button is held and the pad is attached."""

    name = "gamepad"

    def __init__(self, config: OperatorConfig, pad: Pad) -> None:
        self._config, self._pad = config, pad
        self._shaper = Shaper(config.acceleration_m_s2, config.release_s)

    def sample(self, active_s: float, host_stamp_ns: int) -> Wanted:
        """See the protocol."""
        del active_s
        return Wanted(self._shaper.follow(self._wanted(self._pad.read()), host_stamp_ns))

    def close(self) -> None:
        """Give the pad back."""
        self._pad.close()

    def _wanted(self, reading: PadReading) -> Array | None:
        config = self._config
        axes = (config.gamepad_axis_v_x, config.gamepad_axis_v_y, config.gamepad_axis_yaw)
        if max(axes) >= len(reading.axes) or config.gamepad_deadman_button >= len(reading.buttons):
            return None
        if not (reading.is_attached and reading.buttons[config.gamepad_deadman_button]):
            return None
        # Sticks point down and right for positive values; forward, left and turning left are positive here.
        sticks = -np.array([reading.axes[axis] for axis in axes])
        sticks[np.abs(sticks) < config.gamepad_dead_zone] = 0.0
        return np.asarray(sticks * np.array([config.top_v_x_m_s, config.top_v_y_m_s, config.top_yaw_rate_rad_s]))


class PygamePad:
    """A gamepad through pygame, which is an optional extra."""

    def __init__(self, index: int) -> None:
        """Open the pad. Raises BadInputError: pygame is not installed, or there is no such pad."""
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        try:
            import pygame
        except ModuleNotFoundError as error:
            raise BadInputError("--gamepad needs pygame; install the extra: pip install 'spot-rl[gamepad]'") from error
        self._pygame: Any = pygame
        try:
            pygame.display.init()
            pygame.joystick.init()
        except pygame.error as error:
            pygame.quit()
            raise BadInputError(
                f"gamepads cannot be read: {error}; without a screen set SDL_VIDEODRIVER=dummy"
            ) from error
        count = pygame.joystick.get_count()
        if index >= count:
            pygame.quit()
            raise BadInputError(f"gamepad {index} is not attached; there are {count}; attach one, or steer by keyboard")
        self._joystick: Any = pygame.joystick.Joystick(index)

    def read(self) -> PadReading:
        """How it stands now."""
        stick = self._joystick
        try:
            self._pygame.event.pump()
            return PadReading(
                tuple(float(stick.get_axis(i)) for i in range(stick.get_numaxes())),
                tuple(bool(stick.get_button(i)) for i in range(stick.get_numbuttons())),
                bool(stick.get_init()) and self._pygame.joystick.get_count() > 0,
            )
        except self._pygame.error:  # it was unplugged between two looks
            return PadReading((), (), is_attached=False)

    def close(self) -> None:
        """End pygame."""
        self._pygame.quit()


def manual_source(config: OperatorConfig, say: Callable[[str], None], *, is_gamepad: bool) -> CommandSource:
    """The gamepad, or the keyboard, whose keys are told. Raises BadInputError where it is not there."""
    if is_gamepad:
        return GamepadSource(config, PygamePad(config.gamepad_index))
    say(HELP)
    terminal = TerminalKeys()
    return KeyboardSource(config, terminal.read, terminal.close)
