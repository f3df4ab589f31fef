"""A drive without a formula: a small network with memory in place of the law from asked torque to torque."""

from __future__ import annotations

import numpy as np

from spot_model.robot.facts import Array
from withheld.realities.fault_kind import Ask, Built, at
from withheld.realities.hooks import Motion

HIDDEN = 24
LAGS = 3
LAG_STEPS = 6
"""Physics steps between two remembered inputs."""
TORQUE_NM, SPEED_RAD_S = 20.0, 6.0
"""Scales of the inputs."""
DEVIATION_NM = 5.0
N_SAMPLES = 4000


def learned_drive(ask: Ask) -> Built:
    """Networks in place of drives: they depart from the asked torque as no formula of the library does."""
    part = LearnedDrive(at(ask.joints, ask.size * DEVIATION_NM), ask.rng)
    return Built(lambda robot: robot.motors.append(part))


class LearnedDrive:
    """τ = asked + a·net(asked, speed, and both at two earlier instants).

    The hidden layer is random; the output layer is fitted, on made-up gaits, to random functions of the inputs, less
    all that a straight line through torque, speed and their signs explains: gains, frictions and lags are taken out.

    Args:
        deviation_nm: Root mean square of what is added on those gaits, by joint, shape (12,).
        rng: Draws the network.
    """

    def __init__(self, deviation_nm: Array, rng: np.random.Generator) -> None:
        self._deviation = deviation_nm
        self._first = rng.normal(0.0, 1.0, (2 * LAGS, HIDDEN))
        self._shift = rng.uniform(-1.5, 1.5, HIDDEN)
        self._last, self._line = self._fit(rng)
        self._past: Array = np.zeros((LAGS * LAG_STEPS, 1, len(deviation_nm), 2))
        self._row = 0

    def start(self, n_runs: int) -> None:
        """Forget."""
        self._past = np.zeros((LAGS * LAG_STEPS, n_runs, len(self._deviation), 2))
        self._row = 0

    def act(self, torque_nm: Array, motion: Motion) -> Array:
        """The network's torque."""
        self._past[self._row, :, :, 0] = torque_nm / TORQUE_NM
        self._past[self._row, :, :, 1] = motion.rotor_rad_s / SPEED_RAD_S
        rows = [(self._row - LAG_STEPS * k) % len(self._past) for k in range(LAGS)]
        self._row = (self._row + 1) % len(self._past)
        inputs = np.concatenate([self._past[row] for row in rows], axis=2)
        added = np.tanh(inputs @ self._first + self._shift) @ self._last - _plain(inputs) @ self._line
        # Beyond the gaits that it was fitted on a network may say anything; a drive does not.
        return np.asarray(torque_nm + self._deviation * np.clip(added, -2.5, 2.5))

    def _fit(self, rng: np.random.Generator) -> tuple[Array, Array]:
        """Output weights, and the straight line that is taken out."""
        steps = rng.normal(0.0, 0.35, (N_SAMPLES, LAGS - 1, 2))
        now = rng.normal(0.0, 1.0, (N_SAMPLES, 2))
        inputs = np.concatenate([now, *(now + np.cumsum(steps, axis=1)[:, k] for k in range(LAGS - 1))], axis=1)
        hidden = np.tanh(inputs @ self._first + self._shift)
        weights = rng.normal(0.0, 1.0, HIDDEN)
        wanted = hidden @ weights
        line = np.linalg.lstsq(_plain(inputs), wanted, rcond=None)[0]
        spread = float(np.std(wanted - _plain(inputs) @ line))
        return np.asarray(weights / spread), np.asarray(line / spread, dtype=np.float64)


def _plain(inputs: Array) -> Array:
    """What formulas are made of: one, torque and speed at all instants, direction, torque against direction."""
    torque, speed = inputs[..., :1], inputs[..., 1:2]
    way = np.tanh(8.0 * speed)
    return np.concatenate([np.ones_like(torque), inputs, way, np.abs(torque) * way], axis=-1)
