"""When a robot fell, under which command, and what touched the ground first."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from spot_model.plant.plant import Plant
from spot_model.robot import facts
from spot_model.robot.arrays import on_host
from spot_model.robot.facts import Array
from spot_model.robot.rotation import tilt_rad

AT_STOP_RAD: Final = 0.02
"""Distance from a joint's stop at which it counts as at the stop."""
UPRIGHT_RAD: Final = 0.5
"""Tilt below which a robot that fell had sunk or stumbled rather than tipped over."""
PARTS: Final = {"body": "body", "uleg": "upper leg", "lleg": "lower leg"}


@dataclass(frozen=True)
class Fall:
    """One robot's fall: the first policy period at whose end something other than a foot is on the ground."""

    robot: int
    time_s: float
    """Since the trial began."""
    command: tuple[float, float, float]
    """V_x, V_y (m/s), ω_z (rad/s)."""
    command_age_s: float
    """How long that command had stood unchanged."""
    velocity: tuple[float, float, float]
    """Measured V_x, V_y (m/s), ω_z (rad/s), body frame."""
    tilt_rad: float
    touched: tuple[str, ...]
    """What is on the ground: "body", "hl lower leg" and so on."""
    at_stop: tuple[str, ...]
    """Joints at a stop."""

    def figures(self) -> dict[str, Any]:
        """As plain data."""
        return {
            "robot": self.robot,
            "time_s": round(self.time_s, 2),
            "command": [round(v, 3) for v in self.command],
            "command_age_s": round(self.command_age_s, 2),
            "velocity": [round(v, 2) for v in self.velocity],
            "tilt_deg": round(float(np.degrees(self.tilt_rad)), 1),
            "touched": list(self.touched),
            "at_stop": list(self.at_stop),
            "why": self.sentence(),
        }

    def sentence(self) -> str:
        """The fall in a line."""
        how = "tips over" if self.tilt_rad > UPRIGHT_RAD else "falls upright"
        stops = f"; at a joint stop: {', '.join(self.at_stop)}" if self.at_stop else ""
        return (
            f"robot {self.robot} {how} at {self.time_s:.2f} s, {self.command_age_s:.1f} s into the command "
            f"{_words(self.command)}, moving at {_words(self.velocity)}: {' and '.join(self.touched) or 'something'} "
            f"on the ground first, tilt {np.degrees(self.tilt_rad):.0f}°{stops}"
        )


def falls_now(
    plant: Plant, rows: NDArray[np.bool_], time_s: float, command: Array, command_since_s: Array, velocity: Array
) -> list[Fall]:
    """What is to be said of the robots that fell in this policy period.

    Args:
        plant: The robots as they are.
        rows: Which fell, shape (n,).
        time_s: Since the trial began.
        command: Shape (n, 3).
        command_since_s: When each robot's command last changed, shape (n,).
        velocity: V_x, V_y (m/s), ω_z (rad/s), shape (n, 3).
    """
    if not rows.any():
        return []
    tilt, position, qpos = (
        on_host(array) for array in (tilt_rad(plant.world_from_body_wxyz), plant.joint_position_rad, plant.physics.qpos)
    )
    at_stop = (position < facts.POSITION_LOW_RAD + AT_STOP_RAD) | (position > facts.POSITION_HIGH_RAD - AT_STOP_RAD)
    return [
        Fall(
            robot=int(i),
            time_s=time_s,
            command=_three(command[i]),
            command_age_s=time_s - float(command_since_s[i]),
            velocity=_three(velocity[i]),
            tilt_rad=float(tilt[i]),
            touched=touching_ground(plant.model, np.array(qpos[i], dtype=np.float64)),
            at_stop=tuple(facts.JOINT_NAMES[j] for j in np.flatnonzero(at_stop[i])),
        )
        for i in np.flatnonzero(rows)
    ]


def touching_ground(model: mujoco.MjModel, qpos: Array) -> tuple[str, ...]:
    """What touches the ground other than feet, or all but does, in a pose of MuJoCo's generalised position."""
    data = mujoco.MjData(model)
    touched: tuple[str, ...] = ()
    # After the step that brought the contact the part may have left the ground again by a little.
    for lowered_m in (0.0, 0.01, 0.03):
        data.qpos[:] = qpos
        data.qpos[2] -= lowered_m
        mujoco.mj_forward(model, data)
        names = {model.geom(int(geom)).name for pair in data.contact.geom for geom in pair}
        parts = [name.rpartition("_") for name in sorted(names)]
        touched = tuple(f"{leg} {PARTS[part]}".strip() for leg, _, part in parts if part in PARTS)
        if touched:
            break
    return touched


def _words(velocity: tuple[float, float, float]) -> str:
    v_x, v_y, yaw = velocity
    return f"({v_x:.2f}, {v_y:.2f} m/s, {yaw:.2f} rad/s)"


def _three(values: Array) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])
