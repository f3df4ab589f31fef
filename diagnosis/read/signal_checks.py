"""Signals that cannot be what the log says they are: a wrong unit, a wrong joint order, not a number, another robot."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from scipy.ndimage import find_objects, label, maximum_filter1d

from diagnosis.read.robot_file import RobotFile
from spot_log.format.events import EventName
from spot_log.read.run import Run
from spot_model.errors import BadInputError
from spot_model.robot.facts import Array
from trainer.signals.policy_ticks import fall_row, fall_stamp_ns
from trainer.signals.recording import MIN_STATES, Flags

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
OVERLOAD_SHARE: Final = 0.01
"""Share of a log's states that may be overloaded: shocks last milliseconds."""
MAX_STRETCHES: Final = 3
"""A wrong unit or a broken cell shows again and again; what a log has at so many places is an event."""
MAX_STRETCH_SHARE: Final = 0.5
"""Of a log's states; of more the rest is no log any more."""
AROUND_S: Final = 0.3
"""Either side of what cannot be right is set aside with it."""
BEFORE_FALL_S: Final = 0.3
"""From so long before a fall on no state is used: a body that nothing holds sinks by half its height in that time."""
ADDRESS: Final = re.compile(r"|[\w.-]+:\d+|\d+(\.\d+){3}|[\w-]+(\.[\w-]+)+|unix:.*|ipv[46]:.*")
"""No name, or a host's, or an IP number, with or without a port; a socket, or what a fake robot hands to a program."""
MENDED: Final = "check unit, scale and source_joint_names in the mapping, and import the recording again"


class _Fault(NamedTuple):
    """What cannot be right, what would be, and the values that it is about, shape (n, ...); none for the whole log."""

    check: str
    text: str
    allowed: str
    bad: Flags = np.zeros((0, 0), dtype=np.bool_)


def plausible(runs: Sequence[Run], robot: RobotFile) -> tuple[tuple[Run, ...], tuple[str, ...]]:
    """Set aside what cannot be right in single logs, or in stretches of them.

    Returns:
        What is left, and what was set aside and why, a sentence each.

    Raises:
        BadInputError: More than half of the logs have the same fault, so that it is systematic, or no log is left. The
            message names log, joint, value, what is allowed and what to do.
    """
    kept, notes, faults = [], [], []
    for run in runs:
        whole, told = run, list[str]()
        if run.header.joint_names == robot.joint_names:
            whole, told = _without_stretches(run, robot)
            found = _bad_states(whole, robot) or _bad_velocities(whole)
        else:
            has = f"it has joints {', '.join(run.header.joint_names)}; robot {robot.name} has "
            allowed = f"{', '.join(robot.joint_names)}; describe the robot of these logs with --robot FILE.yaml"
            found = [_Fault("joints", has + allowed, "")]
        if found:
            text = "; allowed: ".join(filter(None, found[0][1:3]))
            faults.append((found[0].check, f"log {run.path}: {text}"))
            notes.append(f"{run.path.name}: set aside: {text}")
        else:
            kept.append(whole)
            notes += told
    checks = [check for check, _ in faults]
    systematic = [text for check, text in faults if 2 * checks.count(check) > len(runs)]
    for text in systematic or [text for _, text in faults if not kept]:
        raise BadInputError(text)
    names = {name: run.path for run in kept if (name := robot_of([run]))}
    if len(names) > 1:
        listed = "; ".join(f"{path}: {name}" for name, path in sorted(names.items())[:3])
        raise BadInputError(f"logs of {len(names)} robots: {listed}; diagnose logs of one robot at a time")
    return tuple(kept), tuple(notes)


def robot_of(runs: Sequence[Run]) -> str:
    """Serial number of the robot that logs are of, or the name that they give it; empty where they do not tell."""
    for run in runs:
        met = next((e.text for e in run.events if e.name == EventName.CONNECTED.label), "")
        serial = met.partition(";")[0].partition(" ")[0]
        # An address is no name: the same robot has one for each network.
        name = serial or ("" if ADDRESS.fullmatch(run.header.robot_id) else run.header.robot_id)
        if name:
            return name
    return ""


def _without_stretches(run: Run, robot: RobotFile) -> tuple[Run, list[str]]:
    """The log without the few stretches in which a signal cannot be right; the same where it is wrong all along."""
    notes, period_s = [], run.duration_s / max(1, len(run.states) - 1)
    reach = max(1, round(AROUND_S / max(period_s, 1e-6)))
    cut = np.zeros(len(run.states), dtype=np.bool_)
    time_s = (run.states.robot_stamp_ns - run.states.robot_stamp_ns[:1]) * 1e-9
    for fault in _bad_states(run, robot):
        near = maximum_filter1d(fault.bad.any(axis=1).astype(np.int8), 2 * reach + 1) > 0
        stretches = [time_s[rows] for (rows,) in find_objects(label(near)[0])]
        if len(stretches) > MAX_STRETCHES or near.mean() > MAX_STRETCH_SHARE:
            continue
        cut |= near
        when = ", ".join(f"{at[0]:.1f} to {at[-1]:.1f} s" for at in stretches)
        notes.append(f"{run.path.name}: {when} set aside: {fault.text}")
    keep = ~cut | ~_upright(run, cut[:, None])
    if not notes or keep.sum() < MIN_STATES:
        return run, []
    stamps_ns, fall_ns = run.ticks.robot_stamp_ns, fall_stamp_ns(run)
    after = np.clip(np.searchsorted(run.states.robot_stamp_ns, stamps_ns), 0, len(cut) - 1)
    kept_ticks = ~cut[after]
    if fall_ns is not None:
        # Without the last tick before it nobody would know that the robot fell under the policy.
        kept_ticks[max(0, int(np.searchsorted(stamps_ns, fall_ns)) - 1)] = True
    return replace(run, states=run.states.rows(keep), ticks=run.ticks.rows(kept_ticks)), notes


def _upright(run: Run, bad: Flags) -> Flags:
    """States before the robot falls: what one that lies there has of joints and loads is not used anyway.

    Args:
        run: The log.
        bad: Values that cannot be right, shape (n, J). A body that is low by joints that were wrong before is no fall.
    """
    stamps_ns, ticks_ns = run.states.robot_stamp_ns, run.ticks.robot_stamp_ns
    fallen = fall_row(run.header.joint_names, run.states, stamps_ns, ticks_ns)
    fall_ns = np.append(stamps_ns, np.iinfo(np.int64).max)[fallen]
    row = int(np.searchsorted(stamps_ns, fall_ns - round(1e9 * BEFORE_FALL_S)))
    if row == 0 or bad[:row].any(axis=1).mean() > BEYOND_SHARE:
        row = fall_row((), run.states, stamps_ns, ticks_ns)
    return np.arange(len(stamps_ns)) < row


def _bad_states(run: Run, robot: RobotFile) -> list[_Fault]:
    """Signals that are no numbers, beyond the stops, or too large, each in more states than may be, with the states."""
    states, names, found = run.states, run.header.joint_names, []
    missing = {name: ~np.isfinite(getattr(states, name)) for name in ("position_rad", "velocity_rad_s", "load_nm")}
    missing = {name: bad for name, bad in missing.items() if not bad.all()}
    for signal, bad in missing.items():
        if (worst := _worst(bad, MAX_BAD_SHARE)) is not None:
            joint, share, row = worst
            text = f"{signal} of {names[joint]} is not a number in {share} of the states, first in row {row}"
            allowed = f"{100 * MAX_BAD_SHARE:.0f} %; leave the signal out of the mapping, or mend the recording"
            found.append(_Fault("number", text, allowed, np.concatenate(list(missing.values()), axis=1)))
            break
    if robot.limits_rad is not None:
        (low, high), position = robot.limits_rad, states.position_rad
        bad = (position < low - BEYOND_STOP_RAD) | (position > high + BEYOND_STOP_RAD)
        bad &= _upright(run, bad)[:, None]
        if (worst := _worst(bad, BEYOND_SHARE)) is not None:
            joint, share, row = worst
            text = f"position of {names[joint]} is {position[row, joint]:.3g} rad in row {row}, beyond its stops in "
            allowed = f"{low[joint]:.2f} to {high[joint]:.2f} rad; {MENDED}"
            found.append(_Fault("stops", f"{text}{share} of the states", allowed, bad))
    allowed_nm = np.full(len(names), MAX_LOAD_NM)
    if (limit_nm := robot.each(robot.torque_limit_nm)) is not None:
        allowed_nm = TORQUE_MARGIN * limit_nm
    bad = np.abs(states.load_nm) > allowed_nm
    bad &= _upright(run, bad)[:, None]
    if (worst := _worst(bad, OVERLOAD_SHARE)) is not None:
        joint = worst[0]
        largest_nm = float(np.abs(states.load_nm[bad[:, joint], joint]).max())
        text, allowed = f"load of {names[joint]} reaches {largest_nm:.3g} N·m", f"{allowed_nm[joint]:.3g} N·m; {MENDED}"
        found.append(_Fault("load", text, allowed, bad))
    return found


def _worst(bad: Flags, allowed_share: float) -> tuple[int, str, int] | None:
    """The joint with most bad states, their share in words and the first; None where no joint has more than allowed."""
    share = bad.mean(axis=0) if len(bad) else np.zeros(1)
    joint = int(np.argmax(share))
    if share[joint] <= allowed_share:
        return None
    return joint, f"{100 * share[joint]:.0f} %", int(np.flatnonzero(bad[:, joint])[0])


def _bad_velocities(run: Run) -> list[_Fault]:
    """Velocities that are no slopes of their positions."""
    states, names = run.states.rows(_upright(run, np.isnan(run.states.position_rad))), run.header.joint_names
    if len(states) < MIN_STATES or not np.isfinite(states.velocity_rad_s).any():
        return []
    time_s = (states.robot_stamp_ns - states.robot_stamp_ns[0]) * 1e-9
    slope = np.gradient(np.nan_to_num(states.position_rad), np.maximum.accumulate(time_s), axis=0)
    velocity = np.nan_to_num(states.velocity_rad_s)
    moving = np.flatnonzero(
        (slope.std(axis=0) > MIN_SPEED_RAD_S) & (velocity.std(axis=0) > 1e-9) & np.isfinite(slope).all(axis=0)
    )
    for joint in moving:
        name = f"velocity of {names[joint]}"
        agreement = _correlations(velocity[:, joint], slope[:, moving])
        own = float(agreement[moving == joint][0])
        best = int(moving[np.argmax(agreement)])
        ratio = float(velocity[:, joint].std() / slope[:, joint].std())
        text = allowed = ""
        if own < MIN_AGREEMENT and best != joint and agreement.max() > max(0.9, own + 0.3):
            text = f"{name} follows the position of {names[best]} (correlation {agreement.max():.2f}, with its own "
            text, allowed = f"{text}{own:.2f})", "one joint order for all signals"
        elif own > 0.9 and not SLOPES[0] < ratio < SLOPES[1]:
            text, allowed = f"{name} is {ratio:.3g} times the slope of its position", f"{SLOPES[0]} to {SLOPES[1]}"
        elif own < -0.9:
            text = f"{name} has the opposite sign of the slope of its position (correlation {own:.2f})"
            allowed = "above 0"
        if text:
            return [_Fault("velocity", text, f"{allowed}; {MENDED}")]
    return []


def _correlations(one: Array, many: Array) -> Array:
    a = one - one.mean()
    b = many - many.mean(axis=0)
    return np.asarray(a @ b / np.maximum(np.linalg.norm(a) * np.linalg.norm(b, axis=0), 1e-12))
