"""Where a fault may act that no parameter describes: small protocols, all arrays with the runs as first axis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from spot_model.robot.facts import Array


@dataclass
class Motion:
    """What a drive's part sees at a physics step; arrays are (n, 12), overwritten at the next step."""

    dt_s: float
    rotor_rad: Array
    rotor_rad_s: Array
    link_rad: Array
    link_rad_s: Array
    gear_nm: Array
    """Between rotor and link, of the step before."""
    bus_v: Array
    """Shape (n, 1)."""


class TorquePart(Protocol):
    """Something that changes or adds a torque."""

    def start(self, n_runs: int) -> None:
        """Begin afresh, for so many runs side by side."""

    def act(self, torque_nm: Array, motion: Motion) -> Array:
        """The torque that comes out, shape (n, 12); the argument stays as it is."""


class SetpointPart(Protocol):
    """Something that the program does to set-points."""

    def act(self, setpoint_rad: Array) -> Array:
        """Shape (n, 12) to the same."""


class DelayPart(Protocol):
    """Something that happens to commands on their way."""

    def extra_s(self, n_commands: int, rng: np.random.Generator) -> Array:
        """Added to each command's delay, shape (n_commands,); infinity for a lost one."""


class BodyForce(Protocol):
    """An outer force on the body."""

    def force_n(self, velocity_m_s: Array, time_s: float) -> Array:
        """World frame, at the body's centre of mass, from velocities (n, 3) in the world; shape (n, 3)."""


class ReadingPart(Protocol):
    """Something that happens to the joints' readings."""

    def start(self, n_runs: int) -> None:
        """Begin afresh, for so many runs side by side."""

    def act(self, reading: Array, dt_s: float) -> Array:
        """Positions, velocities and loads side by side, shape (n, 36), to the same."""


class Law:
    """A part without memory: one function of torque and motion."""

    def __init__(self, law: Callable[[Array, Motion], Array]) -> None:
        self._law = law

    def start(self, n_runs: int) -> None:
        """Nothing to remember."""

    def act(self, torque_nm: Array, motion: Motion) -> Array:
        """The law's torque."""
        return np.asarray(self._law(torque_nm, motion))
