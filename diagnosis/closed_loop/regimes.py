"""Regimes of motion: for each joint, which samples belong to which."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.ndimage import maximum_filter1d

from diagnosis.channels.channel_view import Array, Flags, Ints
from diagnosis.channels.stack import Stack
from diagnosis.read.recording import ACTIVE

REVERSAL_S: Final = 0.02
"""Around a velocity reversal this long either way."""


class Regimes:
    """Regimes with bounds from real logs, so that simulated ones are cut alike."""

    def __init__(self, real: Stack) -> None:
        """Take terciles of torque, speed, power and time from the real logs."""
        load, speed = np.abs(real.filled(lambda r: r.load_nm)), np.abs(real.filled(lambda r: r.velocity_rad_s))
        active, _ = under_policy(real)
        used = real.used & active if (real.used & active).any() else np.ones(real.n, dtype=np.bool_)
        self.load = np.quantile(load[used], (1 / 3, 2 / 3), axis=0)
        self.speed = np.quantile(speed[used], (1 / 3, 2 / 3), axis=0)
        self.power = np.quantile(_power_w(real)[used], (1 / 3, 2 / 3))
        self.time = np.quantile(_time_s(real)[used], (1 / 3, 2 / 3))

    def of(self, stack: Stack, leg_of_joint: Ints) -> dict[str, Flags]:
        """Flags of shape (n, J) by regime, among them all."""
        load, velocity = stack.filled(lambda r: r.load_nm), stack.filled(lambda r: r.velocity_rad_s)
        size, speed = np.abs(load), np.abs(velocity)
        driving = load * velocity > 0.0
        n, n_joints = load.shape
        found: dict[str, Flags] = {"all": np.ones((n, n_joints), dtype=np.bool_)}
        fast, heavy = speed > self.speed[1], size > self.load[1]
        for name, flags in (("motoring", driving), ("braking", ~driving)):
            found[name] = flags
            found[f"{name}, high speed"] = flags & fast
            found[f"{name}, high torque"] = flags & heavy
        found["low torque"], found["middle torque"], found["high torque"] = _thirds(size, self.load)
        found["low speed"], found["middle speed"], found["high speed"] = _thirds(speed, self.speed)
        sign = np.sign(stack.smooth(velocity))
        turned = np.diff(sign, axis=0, prepend=sign[:1]) != 0.0
        reach = max(1, round(REVERSAL_S / stack.period_s))
        found["velocity reversal"] = maximum_filter1d(turned.astype(np.int8), 2 * reach + 1, axis=0) > 0
        contact = stack.cat(lambda r: r.foot_contact)
        if contact.shape[1] and leg_of_joint.max(initial=-1) >= 0:
            stance = contact[:, np.maximum(leg_of_joint, 0)] & (leg_of_joint >= 0)[None]
            found["stance"], found["swing"] = stance, ~stance
        for title, values, bounds in (
            ("total power", _power_w(stack), self.power),
            ("time", _time_s(stack), self.time),
        ):
            low, _, high = _thirds(values[:, None], bounds)
            words = ("low", "high") if title == "total power" else ("first third of", "last third of")
            for word, flags in zip(words, (low, high), strict=True):
                found[f"{word} {title}"] = np.repeat(flags, n_joints, axis=1)
        return found


def _thirds(values: Array, bounds: Array) -> tuple[Flags, Flags, Flags]:
    return values <= bounds[0], (values > bounds[0]) & (values <= bounds[1]), values > bounds[1]


def _power_w(stack: Stack) -> Array:
    load, velocity = stack.filled(lambda r: r.load_nm), stack.filled(lambda r: r.velocity_rad_s)
    return np.asarray(np.maximum(load * velocity, 0.0).sum(axis=1))


def _time_s(stack: Stack) -> Array:
    return under_policy(stack)[1]


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
