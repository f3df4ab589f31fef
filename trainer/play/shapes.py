"""The shapes of a MuJoCo model as triangles, and where its bodies are; no OpenGL is needed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
import trimesh
from numpy.typing import NDArray

from spot_model.robot.facts import Array

DRAWN: Final = {
    mujoco.mjtGeom.mjGEOM_BOX,
    mujoco.mjtGeom.mjGEOM_CAPSULE,
    mujoco.mjtGeom.mjGEOM_CYLINDER,
    mujoco.mjtGeom.mjGEOM_SPHERE,
}
"""Shapes that robots are made of; the ground is drawn apart."""


@dataclass(frozen=True)
class DrawnShape:
    """One geom of a model, fixed to a body."""

    body: int
    """Number of the body in the model."""
    vertices_m: NDArray[np.float32]
    """Shape (V, 3), in the geom's frame."""
    faces: NDArray[np.uint32]
    """Shape (F, 3)."""
    position_in_body_m: Array
    """Shape (3,)."""
    body_from_geom_wxyz: Array
    """Shape (4,)."""
    colour: tuple[int, int, int]
    """Red, green and blue, 0 to 255."""


def shapes_of(model: mujoco.MjModel) -> Iterator[DrawnShape]:
    """All shapes of a model's robot."""
    for geom in range(model.ngeom):
        kind = int(model.geom_type[geom])
        if kind in DRAWN:
            mesh = _mesh(kind, model.geom_size[geom])
            red, green, blue = (round(255.0 * float(c)) for c in _rgba(model, geom)[:3])
            yield DrawnShape(
                int(model.geom_bodyid[geom]),
                np.asarray(mesh.vertices, dtype=np.float32),
                np.asarray(mesh.faces, dtype=np.uint32),
                model.geom_pos[geom],
                model.geom_quat[geom],
                (red, green, blue),
            )


def _mesh(kind: int, size: Array) -> Any:
    """MuJoCo's primitives: half sizes; cylinders and capsules along z, a capsule's length without its caps."""
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return trimesh.creation.box(extents=2.0 * size)
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return trimesh.creation.icosphere(subdivisions=2, radius=size[0])
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return trimesh.creation.cylinder(radius=size[0], height=2.0 * size[1], sections=24)
    return trimesh.creation.capsule(radius=size[0], height=2.0 * size[1], count=[12, 16])


def _rgba(model: mujoco.MjModel, geom: int) -> Array:
    material = int(model.geom_matid[geom])
    rgba: Array = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    return rgba


class Bodies:
    """Where the bodies of one model are, for positions of its joints."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model, self._data = model, mujoco.MjData(model)

    def put(self, qpos: Array) -> tuple[Array, Array]:
        """Positions (m) in the world, shape (n_bodies, 3), and attitudes w, x, y, z, shape (n_bodies, 4).

        Args:
            qpos: MuJoCo's generalised position, shape (19,).
        """
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        return self._data.xpos, self._data.xquat
