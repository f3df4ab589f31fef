"""Loads against what was asked of the joints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from spot_model.robot import facts
from spot_model.robot.knee_table import KNEE_TABLE_POSITION_RAD, KNEE_TABLE_TORQUE_NM
from spot_model.robot.state import Array, JointCommand
from spot_runtime.control.safety.signals import bounds
from spot_runtime.control.safety.signals.window import Window


def disagreeing(window: Window, commands: Sequence[JointCommand]) -> NDArray[np.bool_]:
    """Joints whose load lies far from whatever the servo law could have asked of them. Shape (12,).

    The load may answer any of these recent commands, of which there is at least one.
    """
    state = window.last
    asked = np.array([torque_nm(command, state.position_rad, state.velocity_rad_s) for command in commands])
    least, largest = asked.min(axis=0), asked.max(axis=0)
    gains = commands[-1].gains
    # Between what is reported and what the servo acts on, position and velocity move on.
    lag = bounds.LOAD_LAG_S * (
        gains.kp_nm_per_rad * np.abs(state.velocity_rad_s)
        + gains.kd_nm_s_per_rad * window.velocity_range_rad_s / window.duration_s
    )
    allowed = bounds.LOAD_NM + bounds.LOAD_SHARE * np.maximum(np.abs(least), np.abs(largest)) + lag
    # Less torque than was asked is what limits and weak motors do; it never turns round.
    low, high = np.minimum(least, 0.0) - allowed, np.maximum(largest, 0.0) + allowed
    return np.asarray((state.load_nm < low) | (state.load_nm > high))


def at_stop(position_rad: Array) -> NDArray[np.bool_]:
    """Joints that may lie on their stops, whose force their loads contain. Shape (12,)."""
    low, high = facts.POSITION_LOW_RAD + bounds.STOP_RAD, facts.POSITION_HIGH_RAD - bounds.STOP_RAD
    return np.asarray((position_rad < low) | (position_rad > high))


def motor_torque_nm(position_rad: Array) -> Array:
    """Most that the motors give at these positions: that of a knee depends on its lever. Shape (12,)."""
    most = np.full(facts.N_JOINTS, facts.HIP_TORQUE_LIMIT_NM)
    most[2::3] = np.interp(position_rad[2::3], KNEE_TABLE_POSITION_RAD, KNEE_TABLE_TORQUE_NM)
    return most


def torque_nm(command: JointCommand, position_rad: Array, velocity_rad_s: Array) -> Array:
    """What a command asks of the joints at these positions and velocities. Shape (12,)."""
    gains = command.gains
    torque = gains.kp_nm_per_rad * (command.position_rad - position_rad) + command.load_nm
    return np.asarray(torque - gains.kd_nm_s_per_rad * velocity_rad_s)
