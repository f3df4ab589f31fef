"""When a robot fell: by the bounds at which the runtime itself stops, in logs and in simulated runs alike."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from diagnosis.read.recording import Array
from spot_model.robot import facts
from spot_model.robot.leg_kinematics import foot_position_in_body_m
from spot_model.robot.rotation import projected_gravity
from spot_runtime.safety_limits import SafetyLimits

TILT_RAD: Final = SafetyLimits().tilt_rad
"""A body that leans further falls."""
HEIGHT_M: Final = SafetyLimits().body_height_m
"""A body lower than this over its lowest sole has collapsed."""
AFTER_NS: Final = 100_000_000
"""The state that makes the runtime take the policy away may come this long after the policy's last tick: five ticks. A
robot that sits down, or is damped for another reason, sinks more slowly."""
SAMPLED_NS: Final = 15_000_000
"""A body that has collapsed stays down for longer: it is looked for in states so far apart."""


def fall_row(
    joint_names: tuple[str, ...], position_rad: Array, odom_from_body_wxyz: Array, stamp_ns: Any, ticks_ns: Any
) -> int:
    """First row of a log at which the robot has fallen while a policy ran; the number of rows where it never did.

    Args:
        joint_names: Of the log; the height of the body is known of Spot alone.
        position_rad: Joint positions, shape (n, J).
        odom_from_body_wxyz: Attitude, shape (n, 4).
        stamp_ns: Robot stamp of each row, shape (n,).
        ticks_ns: Those of the ticks in which the policy followed the command, shape (k,).
    """
    n = len(stamp_ns)
    if len(ticks_ns) == 0:
        return n
    first, last = np.searchsorted(stamp_ns, [ticks_ns[0], ticks_ns[-1] + AFTER_NS])
    gravity = np.asarray(projected_gravity(odom_from_body_wxyz[first:last]))
    with np.errstate(invalid="ignore"):
        is_down = gravity[:, 2] > -np.cos(TILT_RAD)
        if joint_names == facts.JOINT_NAMES and last > first:
            position = position_rad[first:last]
            every = max(1, SAMPLED_NS * (last - first) // int(stamp_ns[last - 1] - stamp_ns[first] + 1))
            if (_height_m(position[::every], gravity[::every]) < HEIGHT_M).any():
                is_down |= _height_m(position, gravity) < HEIGHT_M
    rows = np.flatnonzero(is_down)
    return int(first + rows[0]) if len(rows) else n


def _height_m(position_rad: Array, gravity_in_body: Array) -> Array:
    """Of the body over its lowest sole, shape (n,)."""
    feet = np.asarray(foot_position_in_body_m(position_rad))
    return np.asarray((feet @ gravity_in_body[:, :, None])[..., 0].max(axis=1) + facts.FOOT_RADIUS_M)
