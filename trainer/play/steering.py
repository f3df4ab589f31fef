"""Velocity commands from the keys of MuJoCo's viewer, which reports presses and no releases."""

from __future__ import annotations

from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Final

import numpy as np

from spot_model.errors import BadInputError
from spot_model.policy.contract import PolicyContract
from spot_model.robot.facts import Array
from spot_runtime.config import OperatorConfig
from spot_runtime.sources import Shaper
from spot_tools.sources import GamepadSource, Pad
from trainer.play.walk import VelocityAt

STEPS: Final = {
    265: (0.25, 0.0, 0.0),
    264: (-0.25, 0.0, 0.0),
    263: (0.0, 0.0, 0.25),
    262: (0.0, 0.0, -0.25),
    ord("7"): (0.0, 0.25, 0.0),
    ord("9"): (0.0, -0.25, 0.0),
}
"""GLFW key codes (the arrows, 7 and 9) and what a press adds to V_x, V_y (m/s), ω_z (rad/s). The viewer uses none."""
STAND: Final = 257
"""Enter."""
PUSH: Final = ord("8")
HELP: Final = (
    "up/down: forward, back · left/right: turn · 7/9: sideways · Enter: stand · 8: push by 1 m/s; "
    "close the window to end"
)
ACCELERATION_M_S2: Final = 2.0
"""Rise of the command; rad/s² for turns."""


class KeySteering:
    """Each press moves the wanted velocity by a step, within the policy's range; the command follows it gently."""

    def __init__(self, contract: PolicyContract, wanted: Array, push: Callable[[], None] | None = None) -> None:
        self._low, self._high = np.array(contract.velocity_command_low), np.array(contract.velocity_command_high)
        self._wanted, self._push = wanted, push
        self._shaper = Shaper(ACCELERATION_M_S2, release_s=1.0)
        self._pressed: SimpleQueue[int] = SimpleQueue()

    def press(self, key: int) -> None:
        """Note a key; the viewer calls this from its own thread."""
        self._pressed.put(key)

    def velocity_at(self, time_s: float) -> Array:
        """The command at a time since the start, shape (3,)."""
        while True:
            try:
                key = self._pressed.get_nowait()
            except Empty:
                return self._shaper.follow(self._wanted, round(time_s * 1e9))
            if key in STEPS:
                self._wanted = np.clip(self._wanted + STEPS[key], self._low, self._high)
            elif key == STAND:
                self._wanted = np.zeros(3)
            elif key == PUSH and self._push is not None:
                self._push()


def parse_velocity(text: str, contract: PolicyContract) -> Array:
    """Read ``vx,vy,wz`` in m/s and rad/s.

    Raises:
        BadInputError: It is not three numbers, or outside the policy's range.
    """
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != 3:
        raise BadInputError(f"--velocity {text!r} is not three numbers vx,vy,wz in m/s and rad/s, such as 1,0,0.5")
    ranges = zip(("vx", "vy", "wz"), values, contract.velocity_command_low, contract.velocity_command_high, strict=True)
    for name, value, low, high in ranges:
        if not low <= value <= high:
            raise BadInputError(f"--velocity: {name} = {value} is outside the policy's range of {low:g} to {high:g}")
    return np.array(values)


MOST: float = 5.0
"""What a stick at its end may ask for at most (m/s, rad/s), as for a robot."""


def stick_steering(contract: PolicyContract, pad: Pad) -> VelocityAt:
    """Follow the sticks while the dead-man button is held, as ``spot-rl run --gamepad`` does."""
    low, high = np.array(contract.velocity_command_low), np.array(contract.velocity_command_high)
    v_x, v_y, yaw_rate = np.clip(high, 0.01, MOST)
    source = GamepadSource(OperatorConfig(top_v_x_m_s=v_x, top_v_y_m_s=v_y, top_yaw_rate_rad_s=yaw_rate), pad)

    def velocity_at(time_s: float) -> Array:
        return np.clip(source.sample(time_s, round(time_s * 1e9)).command, low, high)

    return velocity_at
