"""Plays on a gamepad that SDL itself makes, and prints as JSON what the source of commands makes of it.

A program, because SDL keeps to one thread and one process. SDL's own virtual device is what pygame then reads; no
device of the kernel's is needed.
"""

from __future__ import annotations

import ctypes
import json
import os
import sys
from pathlib import Path

os.environ["PYGAME_HIDE_SUPPORT_PROMPT"] = "1"

import pygame

from spot_runtime.config import OperatorConfig
from spot_tools.sources import GamepadSource, PygamePad

GAMEPAD, AXES, BUTTONS = 1, 6, 16
FORWARD, SIDE, TURN = 1, 0, 3
SHOULDER = 4


def main() -> None:
    (library,) = (Path(pygame.__file__).parent.parent / "pygame.libs").glob("libSDL2-2*")
    sdl = ctypes.CDLL(str(library))
    sdl.SDL_JoystickOpen.restype = ctypes.c_void_p
    pygame.display.init()
    pygame.joystick.init()
    sdl.SDL_JoystickAttachVirtual(GAMEPAD, AXES, BUTTONS, 1)
    device = ctypes.c_void_p(sdl.SDL_JoystickOpen(0))
    source = GamepadSource(OperatorConfig(acceleration_m_s2=20.0), PygamePad(0))
    now_ns = 0

    def look() -> list[float]:
        nonlocal now_ns
        for _ in range(100):  # two seconds, so that the command has risen or faded
            now_ns += 20_000_000
            command = source.sample(0.0, now_ns).command
        return [round(float(value), 3) for value in command]

    def stick(axis: int, share: float) -> None:
        sdl.SDL_JoystickSetVirtualAxis(device, axis, ctypes.c_int16(round(share * 32767)))

    def shoulder(is_held: int) -> None:
        sdl.SDL_JoystickSetVirtualButton(device, SHOULDER, ctypes.c_uint8(is_held))

    seen: dict[str, list[float]] = {}
    stick(FORWARD, -1.0)
    seen["stick without the dead-man"] = look()
    shoulder(1)
    seen["forward"] = look()
    stick(FORWARD, 0.05)
    seen["within the dead zone"] = look()
    stick(FORWARD, 0.0)
    stick(SIDE, 1.0)
    stick(TURN, -0.5)
    seen["right, turning left"] = look()
    shoulder(0)
    seen["let go"] = look()
    shoulder(1)
    seen["held again"] = look()
    sdl.SDL_JoystickDetachVirtual(0)
    seen["unplugged"] = look()
    source.close()
    sys.stdout.write(json.dumps(seen))


if __name__ == "__main__":
    main()
