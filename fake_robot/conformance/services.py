"""Checks of the services beside control: what was put in comes out, what was taken back is gone, figures have their units."""

from __future__ import annotations

import re
from typing import Any

from bosdyn.api import image_pb2, local_grid_pb2, service_fault_pb2, world_object_pb2
from bosdyn.client.frame_helpers import (
    BODY_FRAME_NAME,
    ODOM_FRAME_NAME,
    ValidateFrameTreeError,
    get_a_tform_b,
    get_odom_tform_body,
)

from fake_robot.conformance.check import check
from fake_robot.conformance.server import Server, SkippedError, stamp_ns, status_of
from spot_model.robot.facts import JOINT_NAMES

_KEPT = "listed, then gone"
_TRIAL = "spot-rl-conformance-trial"
_NEAR_NS = 5 * 10**9
_FAULT = service_fault_pb2.ServiceFault(
    fault_id=service_fault_pb2.ServiceFaultId(fault_name=_TRIAL, service_name=_TRIAL),
    severity=service_fault_pb2.ServiceFault.SEVERITY_INFO,
)
_URDF_LINK = re.compile(r"""<link\s[^>]*?name=["']([^"']+)["']""")
_BYTES = {
    local_grid_pb2.LocalGrid.CELL_FORMAT_FLOAT32: 4,
    local_grid_pb2.LocalGrid.CELL_FORMAT_FLOAT64: 8,
    local_grid_pb2.LocalGrid.CELL_FORMAT_INT8: 1,
    local_grid_pb2.LocalGrid.CELL_FORMAT_UINT8: 1,
    local_grid_pb2.LocalGrid.CELL_FORMAT_INT16: 2,
    local_grid_pb2.LocalGrid.CELL_FORMAT_UINT16: 2,
}


@check("DirectoryRegistration", "a service, then nothing", _KEPT, source="directory_registration.proto")
def registration_is_kept(server: Server) -> str:
    """Register a service of nothing, and unregister it."""
    server.require("directory-registration")
    client, directory = server.robot.ensure_client("directory-registration"), server.robot.ensure_client("directory")
    client.register(_TRIAL, "spot_rl.NoService", "no-service.spot.robot", "127.0.0.1", 1)
    try:
        was_listed = _TRIAL in {entry.name for entry in directory.list()}
    finally:
        client.unregister(_TRIAL)
    return _kept(was_listed, _TRIAL in {entry.name for entry in directory.list()})


@check("WorldObject.MutateWorldObjects", "an object, then its deletion", _KEPT, source="world_object.proto")
def world_object_is_kept(server: Server) -> str:
    """Draw a frame in odom, and delete it."""

    def mutate(action: str, thing: world_object_pb2.WorldObject) -> int:
        mutation = {"action": action, "object": thing}
        return int(server.ask("world-objects", "MutateWorldObjects", mutation=mutation).mutated_object_id)

    def is_listed() -> bool:
        objects = server.robot.ensure_client("world-objects").list_world_objects().world_objects
        return thing.id in {int(listed.id) for listed in objects}

    thing = world_object_pb2.WorldObject(name=_TRIAL, acquisition_time=server.robot_stamp(0.0))
    drawn = thing.drawable_properties.add(frame_name_drawable="odom")
    drawn.frame.arrow_length, drawn.frame.arrow_radius, drawn.color.a = 0.1, 0.01, 1.0
    thing.id = mutate("ACTION_ADD", thing)
    try:
        was_listed = is_listed()
    finally:
        mutate("ACTION_DELETE", thing)
    return _kept(was_listed, is_listed())


def _kept(was_listed: bool, is_listed: bool) -> str:
    if not was_listed:
        return "not listed"
    return "still listed" if is_listed else _KEPT


@check(
    "Fault.TriggerServiceFault", "a fault twice, then its end", "reported once, then gone", source="service_fault.proto"
)
def service_fault_is_reported(server: Server) -> str:
    """A client's fault stands in the robot's state, since now, until it is cleared; raised again, it is active already."""

    def reported() -> list[Any]:
        faults = server.state().service_fault_state.faults
        return [fault for fault in faults if fault.fault_id == _FAULT.fault_id]

    server.ask("fault", "TriggerServiceFault", fault=_FAULT)
    try:
        again, during = server.ask("fault", "TriggerServiceFault", fault=_FAULT), reported()
    finally:
        server.ask("fault", "ClearServiceFault", fault_id=_FAULT.fault_id)
    if len(during) != 1:
        return f"reported {len(during)} times"
    if abs(stamp_ns(during[0].onset_timestamp) - stamp_ns(server.robot_stamp(0.0))) > _NEAR_NS:
        return "since another time"
    if status_of(again) != "STATUS_FAULT_ALREADY_ACTIVE":
        return f"raised again: {status_of(again)}"
    return "still reported" if reported() else "reported once, then gone"


@check("RobotState.GetRobotHardwareConfiguration", "", "links of every joint", source="robot_state.proto: skeleton")
def skeleton_has_the_legs(server: Server) -> str:
    """The skeleton has a body and a link behind each joint, under the names that its URDF uses."""
    skeleton = server.ask("robot-state", "GetRobotHardwareConfiguration").hardware_configuration.skeleton
    links = {link.name for link in skeleton.links}
    if len(links) <= len(JOINT_NAMES):
        return f"{len(links)} links"
    unknown = links - set(_URDF_LINK.findall(skeleton.urdf))
    return f"not in the URDF: {', '.join(sorted(unknown))}" if unknown else "links of every joint"


@check("GraphNav.GetLocalizationState", "no map loaded", "no waypoint", source="graph_nav.proto")
def no_localization(server: Server) -> str:
    """Where the robot is on a map that it has not."""
    answer = server.ask("graph-nav-service", "GetLocalizationState")
    return "a waypoint" if answer.localization.waypoint_id else "no waypoint"


@check("GraphNav.GetLocalizationState: robot_kinematics", "", "body in odom", source="graph_nav.proto")
def localization_tells_kinematics(server: Server) -> str:
    """Programs look for the body in odom there, on a map or not."""
    kinematics = server.ask("graph-nav-service", "GetLocalizationState").robot_kinematics
    try:
        return "body in odom" if get_odom_tform_body(kinematics.transforms_snapshot) else "no odom"
    except ValidateFrameTreeError as error:
        return str(error)


@check(
    "Docking.GetDockingState",
    "a robot that is not docked",
    ("DOCK_STATUS_UNDOCKED", "DOCK_STATUS_DOCKED"),
    source="docking.proto",
)
def docking_state(server: Server) -> str:
    """Whether the robot is docked."""
    return status_of(server.ask("docking", "GetDockingState").dock_state)


@check("Image.GetImage", "the first source", "as large as it says", source="image.proto")
def image_is_as_large_as_its_source(server: Server) -> str:
    """A raw image has rows, columns and bytes as its source says."""
    client: Any = server.robot.ensure_client("image")
    sources = [s for s in client.list_image_sources() if image_pb2.Image.FORMAT_RAW in s.image_formats]
    if not sources:
        raise SkippedError("no source has raw images")
    source = next((s for s in sources if s.image_type == s.IMAGE_TYPE_DEPTH), sources[0])
    shot = client.get_image(
        [image_pb2.ImageRequest(image_source_name=source.name, image_format=image_pb2.Image.FORMAT_RAW)]
    )[0]
    image, edges = shot.shot.image, shot.shot.transforms_snapshot.child_to_parent_edge_map
    if (image.cols, image.rows) != (source.cols, source.rows):
        return f"{image.cols} by {image.rows}, source {source.cols} by {source.rows}"
    if source.image_type == source.IMAGE_TYPE_DEPTH and len(image.data) != 2 * image.cols * image.rows:
        return f"{len(image.data)} bytes"
    return "as large as it says" if shot.shot.frame_name_image_sensor in edges else "its sensor has no frame"


@check("Image.GetImage: shot", "each source", "when and from where", source="image.proto")
def images_tell_when_and_where(server: Server) -> str:
    """Each image has a time of the robot's clock, a sensor that hangs together with the body, and a focal length."""
    server.require("image")
    client = server.robot.ensure_client("image")
    sources = [source.name for source in client.list_image_sources()]
    asked_ns = server.robot_stamp(0.0).ToNanoseconds()
    answers = client.get_image_from_sources(sources)
    answered_ns = server.robot_stamp(0.0).ToNanoseconds()
    for answer in answers:
        shot, name = answer.shot, answer.source.name
        if not asked_ns - _NEAR_NS <= shot.acquisition_time.ToNanoseconds() <= answered_ns + _NEAR_NS:
            return f"{name}: taken at another time"
        if get_a_tform_b(shot.transforms_snapshot, BODY_FRAME_NAME, shot.frame_name_image_sensor) is None:
            return f"{name}: its sensor has no frame"
        if answer.source.HasField("pinhole") and answer.source.pinhole.intrinsics.focal_length.x <= 0.0:
            return f"{name}: no focal length"
    return "when and from where"


@check("LocalGrid.GetLocalGrids", "each type", "as many cells as it says, somewhere", source="local_grid.proto")
def grids_have_their_cells(server: Server) -> str:
    """The data of a grid fill its extent, and its corner hangs together with odom."""
    server.require("local-grid-service")
    client = server.robot.ensure_client("local-grid-service")
    names = [listed.name for listed in client.get_local_grid_types()]
    for answer in client.get_local_grids(names):
        grid, name = answer.local_grid, answer.local_grid_type_name
        cells = len(grid.data) / _BYTES.get(grid.cell_format, 1)
        if grid.encoding == grid.ENCODING_RLE:
            cells = sum(grid.rle_counts) if len(grid.rle_counts) == cells else -1
        if cells != grid.extent.num_cells_x * grid.extent.num_cells_y:
            return f"{name}: {cells:g} cells of {grid.extent.num_cells_x} by {grid.extent.num_cells_y}"
        if get_a_tform_b(grid.transforms_snapshot, ODOM_FRAME_NAME, grid.frame_name_local_grid_data) is None:
            return f"{name}: its corner has no frame"
    return "as many cells as it says, somewhere"
