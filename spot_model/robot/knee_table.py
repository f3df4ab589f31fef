"""The knee's torque limit by position: a lead screw whose lever arm changes with the joint angle.

Source: transmission ratios published in Isaac Lab's Spot asset (BSD-3-Clause); the torque limit is 1.5 N·m times the
ratio's magnitude.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

KNEE_MOTOR_TORQUE_NM: Final = 1.5

_TABLE: Final = np.loadtxt(Path(__file__).with_name("knee_transmission.csv"), delimiter=",", skiprows=1).T.copy()

KNEE_TABLE_POSITION_RAD: Final[NDArray[np.float64]] = _TABLE[0]
"""Knee angles of the table, shape (101,), rising and evenly spaced, rad."""

KNEE_TABLE_RATIO: Final[NDArray[np.float64]] = _TABLE[1]
"""Transmission ratio, motor to joint, shape (101,); negative by the sense of rotation."""

KNEE_TABLE_TORQUE_NM: Final[NDArray[np.float64]] = KNEE_MOTOR_TORQUE_NM * np.abs(KNEE_TABLE_RATIO)
"""Torque limit at each angle, shape (101,), N·m."""
