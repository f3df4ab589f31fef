"""Velocity commands from a gamepad; a held shoulder button is the dead-man."""

from __future__ import annotations

import os
from typing import Any, NamedTuple, Protocol

import numpy as np

from spot_model.errors import BadInputError
from spot_model.robot.state import Array
from spot_runtime.config import OperatorConfig
from spot_runtime.sources.base import Shaper, Wanted


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
        """Open the pad.

        Raises:
            BadInputError: pygame is not installed, or there is no such pad.
        """
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
