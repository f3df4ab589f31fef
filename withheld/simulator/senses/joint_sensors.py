"""Encoders and load cells: offsets, eccentric rings, filters, noise and steps."""

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
        self._filter_rad_s = 2.0 * np.pi * s.velocity_filter_hz
        self._is_filtered = np.isfinite(self._filter_rad_s)
        self._has_filter = bool(self._is_filtered.any())
        self._quantum = np.repeat([s.position_quantum_rad, s.velocity_quantum_rad_s, s.load_quantum_nm], N_JOINTS)
        self._per_quantum = 1.0 / self._quantum
        self._out: Array = np.empty((len(rngs), 3 * N_JOINTS))
        self._parts = robot.readings
        for part in self._parts:
            part.start(len(rngs))
        self._slow: Array | None = None
        self._before: Array = np.zeros((len(rngs), N_JOINTS))
        self._rate: Array = np.zeros((len(rngs), N_JOINTS))

    def read(self, state: int, drives: Drives, dt_s: float) -> Reading:
        """What is reported at this state."""
        s, m, out = self._s, drives.motion, self._out
        out[:, :N_JOINTS] = drives.encoder_rad()
        out[:, N_JOINTS : 2 * N_JOINTS] = self._filtered(m.rotor_rad_s, dt_s) if self._has_filter else m.rotor_rad_s
        out[:, 2 * N_JOINTS :] = s.load_gain * drives.cell_nm + s.load_bias_nm
        for part in self._parts:
            out = part.act(out, dt_s)
        stepped = np.round((out + self._noise[state]) * self._per_quantum) * self._quantum
        return Reading(stepped[:, :N_JOINTS], stepped[:, N_JOINTS : 2 * N_JOINTS], stepped[:, 2 * N_JOINTS :], stepped)

    def _filtered(self, velocity: Array, dt_s: float) -> Array:
        """A second-order (Butterworth) low pass, each sample split so that it stays stable at any corner."""
        if self._slow is None:
            self._slow, self._before = velocity.copy(), velocity.copy()
        corner = np.where(self._is_filtered, self._filter_rad_s, 0.0)
        pieces = 6
        h = dt_s / pieces
        for piece in range(1, pieces + 1):
            # Implicit in the rate, so that a corner above the sample rate damps and does not blow up.
            now = self._before + piece / pieces * (velocity - self._before)
            pull = corner**2 * (now - self._slow)
            self._rate = (self._rate + h * pull) / (1.0 + 1.414 * corner * h + (corner * h) ** 2)
            self._slow = self._slow + h * self._rate
        self._before = velocity.copy()
        self._slow = np.where(self._is_filtered, self._slow, velocity)
        return self._slow
