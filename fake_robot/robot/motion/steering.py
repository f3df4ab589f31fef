"""Which velocity a walk asks of the policy now: pure functions of the plan, the time and the body's pose."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from fake_robot.network.requests import PathPlan, PathPoint, Velocity, VelocityPlan, WalkLimits, WalkPlan

_POSITION_GAIN_PER_S = 1.2
_YAW_GAIN_PER_S = 1.5
_LEAST_SPEED_M_S, _LEAST_TURN_RAD_S = 0.15, 0.2
"""Slower than this a policy may stay where it is."""
ARRIVAL_M, ARRIVAL_RAD = 0.06, 0.07
NEAR_M, NEAR_RAD = 0.25, 0.3
_AT_REST: Velocity = (0.0, 0.0, 0.0)


class GroundPose(NamedTuple):
    """The body's place and heading in odom."""

    x_m: float
    y_m: float
    yaw_rad: float


@dataclass(frozen=True)
class Steering:
    """What to do now."""

    velocity: Velocity
    """In the body's axes, within the walk's limits."""
    is_near: bool = False
    is_there: bool = False
    """The goal is reached; for a velocity of zero, there is none."""


def steer(plan: WalkPlan, since_s: float, pose: GroundPose) -> Steering:
    """The velocity that follows the plan."""
    if isinstance(plan, VelocityPlan):
        wanted = plan.velocity if plan.is_in_body else _turned(plan.velocity, -pose.yaw_rad)
        return Steering(_clipped(wanted, plan.limits), is_there=wanted == _AT_REST)
    return _steer_along(plan, since_s, pose)


def hold(plan: PathPlan, pose: GroundPose) -> Velocity:
    """The velocity that keeps the body at the end of a path, in the body's axes."""
    goal = plan.points[-1]
    forward, left, _ = _turned((goal.x_m - pose.x_m, goal.y_m - pose.y_m, 0.0), -pose.yaw_rad)
    turn = turn_towards(goal.yaw_rad, pose)
    return _clipped((_POSITION_GAIN_PER_S * forward, _POSITION_GAIN_PER_S * left, turn), plan.limits)


def turn_towards(yaw_rad: float, pose: GroundPose) -> float:
    """The turn rate, in rad/s, that brings the body to a heading."""
    return _YAW_GAIN_PER_S * _wrapped(yaw_rad - pose.yaw_rad)


def slewed(velocity: Velocity, wanted: Velocity, slew: Velocity, dt_s: float) -> Velocity:
    """``velocity``, moved towards ``wanted`` by no more than ``slew`` allows in ``dt_s``."""
    forward, left, turn = (
        now + min(max(goal - now, -rate * dt_s), rate * dt_s)
        for now, goal, rate in zip(velocity, wanted, slew, strict=True)
    )
    return forward, left, turn


def _steer_along(plan: PathPlan, since_s: float, pose: GroundPose) -> Steering:
    goal = plan.points[-1]
    distance_m = math.hypot(goal.x_m - pose.x_m, goal.y_m - pose.y_m)
    turn_rad = abs(_wrapped(goal.yaw_rad - pose.yaw_rad))
    is_last = since_s >= goal.after_s
    if is_last and distance_m < ARRIVAL_M and turn_rad < ARRIVAL_RAD:
        return Steering(_AT_REST, is_near=True, is_there=True)
    target = goal if is_last else _point_at(plan.points, since_s)
    to_target = _turned((target.x_m - pose.x_m, target.y_m - pose.y_m, 0.0), -pose.yaw_rad)
    gap_m = math.hypot(*to_target[:2])
    speed_m_s = max(_POSITION_GAIN_PER_S * gap_m, _LEAST_SPEED_M_S) if gap_m > ARRIVAL_M else 0.0
    scale = speed_m_s / gap_m if gap_m > 0.0 else 0.0
    error_rad = _wrapped(target.yaw_rad - pose.yaw_rad)
    turn = 0.0
    if abs(error_rad) > ARRIVAL_RAD:
        turn = math.copysign(max(abs(_YAW_GAIN_PER_S * error_rad), _LEAST_TURN_RAD_S), error_rad)
    velocity = _clipped_in_direction((scale * to_target[0], scale * to_target[1], turn), plan.limits)
    return Steering(velocity, is_near=is_last and distance_m < NEAR_M and turn_rad < NEAR_RAD)


def _point_at(points: tuple[PathPoint, ...], since_s: float) -> PathPoint:
    """The point of the path at a time before its end; before the first point's time, that one."""
    for before, after in pairwise(points):
        if before.after_s <= since_s < after.after_s:
            share = (since_s - before.after_s) / (after.after_s - before.after_s)
            return PathPoint(
                before.x_m + share * (after.x_m - before.x_m),
                before.y_m + share * (after.y_m - before.y_m),
                before.yaw_rad + share * _wrapped(after.yaw_rad - before.yaw_rad),
            )
    return points[0]


def _clipped(velocity: Velocity, limits: WalkLimits) -> Velocity:
    forward, left, turn = (
        min(max(value, low), high) for value, low, high in zip(velocity, limits.low, limits.high, strict=True)
    )
    return forward, left, turn


def _clipped_in_direction(velocity: Velocity, limits: WalkLimits) -> Velocity:
    """Within the limits, the direction of the way kept."""
    shares = [
        (high if value > 0.0 else low) / value
        for value, low, high in zip(velocity[:2], limits.low[:2], limits.high[:2], strict=True)
        if value != 0.0
    ]
    share = min([1.0, *shares])
    return _clipped((share * velocity[0], share * velocity[1], velocity[2]), limits)


def _turned(velocity: Velocity, by_rad: float) -> Velocity:
    cos, sin = math.cos(by_rad), math.sin(by_rad)
    return cos * velocity[0] - sin * velocity[1], sin * velocity[0] + cos * velocity[1], velocity[2]


def _wrapped(angle_rad: float) -> float:
    return math.remainder(angle_rad, math.tau)
