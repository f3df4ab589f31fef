"""Options of the MuJoCo model: solver, contacts, terrain and collisions."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from spot_model.errors import BadInputError
from spot_model.robot.facts import JOINT_NAMES, Array


@dataclass(frozen=True)
class FlatTerrain:
    """An endless horizontal plane at z = 0."""


@dataclass(frozen=True)
class NoiseTerrain:
    """Low-poly rough ground: independent uniform heights on a square grid, joined by triangles.

    Args:
        seed: Seed of the heights; the same seed gives the same ground.
        amplitude_m: Heights lie in [-amplitude_m, amplitude_m], m, > 0.
        cell_m: Grid spacing, m, > 0; rounded so that a whole number of cells spans the ground.
        half_size_m: The ground covers [-half_size_m, half_size_m] in x and y, m.
        flat_radius_m: Ground nearer than this to the origin stays at z = 0, m, so that a robot starts level.
        goes_on: Beyond the edge, which is then at the lowest height, a plane goes on; otherwise a robot falls off.
    """

    seed: int
    amplitude_m: float = 0.03
    cell_m: float = 0.25
    half_size_m: float = 10.0
    flat_radius_m: float = 0.8
    goes_on: bool = False

    def __post_init__(self) -> None:
        for name in ("amplitude_m", "cell_m", "half_size_m"):
            if not getattr(self, name) > 0.0:
                raise BadInputError(f"NoiseTerrain.{name} is {getattr(self, name)}; it must be above 0 m")
        if self.cell_m > self.half_size_m:
            raise BadInputError(
                f"NoiseTerrain.cell_m is {self.cell_m} m; it must be at most half_size_m = {self.half_size_m} m"
            )


Terrain = FlatTerrain | NoiseTerrain


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


GROUND_GEOM = "ground"
BEYOND_GEOM = "beyond"
_BASE_THICKNESS_M = 0.5


def terrain_heights_m(terrain: NoiseTerrain) -> Array:
    """Heights at the grid points, shape (n, n), rows along +y and columns along +x, m."""
    n = 2 * round(terrain.half_size_m / terrain.cell_m) + 1
    heights = np.random.default_rng(terrain.seed).uniform(-terrain.amplitude_m, terrain.amplitude_m, size=(n, n))
    axis = np.linspace(-terrain.half_size_m, terrain.half_size_m, n)
    x, y = np.meshgrid(axis, axis)
    heights[np.hypot(x, y) < terrain.flat_radius_m] = 0.0
    if terrain.goes_on:
        edge = np.maximum(np.abs(x), np.abs(y)) > terrain.half_size_m - 0.5 * terrain.cell_m
        heights[edge] = heights.min()
    return heights


def terrain_asset(terrain: Terrain) -> str:
    """The height field that the ground needs, or nothing."""
    if not isinstance(terrain, NoiseTerrain):
        return ""
    heights = terrain_heights_m(terrain)
    # MuJoCo stretches the data to 0..1 and then by the third size; the offset goes into the geom's position.
    span = float(np.ptp(heights))
    size = f"{terrain.half_size_m!r} {terrain.half_size_m!r} {span!r} {_BASE_THICKNESS_M!r}"
    # Inline elevation lists the rows from +y to −y, as a picture seen from above.
    data = " ".join(repr(float(h)) for h in (heights[::-1] - heights.min()).ravel())
    n = len(heights)
    return f'<hfield name="ground" nrow="{n}" ncol="{n}" size="{size}" elevation="{data}"/>'


def terrain_geom(terrain: Terrain) -> str:
    """The ground's geom, and a plane beyond its edge where it goes on; nothing else can be touched by the robot."""
    common = 'material="ground" contype="1" conaffinity="0" priority="0"'
    if not isinstance(terrain, NoiseTerrain):
        return f'<geom name="{GROUND_GEOM}" {common} type="plane" size="0 0 0.05"/>'
    place = f'pos="0 0 {float(terrain_heights_m(terrain).min())!r}"'
    plane = f'<geom name="{BEYOND_GEOM}" {common} type="plane" size="0 0 0.05" {place}/>' if terrain.goes_on else ""
    return f'<geom name="{GROUND_GEOM}" {common} type="hfield" hfield="ground" {place}/>{plane}'
