"""Signals that cannot be what the log says they are: a wrong unit, a wrong joint order, not a number, another robot."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

import numpy as np

from diagnosis.read.recording import Array
from diagnosis.read.robot_file import RobotDescription
from spot_log.read.run import Run
from spot_model.errors import BadInputError

BEYOND_STOP_RAD: Final = 0.3
"""Encoder offsets and stops that give way stay below this."""
BEYOND_SHARE: Final = 0.02
SLOPES: Final = (0.5, 2.0)
"""A velocity over the slope of its position."""
MIN_AGREEMENT: Final = 0.6
"""Correlation of a velocity with the slope of its own position, at least, before another joint's is looked for."""
MIN_SPEED_RAD_S: Final = 0.2
"""Root mean square under which a velocity says nothing of its unit."""
MAX_LOAD_NM: Final = 1000.0
"""No joint of a legged robot on a bench carries more; 100 N·m is a lot."""
TORQUE_MARGIN: Final = 3.0
MAX_BAD_SHARE: Final = 0.02
"""Rows that are not numbers, at most; fewer are left out."""
ADDRESS: Final = re.compile(r"|[\w.-]+:\d+|\d+(\.\d+){3}|[\w-]+(\.[\w-]+)+|unix:.*|ipv[46]:.*")
"""No name, or a host's, or an IP number, with or without a port; a socket, or what a fake robot hands to a program."""
MENDED: Final = "check unit, scale and source_joint_names in the mapping, and import the recording again"


def check_plausible(runs: Sequence[Run], robot: RobotDescription) -> None:
    """Refuse logs whose signals cannot be right.

    Raises:
        BadInputError: The message names log, joint, value, what is allowed and what to do.
    """
    for run in runs:
        _joints(run, robot)
        _numbers(run)
        _positions(run, robot)
        _velocities(run)
        _loads(run, robot)
    _one_robot(runs)


def _joints(run: Run, robot: RobotDescription) -> None:
    if run.header.joint_names != robot.joint_names:
        raise BadInputError(
            f"log {run.path} has joints {', '.join(run.header.joint_names)}; robot {robot.name} has "
            f"{', '.join(robot.joint_names)}; describe the robot of these logs with --robot FILE.yaml"
        )


def _one_robot(runs: Sequence[Run]) -> None:
    # An address is no name: the same robot has one for each network.
    names = {run.header.robot_id: run.path for run in runs if not ADDRESS.fullmatch(run.header.robot_id)}
    if len(names) > 1:
        told = "; ".join(f"{path}: {name}" for name, path in sorted(names.items())[:3])
        raise BadInputError(f"logs of {len(names)} robots: {told}; diagnose logs of one robot at a time")


def _numbers(run: Run) -> None:
    for name in ("position_rad", "velocity_rad_s", "load_nm"):
        values = getattr(run.states, name)
        bad = ~np.isfinite(values)
        if bad.all() or not bad.any():
            continue
        share = bad.mean(axis=0)
        joint = int(np.argmax(share))
        if share[joint] > MAX_BAD_SHARE:
            row = int(np.flatnonzero(bad[:, joint])[0])
            raise BadInputError(
                f"log {run.path}: {name} of {run.header.joint_names[joint]} is not a number in "
                f"{100 * share[joint]:.0f} % of the states, first in row {row}; allowed: {100 * MAX_BAD_SHARE:.0f} %; "
                "leave the signal out of the mapping, or mend the recording"
            )


def _positions(run: Run, robot: RobotDescription) -> None:
    if robot.limits_rad is None:
        return
    low, high = robot.limits_rad
    with np.errstate(invalid="ignore"):
        out = (run.states.position_rad < low - BEYOND_STOP_RAD) | (run.states.position_rad > high + BEYOND_STOP_RAD)
    share = out.mean(axis=0)
    joint = int(np.argmax(share))
    if share[joint] > BEYOND_SHARE:
        row = int(np.flatnonzero(out[:, joint])[0])
        raise BadInputError(
            f"log {run.path}: position of {run.header.joint_names[joint]} is {run.states.position_rad[row, joint]:.3g} "
            f"rad in row {row}, beyond its stops in {100 * share[joint]:.0f} % of the states; allowed: "
            f"{low[joint]:.2f} to {high[joint]:.2f} rad; {MENDED}"
        )


def _velocities(run: Run) -> None:
    states = run.states
    if len(states) < 50 or not np.isfinite(states.velocity_rad_s).any():
        return
    time_s = (states.robot_stamp_ns - states.robot_stamp_ns[0]) * 1e-9
    slope = np.gradient(np.nan_to_num(states.position_rad), np.maximum.accumulate(time_s), axis=0)
    velocity = np.nan_to_num(states.velocity_rad_s)
    moving = np.flatnonzero(
        (slope.std(axis=0) > MIN_SPEED_RAD_S) & (velocity.std(axis=0) > 1e-9) & np.isfinite(slope).all(axis=0)
    )
    for joint in moving:
        name = run.header.joint_names[joint]
        agreement = _correlations(velocity[:, joint], slope[:, moving])
        own = float(agreement[moving == joint][0])
        best = int(moving[np.argmax(agreement)])
        if own < MIN_AGREEMENT and best != joint and agreement.max() > max(0.9, own + 0.3):
            raise BadInputError(
                f"log {run.path}: velocity of {name} follows the position of {run.header.joint_names[best]} "
                f"(correlation {agreement.max():.2f}, with its own {own:.2f}); allowed: one joint order for all "
                f"signals; {MENDED}"
            )
        ratio = float(velocity[:, joint].std() / slope[:, joint].std())
        if own > 0.9 and not SLOPES[0] < ratio < SLOPES[1]:
            raise BadInputError(
                f"log {run.path}: velocity of {name} is {ratio:.3g} times the slope of its position; allowed: "
                f"{SLOPES[0]} to {SLOPES[1]}; {MENDED}"
            )
        if own < -0.9:
            raise BadInputError(
                f"log {run.path}: velocity of {name} has the opposite sign of the slope of its position "
                f"(correlation {own:.2f}); allowed: above 0; {MENDED}"
            )


def _correlations(one: Array, many: Array) -> Array:
    a = one - one.mean()
    b = many - many.mean(axis=0)
    return np.asarray(a @ b / np.maximum(np.linalg.norm(a) * np.linalg.norm(b, axis=0), 1e-12))


def _loads(run: Run, robot: RobotDescription) -> None:
    load = run.states.load_nm
    if not np.isfinite(load).any():
        return
    largest = np.nanpercentile(np.abs(load), 99.0, axis=0)
    allowed = (
        np.full(len(largest), MAX_LOAD_NM) if robot.torque_limit_nm is None else TORQUE_MARGIN * robot.torque_limit_nm
    )
    joint = int(np.argmax(largest / allowed))
    if largest[joint] > allowed[joint]:
        raise BadInputError(
            f"log {run.path}: load of {run.header.joint_names[joint]} reaches {largest[joint]:.3g} N·m; allowed: "
            f"{allowed[joint]:.3g} N·m; {MENDED}"
        )
