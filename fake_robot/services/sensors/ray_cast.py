"""RayCastService: where a ray meets the ground that the robot stands on. It maps no terrain and has no hand."""

from __future__ import annotations

import math

from bosdyn.api import ray_cast_pb2
from bosdyn.client.frame_helpers import GROUND_PLANE_FRAME_NAME, VISION_FRAME_NAME, get_a_tform_b

from fake_robot.services.calls.unary import Call
from fake_robot.services.reports.robot_state_message import frame_tree

Kind = ray_cast_pb2.RayIntersection


def cast_ray(call: Call) -> None:
    """Answer a ``RaycastRequest``: the hit on the ground plane, if that is asked for and the ray meets it."""
    request, response = call.request, call.response
    kinds = set(request.intersection_types)
    if not kinds <= {Kind.TYPE_GROUND_PLANE, Kind.TYPE_TERRAIN_MAP, Kind.TYPE_VOXEL_MAP}:
        response.status = response.STATUS_INVALID_INTERSECTION_TYPE
        response.message = "this robot has no hand, and knows no such type"
        return
    frames = frame_tree(call.world.robot.snapshot())
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
