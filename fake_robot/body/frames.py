"""Odometry frames: fixed in the world, but neither at its origin nor along its axes.

In plain floats: for three numbers at a time they are several times as fast as arrays.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class Frame:
    """A frame that is shifted, and turned about the vertical, from the world."""

    def __init__(self, position_in_world_m: Vector, yaw_rad: float) -> None:
        self._x, self._y, self._z = position_in_world_m
        self._cos, self._sin = math.cos(yaw_rad), math.sin(yaw_rad)
        # The frame's quaternion in the world is (w, 0, 0, -z); this is its inverse.
        self._qw, self._qz = math.cos(0.5 * yaw_rad), -math.sin(0.5 * yaw_rad)

    def point(self, in_world_m: Sequence[float]) -> Vector:
        """A point of the world in this frame."""
        x, y, z = in_world_m
        return self.vector((x - self._x, y - self._y, z - self._z))

    def vector(self, in_world: Sequence[float]) -> Vector:
        """A vector of the world in this frame."""
        x, y, z = in_world
        cos, sin = self._cos, self._sin
        return cos * x + sin * y, cos * y - sin * x, z

    def rotation(self, world_from_body_wxyz: Sequence[float]) -> Quaternion:
        """The body's attitude in this frame, scalar first."""
        w, x, y, z = world_from_body_wxyz
        a, b = self._qw, self._qz
        return a * w - b * z, a * x - b * y, a * y + b * x, a * z + b * w
