"""Checks of what the robot says of itself and of the world, and of the services that only answer."""

from __future__ import annotations

from itertools import pairwise

from bosdyn.api import robot_state_pb2, robot_state_service_pb2_grpc
from bosdyn.client.frame_helpers import ValidateFrameTreeError, get_odom_tform_body

from fake_robot.conformance.check import Basis, check
from fake_robot.conformance.server import RPC_TIMEOUT_S, Server, enum_name, header, status_of

_N_STATES = 200
_N_JOINTS, _N_ARM_JOINTS = 12, 19
_FRAMES = ("odom", "vision", "body", "flat_body", "gpe")
"""Of a robot at rest. Source: frame_helpers of the SDK."""
_RECORDING = "a published recording of a robot"


def states(server: Server) -> list[robot_state_pb2.RobotStateStreamResponse]:
    """A short piece of the state stream."""
    stub = server.stub(robot_state_service_pb2_grpc.RobotStateStreamingServiceStub, "robot-state-streaming")
    call = stub.GetRobotStateStream(robot_state_pb2.RobotStateStreamRequest(header=header()), timeout=RPC_TIMEOUT_S)
    found = []
    for state in call:
        found.append(state)
        if len(found) == _N_STATES:
            break
    call.cancel()
    return found


@check("GetRobotStateStream: joint_states", "200 messages", "complete", source="robot_state.proto")
def stream_is_complete(server: Server) -> str:
    """Each message has as many positions, velocities and loads as joints, four feet and both odometry frames."""
    for state in states(server):
        joints = state.joint_states
        sizes = {len(joints.position), len(joints.velocity), len(joints.load)}
        if not (sizes <= {_N_JOINTS} or sizes <= {_N_ARM_JOINTS}):
            return f"joints: {sorted(sizes)}"
        if len(state.contact_states) != 4:
            return f"feet: {len(state.contact_states)}"
        if not (
            state.kinematic_state.HasField("odom_tform_body") and state.kinematic_state.HasField("vision_tform_body")
        ):
            return "a frame is missing"
    return "complete"


@check("GetRobotStateStream: acquisition_timestamp", "200 messages", "rising", source="robot_state.proto")
def stream_stamps_rise(server: Server) -> str:
    """The joints' stamps rise, and those of the headers do not fall."""
    seen = states(server)
    joints = [state.joint_states.acquisition_timestamp.ToNanoseconds() for state in seen]
    headers = [state.header.response_timestamp.ToNanoseconds() for state in seen]
    is_rising = all(a < b for a, b in pairwise(joints))
    return "rising" if is_rising and headers == sorted(headers) else "a stamp goes back or stays"


@check("GetRobotStateStream", "200 messages", "3 ms apart", basis=Basis.MEASURED, source=_RECORDING)
def stream_period(server: Server) -> str:
    """The median distance of two stamps, to a hundredth."""
    stamps = [state.joint_states.acquisition_timestamp.ToNanoseconds() for state in states(server)]
    steps = sorted(b - a for a, b in pairwise(stamps))
    return f"{round(steps[len(steps) // 2] / 1e6, 2):g} ms apart"


@check("GetRobotStateStream: inertial_state", "200 messages", "3 packets", basis=Basis.MEASURED, source=_RECORDING)
def stream_imu(server: Server) -> str:
    """Samples of the inertial unit in each message."""
    counts = {len(state.inertial_state.packets) for state in states(server)}
    return f"{counts.pop()} packets" if len(counts) == 1 else f"{sorted(counts)} packets"


@check("RobotState.GetRobotState", "", "complete", source="robot_state.proto")
def polled_state_is_complete(server: Server) -> str:
    """Power, battery, e-stops, joints, frames and feet."""
    state = server.state()
    frames = state.kinematic_state.transforms_snapshot.child_to_parent_edge_map
    missing = [
        name
        for name, is_there in {
            "motor power": state.power_state.motor_power_state,
            "batteries": len(state.battery_states),
            "e-stops": len(state.estop_states),
            "joints": len(state.kinematic_state.joint_states) >= _N_JOINTS,
            **{name: name in frames for name in _FRAMES},
            "feet": len(state.foot_state) == 4,
        }.items()
        if not is_there
    ]
    return f"missing: {', '.join(missing)}" if missing else "complete"


@check(
    "RobotState.GetRobotLinkModel: link_name",
    "an unknown link",
    "CODE_INVALID_REQUEST",
    basis=Basis.GUESS,
    source="header.proto",
)
def unknown_link(server: Server) -> str:
    """Ask for the shape of an unknown link."""
    return enum_name(server.ask("robot-state", "GetRobotLinkModel", link_name="no-such-link").header.error, "code")


@check(
    "Fault.ClearServiceFault: fault_id",
    "a fault that is not active",
    "STATUS_FAULT_NOT_ACTIVE",
    source="service_fault.proto",
)
def clear_unknown_service_fault(server: Server) -> str:
    """Clear an unknown service fault."""
    unknown = {"fault_name": "no-such-fault", "service_name": "no-such-service"}
    return status_of(server.ask("fault", "ClearServiceFault", fault_id=unknown))


@check(
    "Fault.TriggerServiceFault: fault",
    "a fault that is active",
    "STATUS_FAULT_ALREADY_ACTIVE",
    source="service_fault.proto",
)
def trigger_twice(server: Server) -> str:
    """Raise an informative fault twice, and clear it."""
    identity = {"fault_name": "conformance", "service_name": "spot-rl-conformance"}
    fault = {"fault_id": identity, "severity": "SEVERITY_INFO"}
    server.ask("fault", "TriggerServiceFault", fault=fault)
    try:
        return status_of(server.ask("fault", "TriggerServiceFault", fault=fault))
    finally:
        server.ask("fault", "ClearServiceFault", fault_id=identity)


@check("Image.GetImage: image_source_name", "an unknown camera", "STATUS_UNKNOWN_CAMERA", source="image.proto")
def unknown_camera(server: Server) -> str:
    """Ask an unknown camera for an image."""
    answer = server.ask("image", "GetImage", image_requests=[{"image_source_name": "no-such-camera"}])
    return status_of(answer.image_responses[0])


@check(
    "WorldObject.MutateWorldObjects: object.id",
    "an unknown number",
    "STATUS_INVALID_MUTATION_ID",
    source="world_object.proto",
)
def delete_unknown_object(server: Server) -> str:
    """Delete an unknown object."""
    mutation = {"action": "ACTION_DELETE", "object": {"id": 0x7FFFFFF0}}
    return status_of(server.ask("world-objects", "MutateWorldObjects", mutation=mutation))


@check("Mission.GetState", "no mission loaded", ("STATUS_NONE",), source="mission.proto")
def no_mission(server: Server) -> str:
    """The state of a mission that was never loaded."""
    return status_of(server.ask("robot-mission", "GetState").state)


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
