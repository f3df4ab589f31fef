"""Options of the MuJoCo model: solver, contacts and collisions."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from spot_model.errors import BadInputError
from spot_model.robot.facts import JOINT_NAMES
from spot_model.robot.terrain import FlatTerrain, Terrain


@dataclass(frozen=True)
class MjcfOptions:
    """Everything about the MuJoCo model that is a choice and not a fact about the robot.

    Args:
        timestep_s: Physics step, s.
        integrator: MuJoCo's integrator.
        cone: Friction cone.
        solver_iterations: Upper bound on Newton iterations a step.
        contact_solref: MuJoCo contact time constant (s) and damping ratio; a time constant under two steps is
            stiffer than the step can follow.
        contact_solimp: MuJoCo contact impedance: smallest, largest, width (m).
        foot_friction: Sliding friction coefficient between foot and ground.
        terrain: The ground.
        collision: "feet" lets only the four foot spheres touch the ground; "all" adds the body and the legs, so
            that a fall is a contact and not a sinking. Links never collide with each other.
        armature_kg_m2: Reflected rotor inertia a joint, one number or twelve in canonical order. Default 0: the
            nominal model of the paper has none, and the public estimate in ``facts`` is not a measurement.
        link_torque_sensors: Adds a torque sensor on the link side of each joint, at about a tenth of the speed.
        visuals: Keeps the shapes that are only seen; they carry no mass and touch nothing, but cost time.
    """

    timestep_s: float = 0.005
    integrator: Literal["Euler", "implicitfast", "implicit", "RK4"] = "Euler"
    cone: Literal["pyramidal", "elliptic"] = "pyramidal"
    solver_iterations: int = 20
    contact_solref: tuple[float, float] = (0.02, 1.0)
    contact_solimp: tuple[float, float, float] = (0.9, 0.95, 0.001)
    foot_friction: float = 0.8
    terrain: Terrain = field(default_factory=FlatTerrain)
    collision: Literal["feet", "all"] = "all"
    armature_kg_m2: float | tuple[float, ...] = 0.0
    link_torque_sensors: bool = False
    visuals: bool = True

    def __post_init__(self) -> None:
        _check(self.timestep_s > 0.0, "timestep_s", self.timestep_s, "above 0 s")
        _check_choice("integrator", self.integrator, ("Euler", "implicitfast", "implicit", "RK4"))
        _check_choice("cone", self.cone, ("pyramidal", "elliptic"))
        _check_choice("collision", self.collision, ("feet", "all"))
        _check(self.solver_iterations >= 1, "solver_iterations", self.solver_iterations, "at least 1")
        _check(self.foot_friction >= 0.0, "foot_friction", self.foot_friction, "at least 0")
        n_values = 1 if isinstance(self.armature_kg_m2, (int, float)) else len(self.armature_kg_m2)
        _check(n_values in (1, len(JOINT_NAMES)), "armature_kg_m2", self.armature_kg_m2, "one number or twelve")
        _check(min(self.armature_by_joint) >= 0.0, "armature_kg_m2", self.armature_kg_m2, "at least 0 kg·m²")

    @property
    def armature_by_joint(self) -> tuple[float, ...]:
        """Twelve values, canonical order, kg·m²."""
        if isinstance(self.armature_kg_m2, (int, float)):
            return (float(self.armature_kg_m2),) * len(JOINT_NAMES)
        values = tuple(self.armature_kg_m2)
        return values * len(JOINT_NAMES) if len(values) == 1 else values


def _check(holds: bool, name: str, value: object, allowed: str) -> None:
    if not holds:
        raise BadInputError(f"MjcfOptions.{name} is {value!r}; it must be {allowed}")


def _check_choice(name: str, value: str, allowed: tuple[str, ...]) -> None:
    _check(value in allowed, name, value, "one of " + ", ".join(allowed))
