"""Channels *load to motion* and *base wrench*: measured loads against what the motion needs.

The first looks at the joints of swinging legs. The second is the body's rows of the equations of motion, with the
feet's forces taken from the loads of all four legs, whatever their contact flags say; force and moment are in the
body's frame, about its origin.

Time convention: a sampled torque loop, or a simulator, computes a load from positions at the start of its step, and
the step's mean acceleration lies in the middle. Left alone, such an offset looks like a displaced weight or a wrong
encoder; fitted freely, it takes part of real effects with it. So the choice is between conventions only: all of one
instant, or a load that is older by the lag that channel *set-point to load* measured.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from diagnosis.channels.body.dynamics import DynamicsSignals, Residuals, feet_wrench
from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import ChannelView, Flags
from diagnosis.channels.drive.actuator import rattling
from diagnosis.channels.stack import white_noise
from spot_model.robot import facts

AFTER_LIFT_OFF: Final = 6
BEFORE_TOUCH_DOWN: Final = 7
"""States by which a swing is shortened at its ends: impacts are smoothed over."""
LIGHT_N: Final = 25.0
"""A foot that by the legs' loads carries more than this stands, whatever its flag says: flags come late."""
JOINT_FLOOR_NM: Final = 0.15
"""What differentiated velocities and a rigid model leave at least."""
JOINT_SHARE: Final = 0.03
"""Of a joint's load in the air; links bend, and accelerations come a millisecond late."""
BASE_ROWS: Final = ("force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z")
BASE_FLOOR: Final = np.array([1.5, 1.5, 2.5, 0.8, 1.5, 0.8])
"""What a rigid model and smoothed impacts leave at least, N and N·m."""
EDGE: Final = 4
"""States around a change of any contact flag that channel *base wrench* leaves out."""
JOINT_SCALE_NM: Final = 0.4
BASE_SCALE: Final = np.array([3.0, 3.0, 5.0, 1.5, 3.0, 1.5])
"""Usual size of the residuals, so that joints and base weigh alike; N·m, N, N·m."""
LEGS: Final = np.repeat(np.arange(facts.N_LEGS), 3)


def motion_views(signals: DynamicsSignals, lag_s: float) -> tuple[ChannelView, ChannelView]:
    """Build both channels; ``lag_s`` is the load's by channel *set-point to load*, 0 where it is unknown."""
    stack, contact = signals.stack, signals.contact
    in_air = stack.inner(~contact, AFTER_LIFT_OFF, BEFORE_TOUCH_DOWN)[signals.rows]
    swinging = in_air & (np.linalg.norm(signals.nominal.foot_force_n, axis=2) < LIGHT_N)
    steady = stack.inner(contact, EDGE, EDGE) | stack.inner(~contact, EDGE, EDGE)
    calm = np.all(steady[signals.rows], axis=1)
    _, _, residuals = aligned(signals, swinging, calm, lag_s)
    # A foot that skips over the ground is carried by no flag, and shakes its whole leg.
    rattles = rattling(stack)[signals.rows].reshape(-1, facts.N_LEGS, 3).any(axis=2)
    usable = np.repeat(swinging & ~rattles, 3, axis=1)
    load = signals.inputs.load_nm
    moved = [float(np.sqrt(np.mean(load[rows, i] ** 2))) if rows.any() else 0.0 for i, rows in enumerate(usable.T)]
    floor = np.maximum(JOINT_FLOOR_NM, JOINT_SHARE * np.array(moved))
    # The rows are already smoothed, so the noise found in them is what smoothing leaves.
    joints = stack.joint_view(
        Channel.LOAD_TO_MOTION,
        signals.rows,
        residuals.joint_nm,
        LEGS,
        unit="N·m",
        usable=usable,
        noise=np.maximum(white_noise(residuals.joint_nm, usable, is_smoothed=True), floor),
        signals=signals,
    )
    usable = np.repeat(calm[:, None], len(BASE_ROWS), axis=1)
    base = stack.view(
        Channel.BASE_WRENCH,
        signals.rows,
        residuals.base,
        rows=BASE_ROWS,
        unit="N, N·m",
        usable=usable,
        noise=np.maximum(white_noise(residuals.base, usable, is_smoothed=True), BASE_FLOOR),
        leg_of_joint=LEGS,
        signals=signals,
    )
    return joints, base


def aligned(signals: DynamicsSignals, swinging: Flags, calm: Flags, lag_s: float) -> tuple[float, float, Residuals]:
    """Choose the convention that leaves least over swinging joints (n, 4) and the body's rows where calm (n,).

    Returns:
        How much older than the motion the loads are, and the positions at which they acted, s; the residuals without
        what these offsets make.
    """
    drift = feet_wrench(signals.inputs, signals.load_rate_nm_s, signals.model.foot_radius_m).sum(axis=1)
    shifted, nominal = signals.shifted_s(), signals.nominal
    found: list[tuple[float, float, Residuals]] = []
    for load_s, position_s in ((0.0, 0.0), (0.5 * lag_s, lag_s)):
        residuals = Residuals(
            joint_nm=nominal.joint_nm + load_s * signals.load_rate_nm_s + position_s * shifted.joint_nm,
            base=nominal.base + load_s * drift + position_s * shifted.base,
            foot_force_n=nominal.foot_force_n,
        )
        found.append((load_s, position_s, residuals))
    return min(found, key=lambda each: _cost(each[2], swinging, calm))


def _cost(residuals: Residuals, swinging: Flags, calm: Flags) -> float:
    """Mean size of the residuals, which outliers do not rule."""
    base = np.abs(residuals.base[calm] / BASE_SCALE)
    joint = np.abs(residuals.joint_nm[np.repeat(swinging, 3, axis=1)])
    every = np.concatenate([base.ravel(), joint.ravel() / JOINT_SCALE_NM])
    return float(np.mean(np.minimum(every, 5.0))) if len(every) else 0.0
