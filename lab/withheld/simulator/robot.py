"""One robot as it truly is, and the parts by which a fault acts where no parameter describes it.

All arrays of a part have the runs as first axis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from spot_model.robot import facts
from spot_model.robot.facts import Array
from withheld.simulator.parameters import (
    DriveParameters,
    EstimatorParameters,
    LinkParameters,
    SensingParameters,
    SupplyParameters,
    ThermalParameters,
)


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


SetpointPart = Callable[[Array], Array]
"""What the program does to set-points, shape (n, 12) to the same."""
DelayPart = Callable[[int, np.random.Generator], Array]
"""Seconds that are added to each of some commands' delays, shape (n_commands,); infinity for a lost one."""
BodyForce = Callable[[Array, float], Array]
"""Force on the body in the world, N, shape (n, 3), from its velocities, m/s, shape (n, 3), and the time, s."""

FootForce = Callable[[Array, Array], Array]
"""Force on each foot in the world, N, from its height above level ground, m, (n, 4), and its velocity, (n, 4, 3)."""


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


SpecEdit = Callable[[mujoco.MjSpec], None]
ModelEdit = Callable[[mujoco.MjModel], None]


@dataclass
class Robot:
    """A robot to be simulated: the nominal one until ordinary errors and faults are installed."""

    drive: DriveParameters = field(default_factory=DriveParameters)
    supply: SupplyParameters = field(default_factory=SupplyParameters)
    thermal: ThermalParameters = field(default_factory=ThermalParameters)
    sensing: SensingParameters = field(default_factory=SensingParameters)
    estimator: EstimatorParameters = field(default_factory=EstimatorParameters)
    link: LinkParameters = field(default_factory=LinkParameters)
    foot_radius_m: Array = field(default_factory=lambda: np.full(facts.N_LEGS, facts.FOOT_RADIUS_M))
    foot_friction: Array = field(default_factory=lambda: np.full(facts.N_LEGS, 0.8))
    foot_softness: Array = field(default_factory=lambda: np.ones(facts.N_LEGS))
    """Time scale of the contact over the usual."""
    foot_damping: Array = field(default_factory=lambda: np.ones(facts.N_LEGS))
    """Damping ratio of the contact over the usual."""
    spec_edits: list[SpecEdit] = field(default_factory=list)
    """Changes of the body before it is compiled."""
    model_edits: list[ModelEdit] = field(default_factory=list)
    """Changes of the compiled body."""
    motors: list[TorquePart] = field(default_factory=list)
    """What becomes of the motor's torque before it meets the rotor."""
    rotors: list[TorquePart] = field(default_factory=list)
    """Torques on the rotor beside motor, gear and friction: each gets zeros, and returns what it adds."""
    links: list[TorquePart] = field(default_factory=list)
    """Torques on the links behind the gear's sensor, likewise."""
    setpoints: list[SetpointPart] = field(default_factory=list)
    """What the program makes of the policy's set-points."""
    delays: list[DelayPart] = field(default_factory=list)
    """What is added to the commands' delays; infinity loses one."""
    readings: list[ReadingPart] = field(default_factory=list)
    """What becomes of the joints' readings before servo, policy and log get them."""
    body_forces: list[BodyForce] = field(default_factory=list)
    """External forces on the body."""
    foot_forces: list[FootForce] = field(default_factory=list)
    """External forces on the feet."""


def leg_mask(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Legs with any joint in a mask of shape (12,), shape (4,)."""
    return np.asarray(mask.reshape(facts.N_LEGS, 3).any(axis=1))
