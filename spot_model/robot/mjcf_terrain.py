"""The ground of the MuJoCo model, as MJCF text."""

from __future__ import annotations

import numpy as np

from spot_model.robot.facts import Array
from spot_model.robot.mjcf_options import NoiseTerrain, Terrain

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
