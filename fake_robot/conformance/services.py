"""Checks of the services beside control: what is put in comes out, what is taken back is gone."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from bosdyn.api import service_fault_pb2, world_object_pb2

from fake_robot.conformance.check import check
from fake_robot.conformance.recording import pose_in
from fake_robot.conformance.server import Server, enum_name, stamp_ns, status_of
from spot_model.robot.facts import JOINT_NAMES

_KEPT = "listed, then gone"
_TRIAL = "spot-rl-conformance-trial"
_NEAR_NS = 5 * 10**9
_FAULT = service_fault_pb2.ServiceFault(
    fault_id=service_fault_pb2.ServiceFaultId(fault_name=_TRIAL, service_name=_TRIAL),
    severity=service_fault_pb2.ServiceFault.SEVERITY_INFO,
)
_URDF_LINK = re.compile(r"""<link\s[^>]*?name=["']([^"']+)["']""")
_BYTES = {"FLOAT32": 4, "FLOAT64": 8, "INT8": 1, "UINT8": 1, "INT16": 2, "UINT16": 2}


def _kept(put: Callable[[], object], listed: Callable[[], int], take: Callable[[], object]) -> str:
    """Put something in, look for it, take it out, look again."""
    put()
    try:
        during = listed()
    finally:
        take()
    after = listed()
    return _KEPT if (during, after) == (1, 0) else f"listed {during} times, then {after}"


@check("directory-registration", "a service, then nothing", _KEPT, source="directory_registration.proto")
def registration_is_kept(server: Server) -> str:
    """Register a service of nothing, and unregister it."""
    entry = {"name": _TRIAL, "type": "spot_rl.NoService", "authority": "no-service.spot.robot"}
    at = {"host_ip": "127.0.0.1", "port": 1}
    register, unregister = "RegisterService", "UnregisterService"
    return _kept(
        lambda: server.ask("directory-registration", register, endpoint=at, service_entry=entry),
        lambda: [e.name for e in server.ask("directory", "ListServiceEntries").service_entries].count(_TRIAL),
        lambda: server.ask("directory-registration", unregister, service_name=_TRIAL),
    )


@check("world-objects", "an object, then its deletion", _KEPT, source="world_object.proto")
def world_object_is_kept(server: Server) -> str:
    """Draw a frame in odom, and delete it."""
    thing = world_object_pb2.WorldObject(name=_TRIAL, acquisition_time=server.robot_stamp(0.0))
    drawn = thing.drawable_properties.add(frame_name_drawable="odom")
    drawn.frame.arrow_length, drawn.frame.arrow_radius, drawn.color.a = 0.1, 0.01, 1.0

    def mutate(action: str) -> None:
        mutation = {"action": action, "object": thing}
        thing.id = server.ask("world-objects", "MutateWorldObjects", mutation=mutation).mutated_object_id

    return _kept(
        lambda: mutate("ACTION_ADD"),
        lambda: [o.name for o in server.ask("world-objects", "ListWorldObjects").world_objects].count(_TRIAL),
        lambda: mutate("ACTION_DELETE"),
    )


@check("fault", "a fault twice, then its end", _KEPT, source="service_fault.proto")
def service_fault_is_kept(server: Server) -> str:
    """A client's fault stands in the robot's state, since now, until it is cleared; it is raised but once."""
    told: list[Any] = []

    def reported() -> int:
        told.append([f for f in server.state().service_fault_state.faults if f.fault_id == _FAULT.fault_id])
        return len(told[-1])

    def trigger() -> str:
        return status_of(server.ask("fault", "TriggerServiceFault", fault=_FAULT))

    again: list[str] = []
    clear = {"fault_id": _FAULT.fault_id}
    seen = _kept(
        lambda: again.extend([trigger(), trigger()]),
        reported,
        lambda: server.ask("fault", "ClearServiceFault", **clear),
    )
    if seen == _KEPT and abs(stamp_ns(told[0][0].onset_timestamp) - stamp_ns(server.robot_stamp(0.0))) > _NEAR_NS:
        return "since another time"
    return seen if again[1] == "STATUS_FAULT_ALREADY_ACTIVE" else f"raised again: {again[1]}"


@check("robot-state.GetRobotHardwareConfiguration", "", "links of every joint", source="robot_state.proto")
def skeleton_has_the_legs(server: Server) -> str:
    """The skeleton has a body and a link behind each joint, under the names that its URDF uses."""
    skeleton = server.ask("robot-state", "GetRobotHardwareConfiguration").hardware_configuration.skeleton
    links = {link.name for link in skeleton.links}
    if len(links) <= len(JOINT_NAMES):
        return f"{len(links)} links"
    unknown = links - set(_URDF_LINK.findall(skeleton.urdf))
    return f"not in the URDF: {', '.join(sorted(unknown))}" if unknown else "links of every joint"


@check("graph-nav-service.GetLocalizationState", "no map loaded", "body in odom, no waypoint", source="graph_nav.proto")
def localization_tells_kinematics(server: Server) -> str:
    """Programs look for the body in odom there, on a map or not."""
    answer = server.ask("graph-nav-service", "GetLocalizationState")
    if answer.localization.waypoint_id:
        return f"waypoint {answer.localization.waypoint_id}"
    found = pose_in(answer.robot_kinematics.transforms_snapshot, "odom", "body")
    return "no odom" if found is None else "body in odom, no waypoint"


@check("image.GetImage", "each source", "when, from where and how large", source="image.proto")
def images_are_as_told(server: Server) -> str:
    """Each image has a time of the robot's clock, a frame that hangs together with the body, its source's size."""
    for source in server.ask("image", "ListImageSources").image_sources:
        asked_ns = stamp_ns(server.robot_stamp(0.0))
        answer = server.ask("image", "GetImage", image_requests=[{"image_source_name": source.name}])
        answered_ns = stamp_ns(server.robot_stamp(0.0))
        (told,) = answer.image_responses
        shot = told.shot
        if not asked_ns - _NEAR_NS <= stamp_ns(shot.acquisition_time) <= answered_ns + _NEAR_NS:
            return f"{source.name}: taken at another time"
        if pose_in(shot.transforms_snapshot, "body", shot.frame_name_image_sensor) is None:
            return f"{source.name}: its sensor has no frame"
        if told.source.HasField("pinhole") and told.source.pinhole.intrinsics.focal_length.x <= 0.0:
            return f"{source.name}: no focal length"
        image = shot.image
        if (image.cols, image.rows) != (source.cols, source.rows):
            return f"{source.name}: {image.cols} by {image.rows}, listed {source.cols} by {source.rows}"
        is_raw_depth = source.image_type == source.IMAGE_TYPE_DEPTH and image.format == image.FORMAT_RAW
        if is_raw_depth and len(image.data) != 2 * image.cols * image.rows:
            return f"{source.name}: {len(image.data)} bytes"
    return "when, from where and how large"


@check("local-grid-service.GetLocalGrids", "each type", "as many cells as told, somewhere", source="local_grid.proto")
def grids_have_their_cells(server: Server) -> str:
    """The data of a grid fill its extent, and its corner hangs together with odom."""
    types = server.ask("local-grid-service", "GetLocalGridTypes").local_grid_type
    wanted = [{"local_grid_type_name": listed.name} for listed in types]
    for answer in server.ask("local-grid-service", "GetLocalGrids", local_grid_requests=wanted).local_grid_responses:
        grid, name = answer.local_grid, answer.local_grid_type_name
        cells = len(grid.data) / _BYTES.get(enum_name(grid, "cell_format").removeprefix("CELL_FORMAT_"), 1)
        if grid.encoding == grid.ENCODING_RLE:
            cells = sum(grid.rle_counts) if len(grid.rle_counts) == cells else -1
        if cells != grid.extent.num_cells_x * grid.extent.num_cells_y:
            return f"{name}: {cells:g} cells of {grid.extent.num_cells_x} by {grid.extent.num_cells_y}"
        if pose_in(grid.transforms_snapshot, "odom", grid.frame_name_local_grid_data) is None:
            return f"{name}: its corner has no frame"
    return "as many cells as told, somewhere"
