"""What is around the robot: level ground on which nothing stands, as maps and rays, and objects that clients draw."""

from __future__ import annotations

import contextlib
import math
import struct
from collections.abc import Callable
from typing import Any, Final

from bosdyn.api import (
    geometry_pb2,
    local_grid_pb2,
    local_grid_service_pb2,
    ray_cast_pb2,
    ray_cast_service_pb2,
    world_object_pb2,
    world_object_service_pb2,
)
from bosdyn.client.frame_helpers import (
    BODY_FRAME_NAME,
    GROUND_PLANE_FRAME_NAME,
    ODOM_FRAME_NAME,
    VISION_FRAME_NAME,
    ValidateFrameTreeError,
    get_a_tform_b,
)
from bosdyn.client.math_helpers import Quat, SE3Pose

from fake_robot.network.status import Snapshot
from fake_robot.services.calls import Service, ns_of, timestamp_from_ns
from fake_robot.services.reports.state_message import frame_tree

CELLS: Final = 128
"""Cells of a side, and the size of one: as in the maps that the vendor's SDK brings as an example."""
CELL_M: Final = 0.03

Grid = local_grid_pb2.LocalGrid
_FORMATS: Final = {
    "terrain": (Grid.CELL_FORMAT_FLOAT32, b""),
    "terrain_valid": (Grid.CELL_FORMAT_UINT8, b"\1"),
    "no_step": (Grid.CELL_FORMAT_UINT8, b"\0"),
    "obstacle_distance": (Grid.CELL_FORMAT_FLOAT32, struct.pack("<f", 0.5 * CELLS * CELL_M)),
}
"""Format and value of every cell: terrain is the ground's height in odom; no obstacle is nearer than the map's edge."""
Kind = ray_cast_pb2.RayIntersection


class GroundService(Service):
    """Maps the level ground around the robot, and casts rays on it. The robot maps no terrain and has no hand."""

    modules = (local_grid_service_pb2, ray_cast_service_pb2)

    def __init__(self, snapshot: Callable[[], Snapshot]) -> None:
        super().__init__()
        self._snapshot = snapshot

    def GetLocalGridTypes(self, request: Any, response: Any) -> None:  # noqa: N802
        """Every map."""
        for name in _FORMATS:
            response.local_grid_type.add(name=name)

    def GetLocalGrids(self, request: Any, response: Any) -> None:  # noqa: N802
        """The asked maps, centred below the body and aligned with odom."""
        snapshot = self._snapshot()
        frames = frame_tree(snapshot)
        body = get_a_tform_b(frames, ODOM_FRAME_NAME, BODY_FRAME_NAME)
        ground_m = get_a_tform_b(frames, ODOM_FRAME_NAME, GROUND_PLANE_FRAME_NAME).z
        x_m, y_m = (CELL_M * (math.floor(at / CELL_M) - CELLS // 2) for at in (body.x, body.y))
        for wanted in request.local_grid_requests:
            name = wanted.local_grid_type_name
            entry = response.local_grid_responses.add(local_grid_type_name=name)
            if name not in _FORMATS:
                entry.status = entry.STATUS_NO_SUCH_GRID
                response.num_local_grid_errors += 1
                continue
            entry.status, grid = entry.STATUS_OK, entry.local_grid
            grid.local_grid_type_name, grid.frame_name_local_grid_data = name, f"{name}_local_grid_corner"
            grid.acquisition_time.CopyFrom(timestamp_from_ns(snapshot.robot_stamp_ns))
            grid.transforms_snapshot.CopyFrom(frames)
            corner = grid.transforms_snapshot.child_to_parent_edge_map[grid.frame_name_local_grid_data]
            corner.parent_frame_name = ODOM_FRAME_NAME
            corner.parent_tform_child.CopyFrom(SE3Pose(x_m, y_m, 0.0, Quat()).to_proto())
            grid.extent.cell_size, grid.extent.num_cells_x, grid.extent.num_cells_y = CELL_M, CELLS, CELLS
            grid.cell_format, cell = _FORMATS[name]
            grid.encoding, grid.data = Grid.ENCODING_RAW, (cell or struct.pack("<f", ground_m)) * CELLS**2
            grid.cell_value_scale = 1.0

    def Raycast(self, request: Any, response: Any) -> None:  # noqa: N802
        """The hit on the ground plane, if that is asked for and the ray meets it."""
        kinds = set(request.intersection_types)
        if not kinds <= {Kind.TYPE_GROUND_PLANE, Kind.TYPE_TERRAIN_MAP, Kind.TYPE_VOXEL_MAP}:
            response.status = response.STATUS_INVALID_INTERSECTION_TYPE
            response.message = "this robot has no hand, and knows no such type"
            return
        frames = frame_tree(self._snapshot())
        frame = request.ray_frame_name or VISION_FRAME_NAME
        ground_from_frame = get_a_tform_b(frames, GROUND_PLANE_FRAME_NAME, frame)
        if ground_from_frame is None:
            response.status = response.STATUS_UNKNOWN_FRAME
            response.message = f"the robot has no frame {frame!r}"
            return
        origin, way = ((v.x, v.y, v.z) for v in (request.ray.origin, request.ray.direction))
        length = math.hypot(*way)
        if not (all(map(math.isfinite, (*origin, *way))) and length > 0.0):
            response.status = response.STATUS_INVALID_REQUEST
            response.message = "the ray's origin and direction must be finite, and the direction longer than 0"
            return
        response.status, response.hit_frame_name = response.STATUS_OK, frame
        response.transforms_snapshot.CopyFrom(frames)
        way = tuple(x / length for x in way)
        height_m = ground_from_frame.transform_point(*origin)[2]
        sinking = -ground_from_frame.rot.transform_point(*way)[2]
        if sinking == 0.0 or (kinds and Kind.TYPE_GROUND_PLANE not in kinds):
            return
        distance_m = height_m / sinking
        if distance_m >= request.min_intersection_distance:
            hit = response.hits.add(type=Kind.TYPE_GROUND_PLANE, distance_meters=distance_m)
            at = hit.hit_position_in_hit_frame
            at.x, at.y, at.z = (a + distance_m * b for a, b in zip(origin, way, strict=True))


FIRST_ID = 1

_KIND_OF_FIELD = {
    "drawable_properties": world_object_pb2.WORLD_OBJECT_DRAWABLE,
    "apriltag_properties": world_object_pb2.WORLD_OBJECT_APRILTAG,
    "tracked_entity_properties": world_object_pb2.WORLD_OBJECT_TRACKED_ENTITY,
    "image_properties": world_object_pb2.WORLD_OBJECT_IMAGE_COORDINATES,
    "dock_properties": world_object_pb2.WORLD_OBJECT_DOCK,
    "nogo_region_properties": world_object_pb2.WORLD_OBJECT_USER_NOGO,
    "staircase_properties": world_object_pb2.WORLD_OBJECT_STAIRCASE,
}


class WorldObjectService(Service):
    """Keeps the objects of all clients, numbered by the service. The robot itself perceives none.

    Every listed object bears the robot's frames beside its own.
    """

    modules = (world_object_service_pb2,)

    def __init__(self, snapshot: Callable[[], Snapshot]) -> None:
        super().__init__()
        self._snapshot = snapshot
        self._objects: dict[int, world_object_pb2.WorldObject] = {}
        self._last_id = 0

    def ListWorldObjects(self, request: Any, response: Any) -> None:  # noqa: N802
        """The objects of the asked kinds that are not older than the filter."""
        response.world_objects.extend(o for o in self._objects.values() if _is_listed(o, request))
        robots = frame_tree(self._snapshot())
        for listed in response.world_objects:
            _hang_below(listed.transforms_snapshot, robots)

    def MutateWorldObjects(self, request: Any, response: Any) -> None:  # noqa: N802
        """Add, change or delete one object."""
        mutation, wanted = request.mutation, request.mutation.object
        is_new = mutation.action == request.ACTION_ADD
        is_full = len(self._objects) >= 1024
        if mutation.action not in {request.ACTION_ADD, request.ACTION_CHANGE, request.ACTION_DELETE} or (
            is_new and (is_full or not _has_properties(wanted))
        ):
            response.status = response.STATUS_INVALID_WORLD_OBJECT
            return
        if is_new:
            self._last_id += 1
            wanted.id = self._last_id
        elif wanted.id not in self._objects:
            response.status = response.STATUS_INVALID_MUTATION_ID
            return
        if mutation.action == request.ACTION_DELETE:
            del self._objects[wanted.id]
        else:
            self._objects[wanted.id] = wanted
        response.status, response.mutated_object_id = response.STATUS_OK, wanted.id


def _hang_below(own: geometry_pb2.FrameTreeSnapshot, robots: geometry_pb2.FrameTreeSnapshot) -> None:
    """Make one tree of an object's frames and the robot's: a frame of both is where the robot says.

    What stood at the root of the object's frames hangs below the first such frame from now on. Frames that have none in
    common with the robot's remain a tree of their own, and alone.
    """
    edges, told = own.child_to_parent_edge_map, robots.child_to_parent_edge_map
    parents = {edge.parent_frame_name for edge in edges.values()}
    common = sorted((set(edges) | parents) & set(told))
    if edges and not common:
        return
    roots = [name for name in (set(edges) | parents) - set(told) - {""} if not edges[name].parent_frame_name]
    for root in roots:
        with contextlib.suppress(ValidateFrameTreeError):
            pose = get_a_tform_b(own, common[0], root, validate=False)
            if pose is not None:
                edges[root].parent_tform_child.CopyFrom(pose.to_proto())
                edges[root].parent_frame_name = common[0]
    for name, edge in told.items():
        edges[name].CopyFrom(edge)


def _has_properties(wanted: world_object_pb2.WorldObject) -> bool:
    return bool(wanted.name) or any(f.name.endswith("_properties") for f, _ in wanted.ListFields())


def _is_listed(candidate: world_object_pb2.WorldObject, request: world_object_pb2.ListWorldObjectRequest) -> bool:
    if request.HasField("timestamp_filter"):
        stamp_ns = ns_of(candidate.acquisition_time)
        if stamp_ns < ns_of(request.timestamp_filter):
            return False
    kinds = {_KIND_OF_FIELD.get(f.name, world_object_pb2.WORLD_OBJECT_UNKNOWN) for f, _ in candidate.ListFields()}
    return not request.object_type or bool(kinds & set(request.object_type))
