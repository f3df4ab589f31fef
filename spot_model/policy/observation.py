"""The 48 numbers that the policy sees, built in one place for training, deployment and identification."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from spot_model.robot import facts
from spot_model.robot.arrays import namespace_of
from spot_model.robot.rotation import AnyArray, matrix_entries, matrix_from_wxyz


@dataclass(frozen=True)
class ObservationField:
    """One named block of the observation."""

    name: str
    width: int
    unit: str
    mirror: tuple[float, ...] | None
    """Sign of each number when left and right are exchanged; None for joint values, which also change legs."""
    noise: str | None
    """Key of the training config's ``task.noise`` that holds its standard deviation; None where no sensor is read."""
    reads: tuple[str, ...]
    """Fields of :class:`~spot_model.robot.state.Measured` that it is made of."""
    source: str

    @property
    def is_of_joints(self) -> bool:
        """Whether the block has one number a joint, in the policy's joint order."""
        return self.mirror is None


_ATTITUDE = "odom_from_body_wxyz"
_POLAR, _AXIAL = (1.0, -1.0, 1.0), (-1.0, 1.0, -1.0)

OBSERVATION: Final = (
    ObservationField(
        "linear_vel_of_body_in_body_m_s",
        3,
        "m/s",
        _POLAR,
        "linear_vel_m_s",
        ("linear_vel_of_body_in_odom_m_s", _ATTITUDE),
        "state estimator's odometry",
    ),
    ObservationField(
        "angular_vel_of_body_in_body_rad_s",
        3,
        "rad/s",
        _AXIAL,
        "angular_vel_rad_s",
        ("angular_vel_of_body_in_odom_rad_s", _ATTITUDE),
        "state estimator's odometry",
    ),
    ObservationField(
        "projected_gravity_in_body", 3, "1", _POLAR, "gravity", (_ATTITUDE,), "third row of the attitude's matrix"
    ),
    ObservationField("velocity_command", 3, "m/s, m/s, rad/s", (1.0, -1.0, -1.0), None, (), "the operator"),
    ObservationField(
        "joint_position_offset_rad", 12, "rad", None, "joint_position_rad", ("position_rad",), "encoders - default pose"
    ),
    ObservationField(
        "joint_velocity_rad_s", 12, "rad/s", None, "joint_velocity_rad_s", ("velocity_rad_s",), "encoders"
    ),
    ObservationField("last_action", 12, "1", None, None, (), "the network's previous output"),
)
"""The observation, field by field. Source: the paper's observation equation."""

OBSERVATION_LAYOUT: Final = tuple((field.name, field.width) for field in OBSERVATION)
"""Names and widths in order, as a policy file's contract holds them."""

N_OBSERVATION: Final = sum(field.width for field in OBSERVATION)

_ENDS = tuple(accumulate(field.width for field in OBSERVATION))
COLUMNS: Final = {field.name: slice(end - field.width, end) for field, end in zip(OBSERVATION, _ENDS, strict=True)}
"""Where each field stands in the observation's last axis."""

FALLEN_GRAVITY_Z: Final = -0.5
"""A robot has fallen once gravity's z in the body frame exceeds this: it leans by more than 60°."""


@dataclass(frozen=True)
class Sensed:
    """What many robots report of themselves; canonical joint order."""

    position_rad: AnyArray
    """Shape (n, 12)."""
    velocity_rad_s: AnyArray
    world_from_body_wxyz: AnyArray
    """Shape (n, 4); odom counts as world."""
    linear_vel_of_body_in_world_m_s: AnyArray
    """Shape (n, 3)."""
    angular_vel_of_body_in_world_rad_s: AnyArray


def observed(observation: AnyArray, name: str) -> AnyArray:
    """One field of observations: shape (..., 48) gives (..., width). Raises ``KeyError`` on an unknown name."""
    return observation[..., COLUMNS[name]]


def is_fallen(observation: AnyArray) -> AnyArray:
    """Whether each observation, shape (..., 48), is of a robot that has fallen; shape (...)."""
    return observed(observation, "projected_gravity_in_body")[..., 2] > FALLEN_GRAVITY_Z


def build_observation(
    *,
    world_from_body_wxyz: AnyArray,
    linear_vel_of_body_in_world_m_s: AnyArray,
    angular_vel_of_body_in_world_rad_s: AnyArray,
    velocity_command: AnyArray,
    position_rad: AnyArray,
    velocity_rad_s: AnyArray,
    last_action: AnyArray,
    default_position_rad: AnyArray,
) -> AnyArray:
    """Assemble the policy's observation; a joint-order change is the caller's, and the same for every joint block.

    Args:
        world_from_body_wxyz: Attitude (odom counts as world). Shape (..., 4).
        linear_vel_of_body_in_world_m_s: Shape (..., 3).
        angular_vel_of_body_in_world_rad_s: Shape (..., 3).
        velocity_command: Operator's V_x, V_y (m/s) and ω_z (rad/s) in the body frame. Shape (..., 3).
        position_rad: Joint position. Shape (..., 12), rad.
        velocity_rad_s: Joint velocity. Shape (..., 12), rad/s.
        last_action: The network's previous output. Shape (..., 12), unscaled.
        default_position_rad: Broadcastable to (..., 12), rad, same joint order.

    Returns:
        Observation, shape (..., 48), in the order of :data:`OBSERVATION_LAYOUT`.
    """
    xp = namespace_of(position_rad)
    # One matrix serves all three vectors; this runs in the control loop, where quaternion products cost too much.
    world_from_body = matrix_from_wxyz(world_from_body_wxyz)
    return xp.concat(
        [
            xp.sum(world_from_body * linear_vel_of_body_in_world_m_s[..., :, None], axis=-2),
            xp.sum(world_from_body * angular_vel_of_body_in_world_rad_s[..., :, None], axis=-2),
            -world_from_body[..., 2, :],
            velocity_command,
            position_rad - default_position_rad,
            velocity_rad_s,
            last_action,
        ],
        axis=-1,
    )


def observations_at_rest(measured: Any, rows: slice) -> NDArray[np.float64]:
    """Observations of what a robot measured, as if nothing were asked of it; shape (n, 48), canonical order.

    ``measured`` has the arrays of :class:`~spot_model.robot.state.Measured` with a row a state, as a log's table has.
    """
    n = len(measured.position_rad[rows])
    observation = build_observation(
        world_from_body_wxyz=measured.odom_from_body_wxyz[rows],
        linear_vel_of_body_in_world_m_s=measured.linear_vel_of_body_in_odom_m_s[rows],
        angular_vel_of_body_in_world_rad_s=measured.angular_vel_of_body_in_odom_rad_s[rows],
        velocity_command=np.zeros((n, 3)),
        position_rad=measured.position_rad[rows],
        velocity_rad_s=measured.velocity_rad_s[rows],
        last_action=np.zeros((n, facts.N_JOINTS)),
        default_position_rad=facts.DEFAULT_POSITION_RAD,
    )
    return np.asarray(observation)


def observation_of_one(
    *,
    world_from_body_wxyz: NDArray[np.float64],
    linear_vel_of_body_in_world_m_s: NDArray[np.float64],
    angular_vel_of_body_in_world_rad_s: NDArray[np.float64],
    velocity_command: NDArray[np.float64],
    position_rad: NDArray[np.float64],
    velocity_rad_s: NDArray[np.float64],
    last_action: NDArray[np.float32],
    default_position_rad: NDArray[np.float64],
) -> NDArray[np.float64]:
    """:func:`build_observation` for one robot, bit for bit, for the control loop: shape (48,).

    On plain numbers, because each call into NumPy costs several microseconds when the caches are cold, as they are
    at the pace of a run.
    """
    a, b, c, d, e, f, g, h, i = matrix_entries(*world_from_body_wxyz.tolist())
    u, v, w = linear_vel_of_body_in_world_m_s.tolist()
    p, q, r = angular_vel_of_body_in_world_rad_s.tolist()
    body = (a * u + d * v + g * w, b * u + e * v + h * w, c * u + f * v + i * w)
    turn = (a * p + d * q + g * r, b * p + e * q + h * r, c * p + f * q + i * r)
    offset = (position_rad - default_position_rad).tolist()
    command, speed, action = velocity_command.tolist(), velocity_rad_s.tolist(), last_action.tolist()
    return np.array((*body, *turn, -g, -h, -i, *command, *offset, *speed, *action))
