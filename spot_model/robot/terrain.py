"""The ground of the MuJoCo model: level, low-poly rough, or tiles of slopes, rough ground and steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from spot_model.errors import BadInputError
from spot_model.robot.facts import Array


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
        _check_sizes(self, "amplitude_m", "cell_m", "half_size_m")

    def heights_m(self) -> Array:
        """Heights at the grid points, shape (n, n), rows along +y and columns along +x, m."""
        n = 2 * round(self.half_size_m / self.cell_m) + 1
        heights = np.random.default_rng(self.seed).uniform(-self.amplitude_m, self.amplitude_m, size=(n, n))
        axis = np.linspace(-self.half_size_m, self.half_size_m, n)
        x, y = np.meshgrid(axis, axis)
        heights[np.hypot(x, y) < self.flat_radius_m] = 0.0
        if self.goes_on:
            edge = np.maximum(np.abs(x), np.abs(y)) > self.half_size_m - 0.5 * self.cell_m
            heights[edge] = heights.min()
        return heights


TILE_KINDS: Final = ("level", "slope up", "slope down", "rough", "stairs up", "stairs down", "blocks", "rough")
"""As often as they stand here; what goes up or down does so from the tile's edge to its middle."""
TILE_EDGE_M: Final = 0.25
"""Every tile is level at height 0 within this distance of its edge, so that any two fit together."""
FINEST_ROUGH_M: Final = 0.1
"""Smallest grid spacing of rough tiles, as in Isaac Lab's released Spot task."""
TREADS_M: Final = (0.3, 0.6)
"""Depths of the stairs' treads."""
BLOCKS_M: Final = (0.2, 1.0)
"""Sides of single blocks."""
QUANTUM_M: Final = 2.0**-12
"""Heights are multiples of this, so that their text is short and exact."""


@dataclass(frozen=True)
class TileTerrain:
    """A square of square tiles in one height field: level, slopes, rough ground, stairs and single blocks.

    How steep, how rough and how high is drawn for each tile between half of the most and the most.

    Args:
        seed: Of the tiles' order and of everything in them.
        half_size_m: The ground covers [-half_size_m, half_size_m] in x and y, m.
        tile_m: Side of a tile, m.
        slope_deg: Steepest slope, degrees.
        step_m: Highest step, m.
        amplitude_m: Largest height of rough tiles, up and down, m.
        rough_cell_m: Largest grid spacing of rough tiles, m.
        cell_m: Grid spacing of the height field, m: a step rises within one cell.

    Source: Isaac Lab's and mjlab's terrain generators (pyramids of slopes and stairs, random uniform heights, boxes).
    """

    seed: int
    half_size_m: float = 28.0
    tile_m: float = 8.0
    slope_deg: float = 10.0
    step_m: float = 0.05
    amplitude_m: float = 0.03
    rough_cell_m: float = 0.3
    cell_m: float = 0.05

    def __post_init__(self) -> None:
        _check_sizes(self, "tile_m", "step_m", "amplitude_m", "rough_cell_m", "cell_m", "half_size_m")
        if not 0.0 < self.slope_deg <= 30.0:
            raise BadInputError(f"TileTerrain.slope_deg is {self.slope_deg}; it must be above 0 and at most 30")
        if self.tile_m > 2.0 * self.half_size_m:
            raise BadInputError(
                f"TileTerrain.tile_m is {self.tile_m} m; it must be at most twice half_size_m = {self.half_size_m} m"
            )

    def kinds(self) -> list[str]:
        """What each tile is, row by row along +y, in each along +x."""
        n = self._tiles_a_side**2
        return [str(kind) for kind in np.random.default_rng(self.seed).permutation(np.resize(TILE_KINDS, n))]

    def heights_m(self) -> Array:
        """Heights at the grid points, shape (n, n), rows along +y and columns along +x, m; level beyond whole tiles."""
        rng = np.random.default_rng([self.seed, 1])
        side, n = round(self.tile_m / self.cell_m), 2 * round(self.half_size_m / self.cell_m) + 1
        heights = np.zeros((n, n))
        first = (n - 1 - side * self._tiles_a_side) // 2
        for number, kind in enumerate(self.kinds()):
            row, column = (first + side * k for k in divmod(number, self._tiles_a_side))
            heights[row : row + side + 1, column : column + side + 1] = self._tile(kind, side + 1, rng)
        return np.round(heights / QUANTUM_M) * QUANTUM_M

    @property
    def _tiles_a_side(self) -> int:
        return int(2.0 * self.half_size_m / self.tile_m + 1e-9)

    def _tile(self, kind: str, n: int, rng: np.random.Generator) -> Array:
        """One tile, shape (n, n), m."""
        axis = np.arange(n, dtype=np.float64) * self.cell_m
        to_edge = np.minimum(axis, axis[-1] - axis)
        inwards = np.maximum(np.minimum(to_edge[:, None], to_edge[None, :]) - TILE_EDGE_M, 0.0)
        share = rng.uniform(0.5, 1.0)
        name, _, way = kind.partition(" ")
        sign = -1.0 if way == "down" else 1.0
        # The middle is level, as a landing.
        inwards = np.minimum(inwards, 0.5 * self.tile_m - 2.0 * TILE_EDGE_M)
        if name == "slope":
            return np.asarray(sign * np.tan(np.radians(share * self.slope_deg)) * inwards)
        if name == "stairs":
            return np.asarray(sign * share * self.step_m * np.ceil(inwards / rng.uniform(*TREADS_M) - 1e-9))
        if name == "rough":
            return np.asarray(share * self.amplitude_m * self._rough(axis, rng) * (inwards > 0.0))
        return self._blocks(axis, rng) * (inwards > 0.0) if name == "blocks" else np.zeros((n, n))

    def _rough(self, axis: Array, rng: np.random.Generator) -> Array:
        """Uniform heights in [-1, 1] on a grid of drawn spacing, with even surfaces between."""
        spacing = rng.uniform(min(FINEST_ROUGH_M, self.rough_cell_m), self.rough_cell_m)
        at, n = axis / spacing, int(axis[-1] / spacing) + 2
        coarse = rng.uniform(-1.0, 1.0, (n, n))
        along_x = np.array([np.interp(at, np.arange(n), row) for row in coarse])
        return np.array([np.interp(at, np.arange(n), column) for column in along_x.T]).T

    def _blocks(self, axis: Array, rng: np.random.Generator) -> Array:
        """Single blocks on level ground, one for each square metre; where two overlap, the higher one."""
        heights = np.zeros((len(axis), len(axis)))
        for _ in range(round(self.tile_m**2)):
            (x, y), (w, d) = rng.uniform(0.0, self.tile_m, 2), rng.uniform(*BLOCKS_M, 2)
            inside = ((axis > y) & (axis < y + d))[:, None] & ((axis > x) & (axis < x + w))[None, :]
            heights = np.maximum(heights, inside * self.step_m * rng.uniform(0.5, 1.0))
        return heights


RISE_WITHIN_M: Final = 0.02
"""A step of a ramp rises within this length."""
RAMP_CELL_M: Final = 0.2
"""Grid spacing of ramps across, and along where they have no steps."""


@dataclass(frozen=True)
class RampTerrain:
    """Ground that rises along +x from z = 0, evenly or in steps.

    Args:
        slope_deg: Of an even ramp, degrees.
        step_m: Height of the steps, m; 0 for an even ramp.
        tread_m: Their depth, m.
        half_size_m: The ground covers [-half_size_m, half_size_m] in x and y, m.
    """

    slope_deg: float = 0.0
    step_m: float = 0.0
    tread_m: float = 0.5
    half_size_m: float = 17.0

    def heights_m(self) -> Array:
        """Heights at the grid points, shape (rows along +y, columns along +x), m."""
        cell_m = RISE_WITHIN_M if self.step_m else RAMP_CELL_M
        rows, columns = (2 * round(self.half_size_m / cell) + 1 for cell in (RAMP_CELL_M, cell_m))
        along = np.linspace(0.0, 2.0 * self.half_size_m, columns)
        steps = self.step_m * np.floor(along / self.tread_m + 1e-9)
        return np.tile(np.tan(np.radians(self.slope_deg)) * along + steps, (rows, 1))


@dataclass(frozen=True)
class CourseTerrain:
    """Several grounds in one model: an endless plane at z = 0 and height fields above it, far from the origin.

    Args:
        fields: The height fields; see :meth:`centre_m` for where they lie.
    """

    fields: tuple[NoiseTerrain | RampTerrain, ...]

    def centre_m(self, number: int) -> tuple[float, float, float]:
        """Where the middle of the field's z = 0 lies, m."""
        return (0.0, COURSE_SPACING_M * (number + 1), COURSE_HEIGHT_M)


COURSE_SPACING_M: Final = 60.0
COURSE_HEIGHT_M: Final = 0.5
"""The fields of a course lie so far from each other and from the origin, and so high that nothing reaches the plane."""
HeightField = NoiseTerrain | TileTerrain | RampTerrain
Terrain = FlatTerrain | NoiseTerrain | TileTerrain | CourseTerrain
GROUND_GEOM: Final = "ground"
BEYOND_GEOM: Final = "beyond"
_BASE_THICKNESS_M: Final = 0.5


def _check_sizes(terrain: NoiseTerrain | TileTerrain, *names: str) -> None:
    kind = type(terrain).__name__
    for name in names:
        if not getattr(terrain, name) > 0.0:
            raise BadInputError(f"{kind}.{name} is {getattr(terrain, name)}; it must be above 0 m")
    if terrain.cell_m > terrain.half_size_m:
        raise BadInputError(
            f"{kind}.cell_m is {terrain.cell_m} m; it must be at most half_size_m = {terrain.half_size_m} m"
        )


def terrain_asset(terrain: Terrain) -> str:
    """The height fields that the ground needs, or nothing."""
    if isinstance(terrain, CourseTerrain):
        return "".join(_field_asset(f"field{i}", field) for i, field in enumerate(terrain.fields))
    return "" if isinstance(terrain, FlatTerrain) else _field_asset(GROUND_GEOM, terrain)


def _field_asset(name: str, field: HeightField) -> str:
    heights = field.heights_m()
    # MuJoCo stretches the data to 0..1 and then by the third size; the offset goes into the geom's position.
    span = float(np.ptp(heights))
    size = f"{field.half_size_m!r} {field.half_size_m!r} {span!r} {_BASE_THICKNESS_M!r}"
    # Inline elevation lists the rows from +y to −y, as a picture seen from above.
    data = " ".join(map(repr, (heights[::-1] - heights.min()).ravel().tolist()))
    rows, columns = heights.shape
    return f'<hfield name="{name}" nrow="{rows}" ncol="{columns}" size="{size}" elevation="{data}"/>'


def terrain_geom(terrain: Terrain) -> str:
    """The ground's geom, and a plane beyond its edge where it goes on; nothing else can be touched by the robot."""
    common = 'material="ground" contype="1" conaffinity="0" priority="0"'
    if isinstance(terrain, (FlatTerrain, CourseTerrain)):
        placed = ""
        if isinstance(terrain, CourseTerrain):
            numbered = enumerate(terrain.fields)
            placed = "".join(_field_geom(f"field{i}", f, common, terrain.centre_m(i)) for i, f in numbered)
        return f'<geom name="{GROUND_GEOM}" {common} type="plane" size="0 0 0.05"/>{placed}'
    goes_on = isinstance(terrain, NoiseTerrain) and terrain.goes_on
    place = f'pos="0 0 {float(terrain.heights_m().min())!r}"'
    plane = f'<geom name="{BEYOND_GEOM}" {common} type="plane" size="0 0 0.05" {place}/>' if goes_on else ""
    return _field_geom(GROUND_GEOM, terrain, common) + plane


def _field_geom(
    name: str, field: HeightField, common: str, centre_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> str:
    x, y, z = centre_m
    place = f"{x!r} {y!r} {z + float(field.heights_m().min())!r}"
    return f'<geom name="{name}" {common} type="hfield" hfield="{name}" pos="{place}"/>'
