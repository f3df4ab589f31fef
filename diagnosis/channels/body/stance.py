"""Channel *stance kinematics*: feet that stand do not move, and stand on one level.

Rows: velocity of each standing foot's contact point along the heading, to its left and up, m/s; then each standing
foot's height less the mean of all that stand, m. Both from joints, attitude and the estimator's velocity; the body's
odometry height is not used. Time convention: all of one state.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.channels.body.base_motion import imu_gravity_m_s2
from diagnosis.channels.body.body_model import BodyModel
from diagnosis.channels.body.dynamics import DynamicsSignals, contact_point_and_jacobian
from diagnosis.channels.body.vectors import cross
from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelOff, ChannelView, Flags
from diagnosis.channels.stack import Stack, white_noise
from spot_model.effects.base import Effect
from spot_model.robot import facts
from spot_model.robot.rotation import rotate_inverse_wxyz, rotate_wxyz, yaw_rad

STRIDE: Final = 4
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


@dataclass(frozen=True)
class StanceSignals:
    """Signals of channel *stance kinematics*."""

    stack: Stack
    rows: NDArray[np.intp]
    """Rows of the stack that are kept."""
    kinematics: Kinematics
    foot_radius_m: Array
    standing: Flags
    """Well within a stance, at the full rate. Shape (N, 4)."""
    nominal: Array
    """Smoothed response, shape (n, 16)."""
    raw: tuple[Array, Array]
    """Of the signals as they are, at the full rate: :func:`motion_of_feet`."""
    acceleration_in_body_m_s2: Array
    """Rate of the body's velocity as seen in the body, by the inertial unit where there is one. Shape (N, 3)."""
    dynamics: DynamicsSignals | None
    """For forces, where there are loads."""
    cache: dict[object, Any] = field(default_factory=dict, compare=False)

    def thinned(self, every: int) -> tuple[StanceSignals, Flags]:
        """Signals of one of ``every`` rows, and these rows."""
        keep = self.rows % (STRIDE * every) == 0
        return replace(self, rows=self.rows[keep], nominal=self.nominal[keep], cache={}), keep

    def corrected(self, key: object, *, foot_radius_m: Array | None = None, **changes: Array) -> Array:
        """The response if signals were others, smoothed, shape (n, 16); kept under ``key``."""
        if key not in self.cache:
            radius = self.foot_radius_m if foot_radius_m is None else foot_radius_m
            self.cache[key] = self._corrected(radius, changes)
        found: Array = self.cache[key]
        return found

    def _corrected(self, radius: Array, changes: Mapping[str, Array]) -> Array:
        """Computed for the one leg that differs, where it is one; the others' bits stay as they are."""
        legs = self._changed_legs(radius, changes)
        if legs is None:
            return self.stack.smooth(feet(replace(self.kinematics, **changes), radius, self.standing), self.rows)
        heading, height = motion_of_feet(replace(self.kinematics, **changes), radius, legs)
        heights = self.raw[1].copy()
        heights[:, legs] = height
        raw = np.concatenate([heading.reshape(len(heading), -1), above_mean(heights, self.standing)], axis=1)
        new = self.stack.smooth(raw, self.rows)
        out = self.nominal.copy()
        out[:, 3 * legs.start : 3 * legs.stop] = new[:, : -facts.N_LEGS]
        out[:, 3 * facts.N_LEGS :] = new[:, -facts.N_LEGS :]
        return out

    def _changed_legs(self, radius: Array, changes: Mapping[str, Array]) -> slice | None:
        """The one leg that differs; None for several, or none."""
        differs = radius != self.foot_radius_m
        for name, value in changes.items():
            if name not in ("position_rad", "velocity_rad_s"):
                return None
            joints = np.any(value != getattr(self.kinematics, name), axis=0)
            differs = differs | joints.reshape(facts.N_LEGS, 3).any(axis=1)
        found = np.flatnonzero(differs)
        return slice(int(found[0]), int(found[0]) + 1) if len(found) == 1 else None

    def finish_velocity(self, in_body: Array) -> Array:
        """A change of the body's velocity (N, 3), body frame, as all feet see it: smoothed, shape (n, 16)."""
        heading = _in_heading(self.kinematics.odom_from_body_wxyz, in_body)
        per_foot = np.tile(heading, (1, facts.N_LEGS))
        return np.concatenate(
            [self.stack.smooth(per_foot, self.rows), np.zeros((len(self.rows), facts.N_LEGS))], axis=1
        )


def stance_view(
    stack: Stack, effects: Sequence[Effect], dynamics: DynamicsSignals | None = None
) -> ChannelView | ChannelOff:
    """Build the channel *stance kinematics*; ``dynamics`` gives the feet's forces to what depends on them."""
    if stack.recordings[0].joint_names != facts.JOINT_NAMES:
        return ChannelOff(Channel.STANCE_KINEMATICS, "no body model of this robot")
    for signal, name in (
        ("position_rad", "joint positions"),
        ("velocity_rad_s", "joint velocities"),
        *(() if dynamics is not None else [("foot_contact", "contact flags")]),
        ("odom_from_body_wxyz", "attitude"),
        ("linear_vel_of_body_in_odom_m_s", "body velocity"),
        ("angular_vel_of_body_in_odom_rad_s", "turn rate"),
    ):
        if not all(r.has(signal) for r in stack.recordings):
            return ChannelOff(Channel.STANCE_KINEMATICS, f"no {name}")
    attitude = stack.filled(lambda r: r.odom_from_body_wxyz)
    attitude = np.where(np.abs(attitude).sum(axis=1, keepdims=True) > 0.5, attitude, np.array([1.0, 0.0, 0.0, 0.0]))
    kinematics = Kinematics(
        odom_from_body_wxyz=attitude,
        linear_vel_in_body_m_s=rotate_inverse_wxyz(attitude, stack.filled(lambda r: r.linear_vel_of_body_in_odom_m_s)),
        angular_vel_in_body_rad_s=rotate_inverse_wxyz(
            attitude, stack.filled(lambda r: r.angular_vel_of_body_in_odom_rad_s)
        ),
        position_rad=stack.filled(lambda r: r.position_rad),
        velocity_rad_s=stack.filled(lambda r: r.velocity_rad_s),
    )
    contact = stack.cat(lambda r: r.foot_contact).astype(np.bool_) if dynamics is None else dynamics.contact
    standing = stack.inner(contact & stack.used[:, None], AFTER_TOUCH_DOWN, BEFORE_LIFT_OFF)
    if dynamics is None:
        rows = np.flatnonzero(stack.inner(stack.used))
        rows = rows[rows % STRIDE == 0]
    else:
        rows = dynamics.rows
    radius = BodyModel(effects).foot_radius_m
    raw = motion_of_feet(kinematics, radius)
    response = stack.smooth(_rows_of(*raw, standing), rows)
    steady = stack.inner(standing)[rows]
    # A height means something against another foot's, and the same feet must stand throughout the filter's reach.
    unchanged = np.all((stack.inner(contact) | stack.inner(~contact))[rows], axis=1)
    several = steady & (standing[rows].sum(axis=1, keepdims=True) >= 2) & unchanged[:, None]
    settled = steady & stack.inner(contact, SPRINGS_BACK, 0)[rows]
    velocities = np.stack([steady, steady, settled], axis=2).reshape(len(rows), -1)
    usable = np.concatenate([velocities, several], axis=1)
    legs = np.arange(facts.N_LEGS, dtype=np.intp)
    signals = StanceSignals(
        stack, rows, kinematics, radius, standing, response, raw, _acceleration_in_body(stack, kinematics), dynamics
    )
    floor = np.concatenate([np.tile(VELOCITY_FLOOR_M_S, facts.N_LEGS), np.full(4, HEIGHT_FLOOR_M)])
    return ChannelView(
        name=Channel.STANCE_KINEMATICS,
        rows=ROWS,
        unit="m/s, m",
        response=response,
        usable=usable,
        run=stack.run[rows],
        state=stack.state[rows],
        noise=np.maximum(floor, white_noise(response, usable, is_smoothed=True)),
        nuisance=np.zeros((*response.shape, 0)),
        row_joint=np.full(len(ROWS), -1, dtype=np.intp),
        row_leg=np.concatenate([np.repeat(legs, 3), legs]),
        leg_of_joint=np.repeat(legs, 3),
        signals=signals,
    )


def feet(k: Kinematics, foot_radius_m: Array, standing: Flags) -> Array:
    """Velocities of the contact points in the heading frame, then heights less the standing feet's mean; (N, 16)."""
    return _rows_of(*motion_of_feet(k, foot_radius_m), standing)


def motion_of_feet(k: Kinematics, foot_radius_m: Array, legs: slice = slice(None)) -> tuple[Array, Array]:
    """Velocities of the contact points in the heading frame (N, 4, 3), and their heights (N, 4); of ``legs`` alone."""
    point, jacobian = contact_point_and_jacobian(k.position_rad, k.odom_from_body_wxyz, foot_radius_m, legs)
    rates = k.velocity_rad_s.reshape(len(point), facts.N_LEGS, 1, 3)[:, legs]
    turn = k.angular_vel_in_body_rad_s[:, None, :]
    velocity = k.linear_vel_in_body_m_s[:, None, :] + cross(turn, point) + (jacobian * rates).sum(axis=-1)
    heading = _in_heading(k.odom_from_body_wxyz[:, None, :], velocity)
    return heading, np.asarray(rotate_wxyz(k.odom_from_body_wxyz[:, None, :], point)[..., 2])


def above_mean(height: Array, standing: Flags) -> Array:
    """Heights (N, 4) less their mean over the feet that stand."""
    count = np.maximum(standing.sum(axis=1, keepdims=True), 1)
    return np.asarray(height - np.sum(np.where(standing, height, 0.0), axis=1, keepdims=True) / count)


def _rows_of(heading: Array, height: Array, standing: Flags) -> Array:
    return np.concatenate([heading.reshape(len(heading), -1), above_mean(height, standing)], axis=1)


def _acceleration_in_body(stack: Stack, k: Kinematics) -> Array:
    """Derivative of the velocity's components in the body frame, shape (N, 3), m/s²."""
    gravity = imu_gravity_m_s2(stack)
    if gravity is None:
        return np.asarray(np.gradient(k.linear_vel_in_body_m_s, stack.period_s, axis=0))
    upright = np.broadcast_to([0.0, 0.0, gravity], (stack.n, 3))
    felt = stack.filled(lambda r: r.imu.acceleration_m_s2) - rotate_inverse_wxyz(k.odom_from_body_wxyz, upright)
    return np.asarray(felt - cross(k.angular_vel_in_body_rad_s, k.linear_vel_in_body_m_s))


def _in_heading(odom_from_body_wxyz: Array, in_body: Array) -> Array:
    """A vector of the body frame in the frame that turns with the heading only; same shape."""
    odom = rotate_wxyz(odom_from_body_wxyz, in_body)
    half = 0.5 * yaw_rad(odom_from_body_wxyz)
    zero = np.zeros_like(half)
    return np.asarray(rotate_inverse_wxyz(np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1), odom))
