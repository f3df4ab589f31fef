"""Encoders and load cells: offsets, eccentric rings, noise and steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spot_model.robot.facts import N_JOINTS, Array
from withheld.simulator.mechanics.drive import Drives
from withheld.simulator.robot import Robot


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
