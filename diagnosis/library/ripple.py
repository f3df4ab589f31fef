"""Torque that repeats with the joint's angle, and the lines that it leaves in a spectrum over the angle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from diagnosis.channels import Array, Channel, ChannelView, Flags, Shape, Views
from diagnosis.channels.actuator import ActuatorSignals
from diagnosis.library import Coefficient, LibraryEffect, on_joints
from diagnosis.library.experiments import SLOW_WALK
from spot_model.effects.drivetrain import TorqueRipple

BIN_RAD: Final = 0.002
LOWEST_PER_RAD: Final = 36.0
HIGHEST_PER_RAD: Final = 700.0
"""The window takes off too much of lines that are slower than the lowest; the bins cannot follow lines that are faster
than this.
"""
STEP_PER_RAD: Final = 0.5
WINDOW_BINS: Final = 81
"""What varies more slowly than over this many bins is taken off first."""
SLOW_PER_RAD: Final = np.arange(9.0, 36.0)
"""So near to each other since hips and knees, 2.7 rad apart, share a phase: half a step aside a third of it is lost."""
MIN_SAMPLES: Final = 50


def slow_orders(position_rad: Array, residual: Array, beside: Array, usable: Flags, sets: Flags) -> tuple[float, ...]:
    """The six slow orders with the most power, at the set of joints that has most with one phase for all.

    A leg's swing holds a wave or two of such a line, so one joint does not tell it from a trend; several do together.
    Arrays have shape (m, J); what trends go with, and is taken off first, is ``beside``, (m, J, k), and joints that may
    share a phase are ``sets``, (S, J).
    """
    step = slice(None, None, max(1, len(position_rad) // 2000))
    joints = position_rad.shape[1]
    waves, energy = np.zeros((len(SLOW_PER_RAD), joints), dtype=np.complex128), np.full(joints, 1e-12)
    for joint, good in enumerate(usable[step].T):
        if good.sum() >= MIN_SAMPLES:
            values, x = residual[step, joint][good], beside[step, joint][good]
            values = values - x @ np.linalg.lstsq(x, values, rcond=None)[0]
            waves[:, joint] = np.exp(-1j * np.outer(SLOW_PER_RAD, position_rad[step, joint][good])) @ values
            energy[joint] = max(float(values @ values), energy[joint])
    power = np.abs(waves @ sets.T.astype(np.float64)) ** 2 / (sets @ energy)
    return _strongest(SLOW_PER_RAD, power.max(axis=1), 1.5, 6)


def strongest_orders(position_rad: Array, residual: Array, usable: Flags) -> tuple[float, ...]:
    """The four orders (cycles of phase per rad of joint) with the most power, joints taken together; shapes (m, J)."""
    orders = np.arange(LOWEST_PER_RAD, HIGHEST_PER_RAD, STEP_PER_RAD)
    power = np.zeros(len(orders))
    for joint, good in enumerate(usable.T):
        if good.sum() < MIN_SAMPLES:
            continue
        # Outliers would be a comb of their own.
        values = residual[good, joint]
        values = values - np.median(values)
        bound = 4.0 * 1.4826 * float(np.median(np.abs(values))) + 1e-9
        values = np.clip(values, -bound, bound)
        angle = position_rad[good, joint]
        first = float(angle.min())
        number = np.round((angle - first) / BIN_RAD).astype(np.intp)
        sums, counts = np.bincount(number, values), np.bincount(number)
        window = np.ones(min(WINDOW_BINS, 2 * ((len(sums) - 1) // 2) + 1))
        smooth = np.convolve(sums, window, mode="same") / np.maximum(np.convolve(counts, window, mode="same"), 1.0)
        sums = sums - smooth * counts
        centres = first + BIN_RAD * np.arange(len(sums))
        waves = np.exp(-1j * np.outer(orders, centres))
        power += np.abs(waves @ sums) ** 2 / (float(np.sum(values**2)) + 1e-12)
    return _strongest(orders, power, 3.0, 4)


def _strongest(orders: Array, power: Array, apart: float, n: int) -> tuple[float, ...]:
    """The ``n`` strongest orders that are so far apart."""
    chosen: list[float] = []
    for index in np.argsort(power)[::-1]:
        order = float(orders[index])
        if all(abs(order - other) > apart for other in chosen):
            chosen.append(order)
        if len(chosen) == n:
            break
    return tuple(chosen)


class RippleEntry(LibraryEffect):
    """a·sin(n·q + φ) and its second harmonic: lines in the order spectrum."""

    effect = TorqueRipple
    coefficients = (
        Coefficient("sine_nm", "N·m", -10.0, 10.0),
        Coefficient("cosine_nm", "N·m", -10.0, 10.0),
        Coefficient("second_sine_nm", "N·m", -5.0, 5.0),
        Coefficient("second_cosine_nm", "N·m", -5.0, 5.0),
    )
    confused_with = ("coulomb_friction", "torque_offset")
    split_by = SLOW_WALK

    def shapes(self, views: Views, joints: Flags) -> tuple[Shape, ...]:
        """The strongest slow lines, of which a leg's swing holds a wave or two, and those of the order spectrum."""
        view = views[Channel.SET_POINT_TO_LOAD]
        s: ActuatorSignals = view.signals
        at, usable, legs = s.position_rad[s.kept], view.usable & joints, view.leg_of_joint
        trends = (s.finish(s.torque_nm), s.finish(s.velocity_rad_s), s.finish_rate(s.velocity_rad_s))
        within = np.array([np.sum(legs[:j] == leg) for j, leg in enumerate(legs)])
        sets = np.array([*np.eye(len(legs)), *(within == k for k in np.unique(within)), np.ones(len(legs))]) > 0.0
        slow = slow_orders(at, view.response, np.stack(trends, axis=2), usable, sets)
        return tuple({"cycles_per_rad": n} for n in (*slow, *strongest_orders(at, view.response, usable)))

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The waves themselves, second harmonics by the double angle."""

        def waves(*motion: Array) -> Array:
            angle = shape["cycles_per_rad"] * motion[1]
            sine, cosine = np.sin(angle), np.cos(angle)
            return np.stack([sine, cosine, 2.0 * sine * cosine, 1.0 - 2.0 * sine**2], axis=2)

        return on_joints(view.signals.finished(waves), joints)

    def neighbours(self, shape: Shape) -> tuple[Shape, ...]:
        """Orders nearby, and the second harmonic where it is the one that was found."""
        n = shape["cycles_per_rad"]
        near = [n + d for d in (-0.5, -0.25, -0.12, 0.12, 0.25, 0.5) if n + d >= 1.0]
        return tuple({"cycles_per_rad": order} for order in (*near, 2.0 * n))

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Amplitudes, order and phases."""
        sine, cosine, second_sine, second_cosine = (float(c) for c in coefficients)
        return {
            "amplitude_nm": float(np.hypot(sine, cosine)),
            "cycles_per_rad": float(shape["cycles_per_rad"]),
            "phase_rad": float(np.arctan2(cosine, sine)),
            "second_nm": float(np.hypot(second_sine, second_cosine)),
            "second_phase_rad": float(np.arctan2(second_cosine, second_sine)),
        }
