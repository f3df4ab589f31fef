"""Regimes of motion: for each joint, which samples belong to which."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.ndimage import maximum_filter1d

from diagnosis.channels.channel_view import Array, Flags, Ints
from diagnosis.channels.stack import Stack
from diagnosis.closed_loop.run_numbers import given_power_w
from diagnosis.read.recording import ACTIVE

REVERSAL_S: Final = 0.02
"""Around a velocity reversal this long either way."""


def regimes(real: Stack, stack: Stack, leg_of_joint: Ints) -> dict[str, Flags]:
    """Samples by regime, among them all, shape (n, J); thirds are those of the real logs, so that all are cut alike."""
    active, _ = under_policy(real)
    used = real.used & active if (real.used & active).any() else np.ones(real.n, dtype=np.bool_)
    bounds = {name: np.quantile(values[used], (1 / 3, 2 / 3), axis=0) for name, values in _sizes(real).items()}
    thirds = {}
    for name, values in _sizes(stack).items():
        low, high = bounds[name]
        thirds[name] = {"low": values <= low, "middle": (values > low) & (values <= high), "high": values > high}
    load, velocity = stack.filled(lambda r: r.load_nm), stack.filled(lambda r: r.velocity_rad_s)
    n_joints, driving = load.shape[1], load * velocity > 0.0
    found: dict[str, Flags] = {"all": np.ones(load.shape, dtype=np.bool_)}
    for word, flags in (("motoring", driving), ("braking", ~driving)):
        found[word] = flags
        found[f"{word}, high speed"] = flags & thirds["speed"]["high"]
        found[f"{word}, high torque"] = flags & thirds["torque"]["high"]
    for name in ("torque", "speed"):
        found |= {f"{word} {name}": flags for word, flags in thirds[name].items()}
    sign = np.sign(stack.smooth(velocity))
    turned = np.diff(sign, axis=0, prepend=sign[:1]) != 0.0
    reach = max(1, round(REVERSAL_S / stack.period_s))
    found["velocity reversal"] = maximum_filter1d(turned.astype(np.int8), 2 * reach + 1, axis=0) > 0
    contact = stack.cat(lambda r: r.foot_contact)
    if contact.shape[1] and leg_of_joint.max(initial=-1) >= 0:
        stance = contact[:, np.maximum(leg_of_joint, 0)] & (leg_of_joint >= 0)[None]
        found["stance"], found["swing"] = stance, ~stance
    for title, name, word in (
        ("low total power", "power", "low"),
        ("high total power", "power", "high"),
        ("first third of time", "time", "low"),
        ("last third of time", "time", "high"),
    ):
        found[title] = np.repeat(thirds[name][word], n_joints, axis=1)
    return found


def _sizes(stack: Stack) -> dict[str, Array]:
    """What has a low, a middle and a high third: of each joint, shape (n, J), or of the robot, shape (n, 1)."""
    load, velocity = stack.filled(lambda r: r.load_nm), stack.filled(lambda r: r.velocity_rad_s)
    return {
        "torque": np.abs(load),
        "speed": np.abs(velocity),
        "power": given_power_w(load, velocity)[:, None],
        "time": under_policy(stack)[1][:, None],
    }


def under_policy(stack: Stack) -> tuple[Flags, Array]:
    """Rows between the first and the last tick in which the policy followed commands, and the time since that first.

    In a log whose ticks have no such mode, all rows from the first tick on. Shapes (n,), s.
    """
    flags, time_s = np.zeros(stack.n, dtype=np.bool_), np.zeros(stack.n)
    for number, recording in enumerate(stack.recordings):
        mine = np.flatnonzero(stack.run == number)
        ticks = recording.ticks
        rows = np.flatnonzero(ticks.mode == ACTIVE) if len(ticks) else np.zeros(0, dtype=np.intp)
        stamps = ticks.robot_stamp_ns[rows] if len(rows) else ticks.robot_stamp_ns
        first = int(stamps[0]) if len(stamps) else recording.start_ns
        last = int(stamps[-1]) if len(rows) else int(recording.stamp_ns[-1])
        flags[mine] = (recording.stamp_ns >= first) & (recording.stamp_ns <= last)
        time_s[mine] = (recording.stamp_ns - first) * 1e-9
    return flags, time_s
