"""Quaternions, scalar first, batched over leading axes, for NumPy and torch alike."""

from __future__ import annotations

from typing import Any

import numpy as np

from spot_model.robot.arrays import namespace_of

# Arrays are Any: one formula serves NumPy arrays and torch tensors, which share no static type.
AnyArray = Any

LEVEL_WXYZ = np.array([1.0, 0.0, 0.0, 0.0])
"""No rotation at all."""
LEVEL_WXYZ.flags.writeable = False


def multiply_wxyz(a_wxyz: AnyArray, b_wxyz: AnyArray) -> AnyArray:
    """Hamilton product of two quaternions, shape (..., 4): the rotation b, then a."""
    xp = namespace_of(a_wxyz)
    aw, ax, ay, az = (a_wxyz[..., i : i + 1] for i in range(4))
    bw, bx, by, bz = (b_wxyz[..., i : i + 1] for i in range(4))
    return xp.concat(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def conjugate_wxyz(quaternion_wxyz: AnyArray) -> AnyArray:
    """The inverse of a unit quaternion, shape (..., 4)."""
    xp = namespace_of(quaternion_wxyz)
    return xp.concat([quaternion_wxyz[..., :1], -quaternion_wxyz[..., 1:]], axis=-1)


def rotate_wxyz(a_from_b_wxyz: AnyArray, vector_in_b: AnyArray) -> AnyArray:
    """Express a vector of frame b in frame a. Shapes (..., 4) and (..., 3) give (..., 3)."""
    xp = namespace_of(a_from_b_wxyz)
    w, u = a_from_b_wxyz[..., :1], a_from_b_wxyz[..., 1:]
    uv = _cross(xp, u, vector_in_b)
    return vector_in_b + 2.0 * (w * uv + _cross(xp, u, uv))


def rotate_inverse_wxyz(a_from_b_wxyz: AnyArray, vector_in_a: AnyArray) -> AnyArray:
    """Express a vector of frame a in frame b, given the rotation a_from_b. Shapes (..., 4), (..., 3) give (..., 3)."""
    xp = namespace_of(a_from_b_wxyz)
    w, u = a_from_b_wxyz[..., :1], a_from_b_wxyz[..., 1:]
    uv = _cross(xp, u, vector_in_a)
    return vector_in_a - 2.0 * (w * uv - _cross(xp, u, uv))


def matrix_from_wxyz(a_from_b_wxyz: AnyArray) -> AnyArray:
    """Rotation matrix of a unit quaternion: column j is b's axis j in frame a. Shape (..., 4) gives (..., 3, 3)."""
    xp = namespace_of(a_from_b_wxyz)
    w, x, y, z = (a_from_b_wxyz[..., i] for i in range(4))
    return xp.reshape(xp.stack(matrix_entries(w, x, y, z), axis=-1), (*a_from_b_wxyz.shape[:-1], 3, 3))


def matrix_entries(w: AnyArray, x: AnyArray, y: AnyArray, z: AnyArray) -> tuple[AnyArray, ...]:
    """The nine entries of :func:`matrix_from_wxyz`, row by row; numbers serve as well as arrays."""
    xx, yy, zz, xy, xz, yz, wx, wy, wz = x * x, y * y, z * z, x * y, x * z, y * z, w * x, w * y, w * z
    return (
        *(1.0 - 2.0 * (yy + zz), 2.0 * (xy - wz), 2.0 * (xz + wy)),
        *(2.0 * (xy + wz), 1.0 - 2.0 * (xx + zz), 2.0 * (yz - wx)),
        *(2.0 * (xz - wy), 2.0 * (yz + wx), 1.0 - 2.0 * (xx + yy)),
    )


def projected_gravity(world_from_body_wxyz: AnyArray) -> AnyArray:
    """Unit gravity vector in the body frame, shape (..., 3); (0, 0, −1) when level."""
    w, x, y, z = (world_from_body_wxyz[..., i] for i in range(4))
    xp = namespace_of(world_from_body_wxyz)
    return xp.stack([-2.0 * (x * z - w * y), -2.0 * (y * z + w * x), -(1.0 - 2.0 * (x * x + y * y))], axis=-1)


def yaw_rad(world_from_body_wxyz: AnyArray) -> AnyArray:
    """Heading about the world's z axis, shape (...,), rad in (−π, π]."""
    xp = namespace_of(world_from_body_wxyz)
    w, x, y, z = (world_from_body_wxyz[..., i] for i in range(4))
    return xp.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def tilt_rad(world_from_body_wxyz: AnyArray) -> AnyArray:
    """Angle between the body's z axis and the vertical, shape (...,), rad in [0, π]."""
    xp = namespace_of(world_from_body_wxyz)
    x, y = world_from_body_wxyz[..., 1], world_from_body_wxyz[..., 2]
    return xp.acos(xp.clip(1.0 - 2.0 * (x * x + y * y), -1.0, 1.0))


def cross(a: AnyArray, b: AnyArray) -> AnyArray:
    """Cross product of vectors, shape (..., 3)."""
    return _cross(namespace_of(a), a, b)


def _cross(xp: Any, a: AnyArray, b: AnyArray) -> AnyArray:
    # Slices of width 1: to stack numbers costs NumPy more, by the call.
    (ax, ay, az), (bx, by, bz) = ((v[..., :1], v[..., 1:2], v[..., 2:]) for v in (a, b))
    return xp.concat([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)
