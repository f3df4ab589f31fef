"""Runs as arrays: kept while they are simulated, then cut into one table a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot_model.policy.observation import N_OBSERVATION
from spot_model.robot.facts import N_JOINTS, N_LEGS, STATE_PERIOD_NS, Array
from spot_model.robot.state import Measured
from withheld.simulator.drives import Drives
from withheld.simulator.estimator import Estimator
from withheld.simulator.link import Deliveries
from withheld.simulator.parameters import EstimatorParameters
from withheld.simulator.power import Battery
from withheld.simulator.sensors import InertialUnit, Reading


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


class Recorder:
    """Arrays of n runs: m states, k ticks."""

    def __init__(
        self, n_states: int, n_ticks: int, noise: EstimatorParameters, rngs: Sequence[np.random.Generator]
    ) -> None:
        m, k, n = n_states, n_ticks, len(rngs)
        self.joints = np.zeros((m, n, 3 * N_JOINTS))
        """Positions, velocities, loads."""
        self.place = np.zeros((m, n, 3))
        self.attitude = np.zeros((m, n, 4))
        self.linear = np.zeros((m, n, 3))
        self.angular = np.zeros((m, n, 3))
        self.flags = np.zeros((m, n, N_LEGS), dtype=np.bool_)
        self.power = np.zeros((m, n, 3))
        self.winding = np.zeros((m, n, N_JOINTS))
        self.observation = np.zeros((k, n, N_OBSERVATION), dtype=np.float32)
        self.action = np.zeros((k, n, N_JOINTS), dtype=np.float32)
        self.command = np.zeros((k, n, 3))
        self.requested = np.zeros((k, n, N_JOINTS))
        self.sent = np.zeros((m, n, N_JOINTS))
        sigma = np.array([noise.velocity_noise_m_s] * 3 + [noise.position_noise_m] * 3)
        self._noise = np.stack([rng.standard_normal((m, 6)) for rng in rngs], axis=1) * sigma

    def put(
        self,
        state: int,
        reading: Reading,
        estimator: Estimator,
        flags: NDArray[np.bool_],
        battery: Battery,
        drives: Drives,
    ) -> None:
        """What the robot reports at a state, and what the slow polls will find."""
        self.joints[state] = reading.all
        self.linear[state] = estimator.reported_velocity_m_s + self._noise[state, :, :3]
        self.place[state] = estimator.position_m + self._noise[state, :, 3:]
        self.attitude[state] = estimator.attitude_wxyz
        self.angular[state] = estimator.turn_rad_s
        self.flags[state] = flags
        power = self.power[state]
        power[:, 0], power[:, 1], power[:, 2] = battery.shown_v, battery.shown_a, battery.charge_percent
        self.winding[state] = drives.motors.winding_c

    def runs(
        self, ways: Sequence[Deliveries], ticks: Sequence[NDArray[np.intp]], ramp_s: float, unit: InertialUnit
    ) -> list[RunArrays]:
        """One table a run, with the states of its own ticks."""
        force, turn = unit.packets()
        stamp_ns = STATE_PERIOD_NS * np.arange(len(self.joints), dtype=np.int64)
        found = []
        for i, way in enumerate(ways):
            position, velocity, load = np.split(self.joints[:, i], 3, axis=1)
            at, k = ticks[i], len(ticks[i])
            found.append(
                RunArrays(
                    position_rad=position,
                    velocity_rad_s=velocity,
                    load_nm=load,
                    position_of_body_in_odom_m=self.place[:, i],
                    odom_from_body_wxyz=self.attitude[:, i],
                    linear_vel_of_body_in_odom_m_s=self.linear[:, i],
                    angular_vel_of_body_in_odom_rad_s=self.angular[:, i],
                    foot_contact=self.flags[:, i],
                    imu_acceleration_m_s2=force[:, i],
                    imu_turn_rad_s=turn[:, i],
                    deliveries=way,
                    echoed=way.newest(stamp_ns),
                    setpoint_rad=self.sent[:, i],
                    tick_state=at,
                    observation=self.observation[:k, i],
                    action=self.action[:k, i],
                    velocity_command=self.command[:k, i],
                    requested_rad=self.requested[:k, i],
                    is_active=at * STATE_PERIOD_NS >= ramp_s * 1e9,
                    battery_v=self.power[:, i, 0],
                    battery_a=self.power[:, i, 1],
                    battery_percent=self.power[:, i, 2],
                    winding_c=self.winding[:, i],
                )
            )
        return found
