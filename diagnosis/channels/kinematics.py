"""Channels of the body's motion without forces.

Channel *stance kinematics*: feet that stand do not move, and stand on one level.

Rows: velocity of each standing foot's contact point along the heading, to its left and up, m/s; then each standing
foot's height less the mean of all that stand, m. Both from joints, attitude and the estimator's velocity; the body's
odometry height is not used. Time convention: all of one state.

Channel *inertial unit*: accelerations against velocities, turn rates against attitude.

Time convention: packets are brought forward by their own age to the state's stamp. Both sides are smoothed twice, so
that lags, which need a second derivative, keep their size.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.channels import Array, Channel, ChannelOff, ChannelView, Flags
from diagnosis.channels.body_model import BodyModel, contact_point_and_jacobian
from diagnosis.channels.dynamics import DynamicsSignals
from diagnosis.channels.stack import STRIDE, Stack, white_noise
from spot_model.robot import facts
from spot_model.robot.rotation import conjugate_wxyz, multiply_wxyz, rotate_inverse_wxyz, rotate_wxyz, yaw_rad
from trainer.signals.smoothing import REACH, smooth

AFTER_TOUCH_DOWN: Final = 9
BEFORE_LIFT_OFF: Final = 7
"""States by which a stance is shortened at its ends: flags come late, and impacts are smoothed over."""
SPRINGS_BACK: Final = 25
"""States after touch-down in which ground that gave way lifts the foot again: vertical velocities do not count."""
VELOCITY_FLOOR_M_S: Final = (0.02, 0.02, 0.1)
HEIGHT_FLOOR_M: Final = 0.002
"""What ground that is neither hard nor even leaves at least, along, across and up: soft ground springs back."""
ROWS: Final = (
    *(f"{leg}_velocity_{axis}" for leg in facts.LEG_NAMES for axis in ("x", "y", "z")),
    *(f"{leg}_height" for leg in facts.LEG_NAMES),
)


@dataclass(frozen=True)
class Kinematics:
    """What foot positions and velocities follow from, N rows at the full rate."""

    odom_from_body_wxyz: Array
    linear_vel_in_body_m_s: Array
    angular_vel_in_body_rad_s: Array
    position_rad: Array
    velocity_rad_s: Array
    foot_radius_m: Array
    """Shape (4,)."""

    def of(self, change: Callable[[Array], Array]) -> Kinematics:
        """What a function makes of each signal."""
        signals = {f.name: change(getattr(self, f.name)) for f in fields(self) if f.name != "foot_radius_m"}
        return replace(self, **signals)


@dataclass(frozen=True)
class StanceSignals:
    """Signals of channel *stance kinematics*."""

    stack: Stack
    rows: NDArray[np.intp]
    """Rows of the stack that are kept."""
    raw: Kinematics
    inputs: Kinematics
    """Smoothed, at the kept rows: what a change of them changes in the response is small. Likewise, shape (n, 12):"""
    load_nm: Array
    load_rate_nm_s: Array
    position_rate_rad_s: Array
    standing: Flags
    """Well within a stance, at the full rate. Shape (N, 4)."""
    rising_m_s: Array
    """Vertical velocity of the contact points, at the full rate. Shape (N, 4)."""
    acceleration_in_body_m_s2: Array
    """Rate of the body's velocity as seen in the body, by the inertial unit where there is one. Shape (N, 3)."""
    dynamics: DynamicsSignals | None
    """For forces, where there are loads."""
    cache: dict[object, Any] = field(default_factory=dict, compare=False)

    def thinned(self, apart: int) -> tuple[StanceSignals, Flags]:
        """Signals of rows ``apart`` states from each other, or a little less, and these rows."""
        keep = self.rows % max(STRIDE, apart - apart % STRIDE) == 0
        names = ("rows", "load_nm", "load_rate_nm_s", "position_rate_rad_s")
        rows = {name: getattr(self, name)[keep] for name in names}
        return replace(self, **rows, inputs=self.inputs.of(lambda x: x[keep]), cache={}), keep

    def correction(self, _: Channel, key: object, **changes: Array) -> Array:
        """What the channel shows less what it would show for other inputs, shape (n, 16); kept under ``key``."""
        if key not in self.cache:
            reference, changed = (
                standing_feet(k, self.standing[self.rows]) for k in (self.inputs, replace(self.inputs, **changes))
            )
            self.cache[key] = reference - changed
        found: Array = self.cache[key]
        return found

    def finish_velocity(self, in_body: Array) -> Array:
        """A change of the body's velocity (N, 3), body frame, as all feet see it: smoothed, shape (n, 16)."""
        heading = _in_heading(self.raw.odom_from_body_wxyz, in_body)
        velocities = smooth(np.tile(heading, (1, facts.N_LEGS)), self.rows)
        return np.pad(velocities, ((0, 0), (0, facts.N_LEGS)))


def stance_view(stack: Stack, model: BodyModel, dynamics: DynamicsSignals | None) -> ChannelView:
    """Build the channel *stance kinematics*; ``dynamics`` gives the feet's forces to what depends on them."""
    inputs = Kinematics(
        odom_from_body_wxyz=stack.states.odom_from_body_wxyz,
        linear_vel_in_body_m_s=stack.linear_vel_in_body_m_s,
        angular_vel_in_body_rad_s=stack.angular_vel_in_body_rad_s,
        position_rad=stack.states.position_rad,
        velocity_rad_s=stack.states.velocity_rad_s,
        foot_radius_m=model.foot_radius_m,
    )
    contact = stack.states.foot_contact if dynamics is None else dynamics.contact
    standing = stack.inner(contact & stack.used[:, None], AFTER_TOUCH_DOWN, BEFORE_LIFT_OFF)
    rows = stack.kept_rows()
    heading, height = motion_of_feet(inputs)
    response = smooth(_rows_of(heading, height, standing), rows)
    steady = stack.inner(standing)[rows]
    # A height means something against another foot's, and the same feet must stand throughout the filter's reach.
    unchanged = np.all((stack.inner(contact) | stack.inner(~contact))[rows], axis=1)
    several = steady & (standing[rows].sum(axis=1, keepdims=True) >= 2) & unchanged[:, None]
    settled = steady & stack.inner(contact, SPRINGS_BACK, 0)[rows]
    velocities = np.stack([steady, steady, settled], axis=2).reshape(len(rows), -1)
    usable = np.concatenate([velocities, several], axis=1)
    legs = np.arange(facts.N_LEGS)
    acceleration, load = _acceleration_in_body(stack, inputs), stack.states.load_nm
    floor = np.concatenate([np.tile(VELOCITY_FLOOR_M_S, facts.N_LEGS), np.full(4, HEIGHT_FLOOR_M)])
    return stack.view(
        Channel.STANCE_KINEMATICS,
        rows,
        response,
        rows=ROWS,
        unit="m/s, m",
        usable=usable,
        noise=np.maximum(floor, white_noise(response, usable, is_smoothed=True)),
        row_leg=np.concatenate([np.repeat(legs, 3), legs]),
        leg_of_joint=np.repeat(legs, 3),
        signals=StanceSignals(
            stack=stack,
            rows=rows,
            raw=inputs,
            inputs=inputs.of(lambda x: smooth(x, rows)),
            load_nm=smooth(load, rows),
            load_rate_nm_s=stack.rate(load, rows),
            position_rate_rad_s=stack.rate(inputs.position_rad, rows),
            standing=standing,
            rising_m_s=heading[..., 2],
            acceleration_in_body_m_s2=acceleration,
            dynamics=dynamics,
        ),
    )


def standing_feet(k: Kinematics, standing: Flags) -> Array:
    """Velocities of the contact points in the heading frame, then heights less the standing feet's mean; (N, 16)."""
    return _rows_of(*motion_of_feet(k), standing)


def motion_of_feet(k: Kinematics) -> tuple[Array, Array]:
    """Velocities of the contact points in the heading frame (N, 4, 3), and their heights (N, 4)."""
    point, jacobian = contact_point_and_jacobian(k.position_rad, k.odom_from_body_wxyz, k.foot_radius_m)
    rates = k.velocity_rad_s.reshape(len(point), facts.N_LEGS, 1, 3)
    turn = k.angular_vel_in_body_rad_s[:, None, :]
    velocity = k.linear_vel_in_body_m_s[:, None, :] + np.cross(turn, point) + (jacobian * rates).sum(axis=-1)
    heading = _in_heading(k.odom_from_body_wxyz[:, None, :], velocity)
    return heading, np.asarray(rotate_wxyz(k.odom_from_body_wxyz[:, None, :], point)[..., 2])


def _rows_of(heading: Array, height: Array, standing: Flags) -> Array:
    """Velocities, then heights less their mean over the feet that stand."""
    count = np.maximum(standing.sum(axis=1, keepdims=True), 1)
    above_mean = height - np.sum(np.where(standing, height, 0.0), axis=1, keepdims=True) / count
    return np.concatenate([heading.reshape(len(heading), -1), above_mean], axis=1)


def _acceleration_in_body(stack: Stack, k: Kinematics) -> Array:
    """Derivative of the velocity's components in the body frame, shape (N, 3), m/s²."""
    gravity = stack.imu_gravity_m_s2
    if gravity is None:
        return np.asarray(np.gradient(k.linear_vel_in_body_m_s, stack.period_s, axis=0))
    upright = np.broadcast_to([0.0, 0.0, gravity], (stack.n, 3))
    felt = stack.imu.acceleration_m_s2 - rotate_inverse_wxyz(k.odom_from_body_wxyz, upright)
    return np.asarray(felt - np.cross(k.angular_vel_in_body_rad_s, k.linear_vel_in_body_m_s))


def _in_heading(odom_from_body_wxyz: Array, in_body: Array) -> Array:
    """A vector of the body frame in the frame that turns with the heading only; same shape."""
    odom = rotate_wxyz(odom_from_body_wxyz, in_body)
    half = 0.5 * yaw_rad(odom_from_body_wxyz)
    zero = np.zeros_like(half)
    return np.asarray(rotate_inverse_wxyz(np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1), odom))


INERTIAL_ROWS: Final = ("acceleration_x", "acceleration_y", "acceleration_z", "turn_x", "turn_y", "turn_z")
INERTIAL_FLOOR: Final = np.array([0.3, 0.3, 0.5, 0.03, 0.03, 0.03])
"""What impacts and soft mounts leave at least, m/s² and rad/s."""


@dataclass(frozen=True)
class InertialSignals:
    """Signals of channel *inertial unit*, N rows at the full rate."""

    stack: Stack
    rows: NDArray[np.intp]
    velocity_rate_in_body_m_s2: Array
    """Rate of the velocity's components in the body frame, by the unit, at its own stamps."""

    def thinned(self, apart: int) -> tuple[InertialSignals, NDArray[np.bool_]]:
        """Signals of rows ``apart`` states from each other, or a little less, and these rows."""
        keep = self.rows % max(STRIDE, apart - apart % STRIDE) == 0
        return replace(self, rows=self.rows[keep]), keep

    def finish(self, in_odom: Array) -> Array:
        """An acceleration in odom (N, 3) as the channel's rows have it, shape (n, 6)."""
        twice = smooth(smooth(in_odom), self.rows)
        return np.concatenate([twice, np.zeros_like(twice)], axis=1)

    def finish_rate(self, in_odom: Array) -> Array:
        """The derivative of a velocity, likewise."""
        once = smooth(self.stack.rate(in_odom), self.rows)
        return np.concatenate([once, np.zeros_like(once)], axis=1)


def inertial_view(stack: Stack) -> ChannelView | ChannelOff:
    """Build the channel *inertial unit*."""
    gravity = stack.imu_gravity_m_s2
    if gravity is None:
        return ChannelOff(Channel.INERTIAL_UNIT, "the inertial unit's mean reading is neither gravity nor none")
    felt, rows = stack.imu_in_odom_m_s2, stack.kept_rows(2 * REACH)
    pushed = rotate_inverse_wxyz(stack.states.odom_from_body_wxyz, felt - np.array([0.0, 0.0, gravity]))
    turning = np.cross(stack.angular_vel_in_body_rad_s, stack.linear_vel_in_body_m_s)
    signals = InertialSignals(stack, rows, velocity_rate_in_body_m_s2=np.asarray(pushed - turning))
    felt_now = signals.finish(felt) + stack.imu.age_s * signals.finish_rate(felt)
    upright = np.array([0.0, 0.0, gravity, 0.0, 0.0, 0.0])
    acceleration = felt_now - upright - signals.finish_rate(stack.states.linear_vel_of_body_in_odom_m_s)
    response = acceleration + _turns(stack, rows)
    usable = np.ones(response.shape, dtype=np.bool_)
    return stack.view(
        Channel.INERTIAL_UNIT,
        rows,
        response,
        rows=INERTIAL_ROWS,
        unit="m/s², rad/s",
        usable=usable,
        noise=np.maximum(INERTIAL_FLOOR, white_noise(response, usable, is_smoothed=True)),
        signals=signals,
    )


def _turns(stack: Stack, rows: NDArray[np.intp]) -> Array:
    """Turn rate by the unit less that of the attitude, body frame, in the last three of six columns, at some rows."""
    gyro, attitude = stack.imu.angular_vel_rad_s, stack.states.odom_from_body_wxyz
    read = smooth(smooth(gyro)) + stack.imu.age_s * smooth(stack.rate(gyro))
    change = multiply_wxyz(conjugate_wxyz(smooth(attitude)), stack.rate(attitude))
    turn = (read - smooth(2.0 * np.asarray(change)[:, 1:]))[rows]
    return np.concatenate([np.zeros_like(turn), turn], axis=1)
