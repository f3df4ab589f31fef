"""Checks of what answers bear beside their status: identifiers, units, times and frames that clients rely on."""

from __future__ import annotations

from typing import Any

import grpc
from bosdyn.api import header_pb2, lease_pb2, local_grid_pb2, service_fault_pb2
from bosdyn.client.frame_helpers import BODY_FRAME_NAME, ODOM_FRAME_NAME, get_a_tform_b

from fake_robot.conformance.check import check
from fake_robot.conformance.reports import states
from fake_robot.conformance.server import Server, SkippedError

_CELSIUS = (-40.0, 150.0)
_NEAR_NS = 5 * 10**9
_READS = (
    ("directory", "ListServiceEntries"),
    ("estop", "GetEstopConfig"),
    ("estop", "GetEstopSystemStatus"),
    ("lease", "ListLeases"),
    ("robot-id", "GetRobotId"),
    ("robot-state", "GetRobotHardwareConfiguration"),
    ("robot-state", "GetRobotMetrics"),
    ("robot-state", "GetRobotState"),
)
_OTHERS_LEASE = lease_pb2.Lease(resource="body", epoch="no-such-epoch", sequence=[3, 1])
_TRIAL = service_fault_pb2.ServiceFaultId(fault_name="trial", service_name="spot-rl-conformance-trial")
_BYTES = {
    local_grid_pb2.LocalGrid.CELL_FORMAT_FLOAT32: 4,
    local_grid_pb2.LocalGrid.CELL_FORMAT_FLOAT64: 8,
    local_grid_pb2.LocalGrid.CELL_FORMAT_INT8: 1,
    local_grid_pb2.LocalGrid.CELL_FORMAT_UINT8: 1,
    local_grid_pb2.LocalGrid.CELL_FORMAT_INT16: 2,
    local_grid_pb2.LocalGrid.CELL_FORMAT_UINT16: 2,
}


@check("calls that read: header.error.code", "", "CODE_OK", source="header.proto")
def reads_succeed(server: Server) -> str:
    """An answer without a code is an error to the SDK."""
    for service, method in _READS:
        code = server.ask(service, method).header.error.code
        if code != header_pb2.CommonError.CODE_OK:
            return f"{method}: {header_pb2.CommonError.Code.Name(code)}"
    return "CODE_OK"


@check("Directory.ListServiceEntries: user_token_required", "robot-state", "as asked", source="directory.proto")
def token_is_asked_for_as_listed(server: Server) -> str:
    """A service of which the directory says that it needs no token answers without one, and no other does."""
    entry = next(e for e in server.robot.ensure_client("directory").list() if e.name == "robot-state")
    try:
        server.ask("robot-state", "GetRobotState", stranger_at=entry.authority)
        is_needed = False
    except grpc.RpcError as error:
        is_needed = error.code() == grpc.StatusCode.UNAUTHENTICATED
    if is_needed == entry.user_token_required:
        return "as asked"
    return "listed as needed, not asked for" if entry.user_token_required else "asked for, not listed as needed"


@check("Lease.ListLeases: resource_tree", "", "body over mobility", source="lease.proto: resource_tree")
def leases_form_a_tree(server: Server) -> str:
    """The tree says which leases a lease contains."""

    def names(resource: Any) -> set[str]:
        return {resource.resource}.union(*(names(part) for part in resource.sub_resources))

    def find(resource: Any) -> Any:
        found = [resource] if resource.resource == "body" else [find(part) for part in resource.sub_resources]
        return next(filter(None, found), None)

    body = find(server.ask("lease", "ListLeases").resource_tree)
    return "body over mobility" if body is not None and "mobility" in names(body) else "no such tree"


@check("commands: lease_use_result.attempted_lease", "a lease", "the same lease", source="lease.proto")
def attempted_lease_is_told(server: Server) -> str:
    """A lease that is refused comes back, so that a client with several knows which one it was."""
    answer = server.ask("robot-command", "ClearBehaviorFault", lease=_OTHERS_LEASE, behavior_fault_id=0xFFFFFFF0)
    attempted = answer.lease_use_result.attempted_lease
    is_same = (attempted.resource, attempted.epoch, list(attempted.sequence)) == ("body", "no-such-epoch", [3, 1])
    return "the same lease" if is_same else "another, or none"


@check("Estop.GetEstopConfig, GetEstopSystemStatus", "", "the same endpoints", source="estop.proto")
def estop_endpoints_agree(server: Server) -> str:
    """The configuration has an identifier, and the status speaks of its endpoints."""
    config = server.ask("estop", "GetEstopConfig").active_config
    status = server.ask("estop", "GetEstopSystemStatus").status
    if config.endpoints and not config.unique_id:
        return "the configuration has no identifier"
    configured, told = {e.unique_id for e in config.endpoints}, {e.endpoint.unique_id for e in status.endpoints}
    return "the same endpoints" if configured == told else f"configured {len(configured)}, told of {len(told)}"


@check("RobotState.GetRobotState: motor_temperatures", "", "in Celsius", source="robot_state.proto")
def temperatures_are_in_celsius(server: Server) -> str:
    """Each motor is as warm as a motor can be."""
    told = {motor.name: motor.temperature for motor in server.state().system_state.motor_temperatures}
    if not told:
        raise SkippedError("the robot reports no temperatures")
    low, high = _CELSIUS
    wrong = [f"{name} {value:.0f}" for name, value in told.items() if not low <= value <= high]
    return ", ".join(wrong) or "in Celsius"


@check("GetRobotStateStream: last_command", "200 messages", "a key and its time, or none", source="robot_state.proto")
def last_command_has_a_time(server: Server) -> str:
    """A command that was received was received at an instant."""
    for state in states(server):
        last = state.last_command
        if bool(last.user_command_key) != bool(last.received_timestamp.ToNanoseconds()):
            return f"key {last.user_command_key}, received at {last.received_timestamp.ToNanoseconds() * 1e-9:.1f} s"
    return "a key and its time, or none"


@check("Fault.TriggerServiceFault", "a fault, then its end", "reported, then gone", source="service_fault.proto")
def service_fault_is_reported(server: Server) -> str:
    """A client's fault stands in the robot's state until it is cleared."""

    def is_reported() -> bool:
        return _TRIAL.fault_name in {f.fault_id.fault_name for f in server.state().service_fault_state.faults}

    server.require("fault")
    client = server.robot.ensure_client("fault")
    client.trigger_service_fault(service_fault_pb2.ServiceFault(fault_id=_TRIAL))
    try:
        was_reported = is_reported()
    finally:
        client.clear_service_fault(_TRIAL)
    if not was_reported:
        return "not reported"
    return "still reported" if is_reported() else "reported, then gone"


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
