"""Velocity commands from somebody's hands."""

from __future__ import annotations

from collections.abc import Callable

from spot_runtime.config import OperatorConfig
from spot_runtime.sources.base import CommandSource
from spot_tools.run.gamepad import GamepadSource, PygamePad
from spot_tools.run.keyboard import HELP, KeyboardSource, TerminalKeys


def manual_source(config: OperatorConfig, say: Callable[[str], None], *, is_gamepad: bool) -> CommandSource:
    """The gamepad, or the keyboard, whose keys are told. Raises BadInputError where it is not there."""
    if is_gamepad:
        return GamepadSource(config, PygamePad(config.gamepad_index))
    say(HELP)
    terminal = TerminalKeys()
    return KeyboardSource(config, terminal.read, terminal.close)
