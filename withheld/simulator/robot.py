"""One robot as it truly is: every parameter that an ordinary error or a fault may change. Edited in place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

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
from withheld.simulator.parts import BodyForce, DelayPart, ReadingPart, SetpointPart, TorquePart

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


def leg_mask(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Legs with any joint in a mask of shape (12,), shape (4,)."""
    return np.asarray(mask.reshape(facts.N_LEGS, 3).any(axis=1))
