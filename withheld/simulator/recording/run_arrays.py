"""One simulated run as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot_model.robot.facts import Array
from spot_model.robot.state import Measured
from withheld.simulator.recording.transport import Deliveries


@dataclass(frozen=True)
class RunArrays(Measured):
    """m states, as reported, k ticks, p polls; stamps count from state 0, ns."""

    imu_acceleration_m_s2: Array
    """Three packets a state, oldest first, 2, 1 and 0 ms old. Shape (m, 3, 3)."""
    imu_turn_rad_s: Array
    deliveries: Deliveries
    echoed: NDArray[np.intp]
    """Newest command that had arrived at each state, -1 for none."""
    setpoint_rad: Array
    """Sent with command k. Shape (m, 12)."""
    tick_state: NDArray[np.intp]
    """State of each tick, shape (k,)."""
    observation: NDArray[np.float32]
    action: NDArray[np.float32]
    velocity_command: Array
    requested_rad: Array
    """Shape (k, 12)."""
    is_active: NDArray[np.bool_]
    """Whether the ramp from the stand was over, shape (k,)."""
    battery_v: Array
    """At every state, shape (m,)."""
    battery_a: Array
    """Drawn; positive while it discharges."""
    battery_percent: Array
    winding_c: Array
    """Shape (m, 12)."""
