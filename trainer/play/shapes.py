"""The shapes of a MuJoCo model as triangles, and where they are; no OpenGL is needed."""

from __future__ import annotations

from collections.abc import Iterable
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
class Shape:
    """One shape that several geoms of a model have, each with its own colour."""

    vertices_m: NDArray[np.float32]
    """Shape (V, 3), in the geom's frame."""
    faces: NDArray[np.uint32]
    """Shape (F, 3)."""
    geoms: NDArray[np.intp]
    """Numbers of the geoms in the model, shape (n,)."""
    colours: NDArray[np.uint8]
    """Shape (n, 3)."""


def shapes_of(model: mujoco.MjModel) -> tuple[Shape, ...]:
    """All shapes of a model's robot."""
    groups: dict[tuple[int, tuple[float, ...]], list[int]] = {}
    for geom in range(model.ngeom):
        kind = int(model.geom_type[geom])
        if kind in DRAWN:
            groups.setdefault((kind, tuple(map(float, model.geom_size[geom]))), []).append(geom)
    return tuple(_shape(model, kind, size, geoms) for (kind, size), geoms in groups.items())


def _shape(model: mujoco.MjModel, kind: int, size: tuple[float, ...], geoms: Iterable[int]) -> Shape:
    mesh = _mesh(kind, size)
    numbers = np.array(list(geoms), dtype=np.intp)
    colours = np.array([_rgba(model, geom)[:3] for geom in numbers])
    return Shape(
        np.asarray(mesh.vertices, dtype=np.float32),
        np.asarray(mesh.faces, dtype=np.uint32),
        numbers,
        np.round(255.0 * colours).astype(np.uint8),
    )


def _mesh(kind: int, size: tuple[float, ...]) -> Any:
    """MuJoCo's primitives: half sizes; cylinders and capsules along z, a capsule's length without its caps."""
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return trimesh.creation.box(extents=2.0 * np.array(size))
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return trimesh.creation.icosphere(subdivisions=2, radius=size[0])
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return trimesh.creation.cylinder(radius=size[0], height=2.0 * size[1], sections=24)
    return trimesh.creation.capsule(radius=size[0], height=2.0 * size[1], count=[12, 16])


def _rgba(model: mujoco.MjModel, geom: int) -> Array:
    material = int(model.geom_matid[geom])
    rgba: Array = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    return rgba


class Pose:
    """Where the shapes of one model are, for positions of its joints."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model, self._data = model, mujoco.MjData(model)

    def put(self, qpos: Array) -> None:
        """Take MuJoCo's generalised position, shape (19,)."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)

    def positions_m(self, geoms: NDArray[np.intp]) -> NDArray[np.float32]:
        """Of geoms in the world, shape (n, 3)."""
        return np.asarray(self._data.geom_xpos[geoms], dtype=np.float32)

    def world_from_geoms_wxyz(self, geoms: NDArray[np.intp]) -> NDArray[np.float32]:
        """Attitudes of geoms, shape (n, 4)."""
        out = np.empty((len(geoms), 4))
        for row, geom in zip(out, geoms, strict=True):
            mujoco.mju_mat2Quat(row, self._data.geom_xmat[geom])
        return out.astype(np.float32)
