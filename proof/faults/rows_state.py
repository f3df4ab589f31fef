"""Rows of what the robot measures: no numbers, no rotation, frozen, tilted, collapsed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from proof.faults.drive import Drive
from proof.faults.rig import Rig
from proof.faults.rows import Finding, Row, happens, judge, reacted, tried_with
from spot_log import Run
from spot_runtime.control.safety.body_height import body_height_m

TICK_MS = 25.0
"""A policy period, and the link's few milliseconds."""


@tried_with
def broken(rig: Rig, /, fault: str, outcome: str | tuple[str, ...], **parameters: float | str) -> Finding:
    """A broken signal: damping, and only finite numbers are ever sent."""
    drive = rig.drive(happens(lambda: rig.inject(fault, **parameters)))
    return reacted(drive, judge(drive, outcome), "damping")


def since(condition: Callable[[Run], np.ndarray], drive: Drive) -> int:
    """Stamp of the first state after it happened in which this holds."""
    if drive.log is None:
        return drive.happened_ns
    stamps = drive.log.states.robot_stamp_ns
    holds = condition(drive.log) & (stamps >= drive.happened_ns)
    return int(stamps[np.argmax(holds)]) if holds.any() else drive.happened_ns


def is_tilted(log: Run) -> np.ndarray:
    """Which states tilt by more than 45°."""
    x, y = log.states.odom_from_body_wxyz[:, 1], log.states.odom_from_body_wxyz[:, 2]
    tilted: np.ndarray = 1.0 - 2.0 * (x * x + y * y) < np.cos(0.785398)
    return tilted


def is_low(log: Run) -> np.ndarray:
    """Which states show a body below 0.25 m."""
    pairs = zip(log.states.position_rad, log.states.odom_from_body_wxyz, strict=True)
    return np.array([body_height_m(position, wxyz) < 0.25 for position, wxyz in pairs])


def tilt(rig: Rig) -> Finding:
    """Somebody pushes the robot over."""
    drive = rig.drive(happens(lambda: rig.inject("push", roll_rad_s=12.0, up_m_s=2.5)), seconds=6.0)
    return reacted(drive, judge(drive, "tilt"), "damping", since(is_tilted, drive))


def low(rig: Rig) -> Finding:
    """Something heavy lands on the robot."""
    drive = rig.drive(happens(lambda: rig.inject("push", up_m_s=-6.0)), seconds=6.0)
    return reacted(drive, judge(drive, "body_low"), "damping", since(is_low, drive))


@tried_with
def malformed(rig: Rig, kind: str) -> Finding:
    """States that are no states: the stream counts as lost."""
    drive = rig.drive(happens(lambda: rig.inject("malformed_states", kind=kind)))
    return reacted(drive, judge(drive, "state_lost"), drive_way(drive))


def drive_way(drive: Drive) -> str:
    """Damping or silence, whichever came first."""
    ways = [(at_ns, way) for way in ("damping", "released") if (at_ns := drive.event_ns(way)) is not None]
    return min(ways)[1] if ways else "damping"


def one_bad_message(rig: Rig) -> Finding:
    """A single state holds values that are not finite; the next are sound: the robot is damped and does not walk on."""
    drive = rig.drive(happens(lambda: rig.inject("nan_sensor", 0.0031, signal="attitude")))
    return reacted(drive, judge(drive, "state_not_finite"), "damping")


ROWS = (
    Row("position is NaN", TICK_MS, broken("nan_sensor", "state_not_finite", signal="position")),
    Row("velocity is NaN", TICK_MS, broken("nan_sensor", "state_not_finite", signal="velocity")),
    Row("load is NaN", TICK_MS, broken("nan_sensor", "state_not_finite", signal="load")),
    Row("attitude is NaN", TICK_MS, broken("nan_sensor", "state_not_finite", signal="attitude")),
    Row("body velocity is NaN", TICK_MS, broken("nan_sensor", "state_not_finite", signal="body_velocity")),
    Row("attitude is no rotation", TICK_MS, broken("bad_quaternion", "state_attitude", scale=0.5)),
    Row("attitude is all zeros", TICK_MS, broken("bad_quaternion", "state_attitude", scale=0.0)),
    Row("values frozen", 60.0, broken("frozen_sensors", "state_frozen")),
    Row("tilt > 45°", TICK_MS, tilt),
    Row("body low", TICK_MS, low),
    Row("states with 11 joints", 80.0, malformed("eleven_joints")),
    Row("states cut mid-message", 80.0, malformed("cut")),
    Row("states that are noise", 80.0, malformed("noise")),
    Row("states that are empty", 80.0, malformed("empty")),
    Row("NaN in one state", 25.0, one_bad_message),
)
