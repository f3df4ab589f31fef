"""WorldObjectService: objects that clients draw, change and delete. The robot itself perceives none."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from typing import Any

from bosdyn.api import geometry_pb2, world_object_pb2
from bosdyn.client.frame_helpers import ValidateFrameTreeError, get_a_tform_b

from fake_robot.network.status import Snapshot
from fake_robot.services.calls.stamps import ns_from_timestamp
from fake_robot.services.reports.robot_state_message import frame_tree

MAX_OBJECTS = 1024
FIRST_ID = 1

Request = world_object_pb2.MutateWorldObjectRequest
Response = world_object_pb2.MutateWorldObjectResponse
_KIND_OF_FIELD = {
    "drawable_properties": world_object_pb2.WORLD_OBJECT_DRAWABLE,
    "apriltag_properties": world_object_pb2.WORLD_OBJECT_APRILTAG,
    "tracked_entity_properties": world_object_pb2.WORLD_OBJECT_TRACKED_ENTITY,
    "image_properties": world_object_pb2.WORLD_OBJECT_IMAGE_COORDINATES,
    "dock_properties": world_object_pb2.WORLD_OBJECT_DOCK,
    "nogo_region_properties": world_object_pb2.WORLD_OBJECT_USER_NOGO,
    "staircase_properties": world_object_pb2.WORLD_OBJECT_STAIRCASE,
}


class WorldObjectService:
    """Keeps the objects of all clients, numbered by the service.

    Args:
        snapshot: Gives the robot's frames, which every listed object bears beside its own.
    """

    def __init__(self, snapshot: Callable[[], Snapshot]) -> None:
        self._snapshot = snapshot
        self._objects: dict[int, world_object_pb2.WorldObject] = {}
        self._next_id = FIRST_ID
        self._lock = threading.Lock()

    def ListWorldObjects(self, request: Any) -> Any:  # noqa: N802
        """The objects of the asked kinds that are not older than the filter."""
        with self._lock:
            chosen = [o for o in self._objects.values() if _matches(o, request)]
            response = world_object_pb2.ListWorldObjectResponse(world_objects=chosen)
        robots = frame_tree(self._snapshot())
        for listed in response.world_objects:
            _hang_below(listed.transforms_snapshot, robots)
        return response

    def MutateWorldObjects(self, request: Any) -> Any:  # noqa: N802
        """Add, change or delete one object."""
        action, wanted = request.mutation.action, request.mutation.object
        with self._lock:
            if action == Request.ACTION_ADD:
                if len(self._objects) >= MAX_OBJECTS or not _has_properties(wanted):
                    return Response(status=Response.STATUS_INVALID_WORLD_OBJECT)
                number = self._next_id
                self._next_id += 1
            elif action in {Request.ACTION_CHANGE, Request.ACTION_DELETE}:
                number = wanted.id
                if number not in self._objects:
                    return Response(status=Response.STATUS_INVALID_MUTATION_ID)
            else:
                return Response(status=Response.STATUS_INVALID_WORLD_OBJECT)
            if action == Request.ACTION_DELETE:
                del self._objects[number]
            else:
                kept = world_object_pb2.WorldObject()
                kept.CopyFrom(wanted)
                kept.id = number
                self._objects[number] = kept
        return Response(status=Response.STATUS_OK, mutated_object_id=number)


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


def _matches(candidate: world_object_pb2.WorldObject, request: world_object_pb2.ListWorldObjectRequest) -> bool:
    if request.HasField("timestamp_filter"):
        stamp_ns = ns_from_timestamp(candidate.acquisition_time)
        if stamp_ns < ns_from_timestamp(request.timestamp_filter):
            return False
    kinds = {_KIND_OF_FIELD.get(f.name, world_object_pb2.WORLD_OBJECT_UNKNOWN) for f, _ in candidate.ListFields()}
    return not request.object_type or bool(kinds & set(request.object_type))
