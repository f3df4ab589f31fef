"""Channel *inertial unit*: accelerations against velocities, turn rates against attitude.

Time convention: packets are brought forward by their own age to the state's stamp. Both sides are smoothed twice, so
that lags, which need a second derivative, keep their size.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.channels.body.body_model import imu_gravity_m_s2
from diagnosis.channels.body.dynamics import STRIDE, kept_rows
from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelOff, ChannelView
from diagnosis.channels.stack import Stack, white_noise
from spot_model.robot.rotation import conjugate_wxyz, multiply_wxyz, rotate_inverse_wxyz, rotate_wxyz
from trainer.signals.smoothing import REACH

NEEDED: Final = {
    "imu.acceleration_m_s2": "inertial unit",
    "odom_from_body_wxyz": "attitude",
    "linear_vel_of_body_in_odom_m_s": "body velocity",
}
ROWS: Final = ("acceleration_x", "acceleration_y", "acceleration_z", "turn_x", "turn_y", "turn_z")
FLOOR: Final = np.array([0.3, 0.3, 0.5, 0.03, 0.03, 0.03])
"""What impacts and soft mounts leave at least, m/s² and rad/s."""


@dataclass(frozen=True)
class InertialSignals:
    """Signals of channel *inertial unit*, N rows at the full rate."""

    stack: Stack
    rows: NDArray[np.intp]
    odom_from_body_wxyz: Array
    reading_m_s2: Array
    """In the link's frame, gravity in it or not as the unit reports."""
    linear_vel_in_odom_m_s: Array
    angular_vel_in_body_rad_s: Array
    velocity_rate_in_body_m_s2: Array
    """Rate of the velocity's components in the body frame, by the unit, at its own stamps."""

    def thinned(self, every: int) -> tuple[InertialSignals, NDArray[np.bool_]]:
        """Signals of one of ``every`` rows, and these rows."""
        keep = self.rows % (STRIDE * every) == 0
        return replace(self, rows=self.rows[keep]), keep

    def finish(self, in_odom: Array) -> Array:
        """An acceleration in odom (N, 3) as the channel's rows have it, shape (n, 6)."""
        twice = self.stack.smooth(self.stack.smooth(in_odom), self.rows)
        return np.concatenate([twice, np.zeros_like(twice)], axis=1)

    def finish_rate(self, in_odom: Array) -> Array:
        """The derivative of a velocity, likewise."""
        once = self.stack.smooth(self.stack.rate(in_odom), self.rows)
        return np.concatenate([once, np.zeros_like(once)], axis=1)


def inertial_view(stack: Stack) -> ChannelView | ChannelOff:
    """Build the channel *inertial unit*."""
    if stack.too_coarse():
        return ChannelOff(Channel.INERTIAL_UNIT, stack.too_coarse())
    if missing := stack.missing(NEEDED):
        return ChannelOff(Channel.INERTIAL_UNIT, f"no {missing}")
    gravity = imu_gravity_m_s2(stack)
    if gravity is None:
        return ChannelOff(Channel.INERTIAL_UNIT, "the inertial unit's mean reading is neither gravity nor none")
    attitude = stack.filled(lambda r: r.odom_from_body_wxyz)
    rows = kept_rows(stack, 2 * REACH)
    reading = stack.filled(lambda r: r.imu.acceleration_m_s2)
    age_s = stack.recordings[0].imu.age_s
    felt = np.asarray(rotate_wxyz(attitude, reading))
    velocity = stack.filled(lambda r: r.linear_vel_of_body_in_odom_m_s)
    turn = rotate_inverse_wxyz(attitude, stack.filled(lambda r: r.angular_vel_of_body_in_odom_rad_s))
    signals = InertialSignals(
        stack=stack,
        rows=rows,
        odom_from_body_wxyz=attitude,
        reading_m_s2=reading,
        angular_vel_in_body_rad_s=turn,
        velocity_rate_in_body_m_s2=np.asarray(
            rotate_inverse_wxyz(attitude, felt - np.array([0.0, 0.0, gravity]))
            - np.cross(turn, rotate_inverse_wxyz(attitude, velocity))
        ),
        linear_vel_in_odom_m_s=velocity,
    )
    felt_now = signals.finish(felt) + age_s * signals.finish_rate(felt)
    upright = np.array([0.0, 0.0, gravity, 0.0, 0.0, 0.0])
    acceleration = felt_now - upright - signals.finish_rate(signals.linear_vel_in_odom_m_s)
    response = acceleration + _turns(signals, age_s)
    usable = np.ones(response.shape, dtype=np.bool_)
    return stack.view(
        Channel.INERTIAL_UNIT,
        rows,
        response,
        rows=ROWS,
        unit="m/s², rad/s",
        usable=usable,
        noise=np.maximum(FLOOR, white_noise(response, usable, is_smoothed=True)),
        signals=signals,
    )


def _turns(signals: InertialSignals, age_s: float) -> Array:
    """Turn rate by the unit less that of the attitude, body frame, in the last three of six columns."""
    stack = signals.stack
    attitude = signals.odom_from_body_wxyz
    gyro = stack.filled(lambda r: r.imu.angular_vel_rad_s)
    read = stack.smooth(stack.smooth(gyro)) + age_s * stack.smooth(stack.rate(gyro))
    change = multiply_wxyz(conjugate_wxyz(stack.smooth(attitude)), stack.rate(attitude))
    turn = (read - stack.smooth(2.0 * np.asarray(change)[:, 1:]))[signals.rows]
    return np.concatenate([np.zeros_like(turn), turn], axis=1)
