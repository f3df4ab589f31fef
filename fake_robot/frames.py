"""Odometry frames: fixed in the world, but neither at its origin nor along its axes."""

from __future__ import annotations

import math

import numpy as np

from spot_model.facts import Array


class Frame:
    """A frame that is shifted, and turned about the vertical, from the world.

    Args:
        position_in_world_m: Its origin, shape (3,).
        yaw_rad: Its heading.
    """

    def __init__(self, position_in_world_m: tuple[float, float, float], yaw_rad: float) -> None:
        self._origin = np.array(position_in_world_m)
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        self._from_world = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        w, z = math.cos(-0.5 * yaw_rad), math.sin(-0.5 * yaw_rad)
        # Left multiplication by the frame's quaternion (w, 0, 0, z), as a matrix.
        self._multiply = np.array([[w, 0.0, 0.0, -z], [0.0, w, -z, 0.0], [0.0, z, w, 0.0], [z, 0.0, 0.0, w]])

    def point(self, in_world_m: Array) -> Array:
        """A point of the world in this frame, shape (3,)."""
        return np.asarray(self._from_world @ (in_world_m - self._origin))

    def vector(self, in_world: Array) -> Array:
        """A vector of the world in this frame, shape (3,)."""
        return np.asarray(self._from_world @ in_world)

    def rotation(self, world_from_body_wxyz: Array) -> Array:
        """The body's attitude in this frame, shape (4,)."""
        return np.asarray(self._multiply @ world_from_body_wxyz)
