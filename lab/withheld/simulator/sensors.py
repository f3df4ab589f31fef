"""What the robot senses: encoders and load cells, contact flags, and an inertial unit with three packets a state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from spot_model.robot.facts import N_JOINTS, N_LEGS, STATE_PERIOD_NS, Array
from spot_model.robot.rotation import matrix_from_wxyz, multiply_wxyz
from withheld.simulator.drives import Drives
from withheld.simulator.parameters import GRAVITY_M_S2, SensingParameters
from withheld.simulator.robot import Robot

PACKETS: Final = 3
PACKET_NS: Final = 1_000_000
_PACKET_S: Final = PACKET_NS * 1e-9


class InertialUnit:
    """Senses n runs over m states; what the estimator gets is the mean of the packets that the log will have."""

    def __init__(
        self, sensing: SensingParameters, n_states: int, steps_per_state: int, rngs: Sequence[np.random.Generator]
    ) -> None:
        self._s, self._sub = sensing, steps_per_state
        n = len(rngs)
        noise = np.stack([rng.standard_normal((n_states, PACKETS, 6)) for rng in rngs], axis=1)
        self._turn_noise = sensing.gyro_noise_rad_s * noise[..., :3] + sensing.gyro_bias_rad_s
        self._felt_noise = sensing.acceleration_noise_m_s2 * noise[..., 3:] + sensing.acceleration_bias_m_s2
        self._felt_mean, self._turn_mean = self._felt_noise.mean(axis=2), self._turn_noise.mean(axis=2)
        # One row for the start, then one a physics step.
        self._attitude = np.zeros((n_states * steps_per_state + 1, n, 4))
        self._velocity = np.zeros((n_states * steps_per_state + 1, n, 6))
        self.body_from_unit_wxyz = tilt_wxyz(sensing.imu_tilt_rpy_rad)
        self._unit_from_body = matrix_from_wxyz(self.body_from_unit_wxyz).T

    def note(self, row: int, attitude_wxyz: Array, velocity: Array) -> None:
        """Keep the motion after a physics step; row 0 is the start."""
        self._attitude[row] = attitude_wxyz
        self._velocity[row] = velocity

    def sense(self, state: int) -> tuple[Array, Array]:
        """Turn rate now, and specific force over the state before, both in the unit's frame, shape (n, 3)."""
        row = state * self._sub
        before = max(0, row - self._sub)
        change = self._velocity[row, :, :3] - self._velocity[before, :, :3]
        felt = change / (STATE_PERIOD_NS * 1e-9)
        felt[:, 2] += GRAVITY_M_S2
        in_body = np.matmul(matrix_from_wxyz(self._attitude[row]).transpose(0, 2, 1), felt[:, :, None])[:, :, 0]
        return (
            self._velocity[row, :, 3:] @ self._unit_from_body.T + self._turn_mean[state],
            in_body @ self._unit_from_body.T + self._felt_mean[state],
        )

    def packets(self) -> tuple[Array, Array]:
        """All packets: specific force and turn rate, each of shape (m, n, 3, 3), oldest of a state first."""
        m = len(self._felt_noise)
        at_ns = (STATE_PERIOD_NS * np.arange(m)[:, None] - PACKET_NS * np.arange(PACKETS - 1, -1, -1)).astype(
            np.float64
        )
        velocity, earlier = self._at(self._velocity, at_ns), self._at(self._velocity[..., :3], at_ns - PACKET_NS)
        attitude = self._at(self._attitude, at_ns)
        felt = (velocity[..., :3] - earlier) / _PACKET_S
        felt[..., 2] += GRAVITY_M_S2
        rotation = matrix_from_wxyz(attitude / np.linalg.norm(attitude, axis=-1, keepdims=True))
        unit_from_world = np.matmul(self._unit_from_body, np.swapaxes(rotation, -1, -2))
        force = np.matmul(unit_from_world, felt[..., None])[..., 0].transpose(0, 2, 1, 3)
        turn = (velocity[..., 3:] @ self._unit_from_body.T).transpose(0, 2, 1, 3)
        return force + self._felt_noise, turn + self._turn_noise

    def _at(self, history: Array, at_ns: Array) -> Array:
        """Values at instants between physics steps, shape (m, 3, n, k)."""
        row = np.clip(at_ns * (self._sub / STATE_PERIOD_NS), 0.0, None)
        low = np.floor(row).astype(np.intp)
        share = (row - low)[..., None, None]
        high = np.minimum(low + 1, len(history) - 1)
        return np.asarray((1.0 - share) * history[low] + share * history[high])


def tilt_wxyz(rpy_rad: Array) -> Array:
    """Quaternion of a roll, then a pitch, then a yaw about the unit's own axes, shape (4,)."""
    out = np.array([1.0, 0.0, 0.0, 0.0])
    for axis, angle in enumerate(rpy_rad):
        turn = np.zeros(4)
        turn[0], turn[1 + axis] = np.cos(0.5 * angle), np.sin(0.5 * angle)
        out = np.asarray(multiply_wxyz(out, turn))
    return out


class ContactDetector:
    """Flags of the four feet in n runs."""

    def __init__(self, sensing: SensingParameters, n_runs: int, dt_s: float) -> None:
        self._sensing = sensing
        self._blend = -np.expm1(-dt_s / sensing.contact_filter_s)
        self.force_n: Array = np.zeros((n_runs, N_LEGS))
        """Filtered."""
        self._waited: Array = np.zeros((n_runs, N_LEGS))
        self.flags: NDArray[np.bool_] = np.zeros((n_runs, N_LEGS), dtype=np.bool_)
        self.age: Array = np.zeros((n_runs, N_LEGS))
        """States since a flag was raised; 0 while it is not."""

    def see(self, force_n: Array) -> NDArray[np.bool_]:
        """Flags after another state, from true normal forces (n, 4)."""
        s = self._sensing
        self.force_n = self.force_n + self._blend * (force_n - self.force_n)
        threshold = np.where(self.flags, s.contact_off_n, s.contact_on_n)
        differs = (self.force_n > threshold) != self.flags
        self._waited = np.where(differs, self._waited + 1.0, 0.0)
        self.flags = self.flags ^ (differs & (self._waited > s.contact_hold_states))
        self.age = np.where(self.flags, self.age + 1.0, 0.0)
        return self.flags


@dataclass(frozen=True)
class Reading:
    """What the joints report, each of shape (n, 12)."""

    position_rad: Array
    velocity_rad_s: Array
    load_nm: Array
    all: Array
    """The three side by side, shape (n, 36)."""


class JointSensors:
    """Readings of n runs; all noise is drawn at the start, run by run."""

    def __init__(self, robot: Robot, n_states: int, rngs: Sequence[np.random.Generator]) -> None:
        s = self._s = robot.sensing
        sigma = np.concatenate([s.position_noise_rad, s.velocity_noise_rad_s, s.load_noise_nm])
        self._noise = np.stack([rng.standard_normal((n_states, 3 * N_JOINTS)) for rng in rngs], axis=1) * sigma
        self._quantum = np.repeat([s.position_quantum_rad, s.velocity_quantum_rad_s, s.load_quantum_nm], N_JOINTS)
        self._per_quantum = 1.0 / self._quantum
        self._out: Array = np.empty((len(rngs), 3 * N_JOINTS))
        self._parts = robot.readings
        for part in self._parts:
            part.start(len(rngs))

    def read(self, state: int, drives: Drives, dt_s: float) -> Reading:
        """What is reported at this state."""
        s, m, out = self._s, drives.motion, self._out
        out[:, :N_JOINTS] = drives.encoder_rad()
        out[:, N_JOINTS : 2 * N_JOINTS] = m.rotor_rad_s
        out[:, 2 * N_JOINTS :] = s.load_gain * drives.cell_nm + s.load_bias_nm
        for part in self._parts:
            out = part.act(out, dt_s)
        stepped = np.round((out + self._noise[state]) * self._per_quantum) * self._quantum
        return Reading(stepped[:, :N_JOINTS], stepped[:, N_JOINTS : 2 * N_JOINTS], stepped[:, 2 * N_JOINTS :], stepped)
