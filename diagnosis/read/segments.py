"""Cut a recording: where servos do not follow the commands, starts, lost messages, falls; with reasons."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_dilation, binary_opening, find_objects, label, uniform_filter1d

from spot_log.format.events import FOLLOWING_MODE
from spot_log.read.run import CommandTable
from spot_log.tools.measures import NEVER_NS
from spot_model.policy.observation import FALLEN_GRAVITY_Z
from spot_model.robot.control import pd_torque
from spot_model.robot.facts import Array
from spot_model.robot.rotation import projected_gravity
from trainer.signals.policy_ticks import fall_row
from trainer.signals.recording import Flags, Recording

START_S: Final = 0.2
"""After the first command servos and body settle."""
WINDOW_S: Final = 0.15
"""Over this time the load is compared with the servo law."""
MIN_FOLLOWED: Final = 0.2
"""Share of the servo law's torque that a load in control explains, at least; a halved torque explains 0.75."""
MIN_TORQUE_NM: Final = 2.0
"""With less torque asked for, nothing can be said."""
SHORTEST_S: Final = 0.06
"""A shorter loss of control is an outlier, and left to robust fits."""

SegmentKind = Literal["lost", "no_command", "start", "expired", "not_following", "fallen"]


@dataclass(frozen=True)
class Segment:
    """A stretch of one recording that is left out of all channels, rows ``first`` to ``last`` inclusive."""

    kind: SegmentKind
    first: int
    last: int
    reason: str


@dataclass(frozen=True)
class Segmentation:
    """What of a recording is used."""

    used: Flags
    """Shape (n,)."""
    segments: tuple[Segment, ...]
    """In the order of their first rows."""


def cut(recording: Recording) -> Segmentation:
    """Find what to leave out, and why."""
    n = len(recording)
    row = recording.command_row()
    # A log without any commands was not made by us; what it holds of sensors can be looked at all the same.
    known = row >= 0 if len(recording.commands) else np.ones(n, dtype=np.bool_)
    first = int(np.argmax(known)) if known.any() else n
    start = np.zeros(n, dtype=np.bool_)
    start[first : first + round(START_S / recording.period_s)] = len(recording.commands) > 0
    expired = np.zeros(n, dtype=np.bool_)
    if len(recording.commands):
        end = recording.commands.end_robot_stamp_ns[np.maximum(row, 0)]
        expired = (row >= 0) & (end > 0) & (end < NEVER_NS) & (recording.stamp_ns > end)
    ignored = _not_following(recording, row)
    cuts: tuple[tuple[SegmentKind, Flags, str], ...] = (
        ("lost", ~recording.present, "state messages are missing"),
        ("no_command", ~known, "no command has been received yet"),
        ("start", start & known, f"the first {START_S} s after the first command"),
        ("expired", expired, "the newest command is past its end time"),
        ("not_following", ignored & known & ~start, "the load is unrelated to the servo law: not in control"),
        ("fallen", _fallen(recording), "the robot has fallen"),
    )
    found = [
        Segment(kind, rows.start, rows.stop - 1, reason)
        for kind, flags, reason in cuts
        for (rows,) in find_objects(label(flags)[0])
    ]
    used = ~np.any([flags for _, flags, _ in cuts], axis=0)
    return Segmentation(used, tuple(sorted(found, key=lambda s: s.first)))


def _not_following(recording: Recording, row: NDArray[np.intp]) -> Flags:
    """Where the servo law explains next to nothing of the load over a window, all joints together."""
    if len(recording.commands) == 0 or not recording.has("load_nm"):
        return np.zeros(len(recording), dtype=np.bool_)
    asked = asked_torque_nm(recording.commands, np.maximum(row, 0), recording.position_rad, recording.velocity_rad_s)
    asked = np.nan_to_num(asked)
    load = np.nan_to_num(recording.load_nm)
    size = max(3, round(WINDOW_S / recording.period_s))

    def mean(values: Array) -> Array:
        return np.asarray(uniform_filter1d(values.mean(axis=1), size, mode="nearest"))

    asked_square = mean(asked**2)
    followed = mean(asked * load) / np.maximum(asked_square, 1e-9)
    similar = mean(asked * load) / np.sqrt(np.maximum(asked_square * mean(load**2), 1e-9))
    lost = ((followed < MIN_FOLLOWED) | (similar < MIN_FOLLOWED)) & (asked_square > MIN_TORQUE_NM**2)
    shortest = max(2, round(SHORTEST_S / recording.period_s))
    lost = binary_opening(binary_closing(lost, np.ones(size)), np.ones(shortest))
    # The window blurs the edges: half of it on either side may not be in control either.
    return np.asarray(binary_dilation(lost, np.ones(size)) if lost.any() else lost)


def asked_torque_nm(c: CommandTable, row: NDArray[np.intp], position_rad: Array, velocity_rad_s: Array) -> Array:
    """The servo law's torque for the commands at ``row``, shape (n,), and the joints' motion, shapes (n, J), N·m."""
    return np.asarray(
        pd_torque(
            position_rad=position_rad,
            velocity_rad_s=velocity_rad_s,
            setpoint_position_rad=c.position_rad[row],
            setpoint_velocity_rad_s=c.velocity_rad_s[row],
            feedforward_nm=c.load_nm[row],
            kp_nm_per_rad=c.kp_nm_per_rad[row],
            kd_nm_s_per_rad=c.kd_nm_s_per_rad[row],
        )
    )


def _fallen(recording: Recording) -> Flags:
    """From 0.3 s before the robot falls, under a policy or lying on its side, to the end."""
    flags = np.zeros(len(recording), dtype=np.bool_)
    if recording.has("odom_from_body_wxyz"):
        r, ticks = recording, recording.ticks
        ticks_ns = ticks.robot_stamp_ns[ticks.mode == FOLLOWING_MODE]
        row = fall_row(r.joint_names, r, r.stamp_ns, ticks_ns)
        leans = np.flatnonzero(projected_gravity(r.odom_from_body_wxyz)[:, 2] > FALLEN_GRAVITY_Z)
        row = min([row, *leans[:1]])
        flags[max(0, row - round(0.3 / r.period_s)) if row < len(r) else row :] = True
    return flags
