"""A policy period's states, made into what the checks compare."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot_model.robot import facts
from spot_model.robot.facts import NS_PER_S, Array
from spot_model.robot.state import ImuPacket, RobotState
from spot_runtime.control.safety.signals import bounds


class Window(NamedTuple):
    """What happened from the first state to the last, both included."""

    first: RobotState
    last: RobotState
    duration_s: float
    hole_s: float
    """By how much the two states that are furthest apart are so beyond the usual period."""
    travel_rad: Array
    """Integral of each joint's velocity. Shape (12,)."""
    velocity_range_rad_s: Array
    """Range of each joint's velocity. Shape (12,)."""
    turn_rad: Array
    """Integral of the body's turn rate, in odom. Shape (3,)."""
    turn_rate_range_rad_s: float
    """Range of the turn rate on its widest axis."""
    odom_from_body: Array
    """Rotation matrix of the last attitude. Shape (3, 3)."""
    contact_changed: bool
    """Whether any foot touched down or lifted off."""
    imu: tuple[ImuPacket, ...]
    """All packets of the inertial unit, oldest first; empty where none are reported."""


def window_of(states: Sequence[RobotState]) -> Window | None:
    """The window over these states, oldest first; None where some are missing between them, or there are too few."""
    if len(states) < 2:
        return None
    stamps_s = [(state.robot_stamp_ns - states[0].robot_stamp_ns) / NS_PER_S for state in states]
    steps_s = np.diff(stamps_s)
    longest_s = float(steps_s.max())
    if longest_s > bounds.GAP_S:
        return None
    # Trapezoid rule: each state counts with half the time to its neighbours.
    weights = np.zeros(len(states))
    weights[:-1] += 0.5 * steps_s
    weights[1:] += 0.5 * steps_s
    velocity = np.array([state.velocity_rad_s for state in states])
    turn_rate = np.array([state.angular_vel_of_body_in_odom_rad_s for state in states])
    contacts: NDArray[np.bool_] = np.array([state.foot_contact for state in states])
    return Window(
        first=states[0],
        last=states[-1],
        duration_s=stamps_s[-1],
        hole_s=max(0.0, longest_s - facts.STATE_PERIOD_NS / NS_PER_S),
        travel_rad=weights @ velocity,
        velocity_range_rad_s=velocity.max(axis=0) - velocity.min(axis=0),
        turn_rad=weights @ turn_rate,
        turn_rate_range_rad_s=float((turn_rate.max(axis=0) - turn_rate.min(axis=0)).max()),
        odom_from_body=rotation_matrix(states[-1].odom_from_body_wxyz),
        contact_changed=bool((contacts.any(axis=0) != contacts.all(axis=0)).any()),
        imu=tuple(packet for state in states[1:] for packet in state.imu),
    )


def rotation_matrix(wxyz: Array) -> Array:
    """Rotation matrix of a unit quaternion. Shape (3, 3)."""
    w, x, y, z = wxyz.tolist()
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def turned_rad(before_wxyz: Array, after_wxyz: Array) -> Array:
    """The rotation between two attitudes as a vector in odom, the short way round. Shape (3,)."""
    w0, x0, y0, z0 = before_wxyz.tolist()
    w1, x1, y1, z1 = after_wxyz.tolist()
    # after · conj(before)
    w = w1 * w0 + x1 * x0 + y1 * y0 + z1 * z0
    x = -w1 * x0 + x1 * w0 - y1 * z0 + z1 * y0
    y = -w1 * y0 + x1 * z0 + y1 * w0 - z1 * x0
    z = -w1 * z0 - x1 * y0 + y1 * x0 + z1 * w0
    length = math.sqrt(x * x + y * y + z * z)
    if length == 0.0:
        return np.zeros(3)
    angle = 2.0 * math.atan2(math.copysign(length, w), abs(w))
    return np.array([x, y, z]) * (angle / length)


def length(vector: Array) -> float:
    """Length of a vector, shape (3,)."""
    return float(np.sqrt(vector @ vector))
