"""The ground that is not level, and what grows on it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from spot_model.effects.base import Outside, OutsideEffect, parameter
from spot_model.robot import facts
from spot_model.robot.arrays import namespace_of
from spot_model.robot.leg_kinematics import foot_position_and_jacobian
from spot_model.robot.rotation import AnyArray, cross, rotate_inverse_wxyz, rotate_wxyz

BEND_S = 1.0
"""Time in which a walking robot crosses from one slope onto the next."""


@dataclass(frozen=True, kw_only=True)
class GroundSlope(OutsideEffect):
    """The ground rises along x and y of odom, or does so for a stretch of the run; several stretches follow each other.

    A simulation's world is the ground, and gravity leans in it. Odom is true to gravity, as an inertial unit makes it,
    so that estimators report the body's attitude against the vertical.

    Source: ramps for wheelchairs 5 degrees, lawns and roads up to 10.
    """

    name: ClassVar[str] = "ground_slope"

    rise_x_rad: Any = parameter(null=0.0, low=-0.3, high=0.3, unit="rad", source="ramps 0.09 rad, roads up to 0.17")
    rise_y_rad: Any = parameter(null=0.0, low=-0.3, high=0.3, unit="rad", source="ramps 0.09 rad, roads up to 0.17")
    from_s: Any = parameter(null=0.0, low=0.0, high=1e5, unit="s", source="since the start")
    until_s: Any = parameter(null=math.inf, low=0.0, high=1e5, unit="s", source="since the start")

    @property
    def is_steady(self) -> bool:
        """Without a beginning and an end."""
        return bool(np.all(np.asarray(self.from_s) <= 0.0) and np.all(np.isinf(self.until_s)))

    def surround(self, outside: Outside) -> None:
        """Lean gravity as odom's vertical leans in the frame of the ground."""
        xp, time_s = namespace_of(outside.time_s), outside.time_s
        began, goes_on = (time_s - self.from_s) / BEND_S + 0.5, (self.until_s - time_s) / BEND_S + 0.5
        began = xp.where(self.from_s > 0.0, began, 1.0)
        share = xp.clip(began, 0.0, 1.0) * xp.clip(goes_on, 0.0, 1.0)
        turn = level_turn_wxyz(share * self.rise_x_rad, share * self.rise_y_rad)
        outside.gravity_m_s2[...] = rotate_wxyz(turn, outside.gravity_m_s2)


SMALL_RAD = 1e-12


def level_turn_wxyz(rise_x_rad: AnyArray, rise_y_rad: AnyArray) -> AnyArray:
    """The turn about a level axis that lays ground level that rises so along x and y, (n, 1) twice to (n, 4)."""
    xp = namespace_of(rise_x_rad)
    steep = xp.sqrt(rise_x_rad * rise_x_rad + rise_y_rad * rise_y_rad)
    share = xp.sin(0.5 * steep) / xp.clip(steep, SMALL_RAD, None)
    return xp.concat([xp.cos(0.5 * steep), -share * rise_y_rad, share * rise_x_rad, 0.0 * steep], axis=1)


@dataclass(frozen=True, kw_only=True)
class FootDrag(OutsideEffect):
    """Feet that are low are held back in proportion to their velocity, as by tall grass.

    A foot's height is that of its lowest point above the lowest foot's, so that it is the same on every slope.

    Source: blades of grass bend under 0.1 to 1 N each; a foot meets 10 to 50 of them.
    """

    name: ClassVar[str] = "foot_drag"

    drag_n_s_per_m: Any = parameter(null=0.0, low=0.0, high=40.0, unit="N·s/m", source="grass, 2 to 20 N·s/m")
    height_m: Any = parameter(null=0.0, low=0.0, high=0.5, unit="m", source="lawn 0.05 m, meadow 0.3 m")

    def surround(self, outside: Outside) -> None:
        """Add the force at each foot's centre."""
        q, v = outside.qpos, outside.qvel
        attitude, linear = q[:, 3:7], rotate_inverse_wxyz(q[:, 3:7], v[:, :3])
        foot, _, velocity = foot_motion(linear, v[:, 3:6], q[:, 7:], v[:, 6:])
        drag = self.drag_n_s_per_m * low_feet(attitude, foot, self.height_m)
        outside.foot_force_n[...] -= drag[..., None] * rotate_wxyz(attitude[:, None, :], velocity)


def foot_motion(
    linear_in_body_m_s: AnyArray, turn_in_body_rad_s: AnyArray, position_rad: AnyArray, velocity_rad_s: AnyArray
) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Places and Jacobians of the feet's centres, and their velocities against the ground; all in body axes."""
    foot, jacobian = foot_position_and_jacobian(position_rad)
    rates = velocity_rad_s.reshape(-1, facts.N_LEGS, 1, 3)
    moving = (jacobian * rates).sum(axis=-1) + cross(turn_in_body_rad_s[:, None, :], foot)
    return foot, jacobian, linear_in_body_m_s[:, None, :] + moving


def low_feet(world_from_body_wxyz: AnyArray, foot_in_body_m: AnyArray, height_m: Any) -> AnyArray:
    """1 for feet less than a height above the lowest, else 0; (n, 4) from attitudes (n, 4) and places (n, 4, 3)."""
    xp = namespace_of(foot_in_body_m)
    height = rotate_wxyz(world_from_body_wxyz[:, None, :], foot_in_body_m)[..., 2]
    above = height - xp.min(height, axis=1, keepdims=True)
    return xp.astype(above < height_m, foot_in_body_m.dtype)
