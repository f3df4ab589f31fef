"""Every call of the SDK's clients that a base Spot without arm can answer, in its sync and its async form."""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Callable, Iterator
from concurrent import futures
from typing import Any

import grpc
import mujoco
import pytest
from bosdyn.api import data_buffer_pb2, data_index_pb2, payload_pb2, power_pb2, ray_cast_pb2, service_fault_pb2
from bosdyn.api.data_acquisition_pb2 import AcquisitionRequestList, DataCapture, ImageSourceCapture
from bosdyn.api.data_acquisition_store_pb2 import DataQueryParams
from bosdyn.api.image_pb2 import ImageRequest
from bosdyn.api.keepalive import keepalive_pb2
from bosdyn.api.log_status.log_status_pb2 import LogStatus
from bosdyn.api.mission import remote_pb2, remote_service_pb2_grpc
from bosdyn.api.spot.inverse_kinematics_pb2 import InverseKinematicsRequest
from bosdyn.api.world_object_pb2 import MutateWorldObjectRequest, WorldObject
from bosdyn.client import ray_cast
from bosdyn.client.data_acquisition import CancellationFailedError, UnknownCaptureTypeError
from bosdyn.client.data_acquisition import RequestIdDoesNotExistError as NoSuchRequestError
from bosdyn.client.data_buffer import DataBufferClient
from bosdyn.client.data_service import DataServiceClient
from bosdyn.client.directory import DirectoryClient, NonexistentServiceError
from bosdyn.client.directory_registration import DirectoryRegistrationClient, ServiceAlreadyExistsError
from bosdyn.client.docking import DockingClient
from bosdyn.client.exceptions import InvalidRequestError, UnimplementedError
from bosdyn.client.fault import FaultClient, ServiceFaultAlreadyExistsError, ServiceFaultDoesNotExistError
from bosdyn.client.frame_helpers import get_a_tform_b, validate_frame_tree_snapshot
from bosdyn.client.keepalive import InvalidPolicyError, KeepaliveClient, Policy, PolicyKeepalive
from bosdyn.client.license import LicenseClient
from bosdyn.client.local_grid import LocalGridClient
from bosdyn.client.log_status import (
    ExperimentAlreadyRunningError,
    InactiveLogError,
    LogStatusClient,
    RequestIdDoesNotExistError,
)
from bosdyn.client.math_helpers import Vec3
from bosdyn.client.payload import PayloadClient
from bosdyn.client.payload_registration import PayloadRegistrationClient
from bosdyn.client.point_cloud import PointCloudClient
from bosdyn.client.power import KeepaliveMotorsOffError, PowerClient
from bosdyn.client.robot import UnregisteredServiceNameError
from bosdyn.client.robot_state import RobotStateClient
from bosdyn.client.world_object import WorldObjectClient

from spot_model.robot.facts import JOINT_NAMES


@pytest.fixture
def robot(stub: Any) -> Any:
    """An authenticated robot of the SDK in front of the stub."""
    return stub.sdk_robot()


@pytest.fixture
def call(robot: Any) -> Iterator[Callable[..., Any]]:
    """Make a call in both forms; returns the answer of the sync one after comparing their types."""

    def both(client_type: Any, method: str, *arguments: Any, **keywords: Any) -> Any:
        client = robot.ensure_client(client_type.default_service_name)
        answer = getattr(client, method)(*arguments, **keywords)
        later = getattr(client, f"{method}_async")(*arguments, **keywords).result(timeout=10)
        assert type(later) is type(answer)
        return answer

    return both


def test_state_metrics_and_hardware(robot: Any, call: Callable[..., Any], stub: Any) -> None:
    stub.robot.add_system_fault("weak_battery", "warn")
    state = call(RobotStateClient, "get_robot_state")
    assert [joint.name for joint in state.kinematic_state.joint_states] == [n.replace("_", ".") for n in JOINT_NAMES]
    assert [joint.position.value for joint in state.kinematic_state.joint_states] == pytest.approx(
        [0.1 * i for i in range(12)]
    )
    assert state.battery_states[0].voltage.value == 57.0
    assert state.system_fault_state.aggregated["power"] == state.system_fault_state.faults[0].SEVERITY_WARN
    assert [foot.contact for foot in state.foot_state] == [1, 1, 1, 2]
    labels = [metric.label for metric in call(RobotStateClient, "get_robot_metrics").metrics]
    assert "distance" in labels
    hardware = call(RobotStateClient, "get_robot_hardware_configuration")
    assert hardware.skeleton.links[0].name == "base"
    assert len(hardware.skeleton.links) == 13
    states = robot.ensure_client(RobotStateClient.default_service_name)
    models = [link.obj_model for link in states.get_hardware_config_with_link_info().skeleton.links]
    assert [model.file_name for model in models[:2]] == ["base.obj", "fl.hip.obj"]
    assert all(model.file_contents.count("\nv ") == 8 and model.file_contents.count("\nf ") == 6 for model in models)
    with pytest.raises(InvalidRequestError, match="no model of link 'tail'"):
        robot.ensure_client("robot-state").get_robot_link_model("tail")
    assert robot.has_arm() is False
    assert robot.is_powered_on() is False
    assert robot.get_cached_hardware_hardware_configuration() == hardware


def test_the_urdf_is_a_robot_with_its_feet_in_place(call: Callable[..., Any]) -> None:
    """MuJoCo reads it; where the feet are, worked out by hand from the vendor's dimensions."""
    urdf = call(RobotStateClient, "get_robot_hardware_configuration").skeleton.urdf
    model = mujoco.MjModel.from_xml_string(urdf)
    data = mujoco.MjData(model)
    assert [model.joint(i).name for i in range(model.njnt)] == [name.replace("_", ".") for name in JOINT_NAMES]
    assert model.joint("hr.hy").range == pytest.approx([-0.898845, 2.295108])
    assert model.body_mass.sum() == pytest.approx(4 * (1.13688 + 2.25620 + 0.33))  # MuJoCo drops the fixed base's
    hx, hy, kn = 0.2, 0.9, -1.6
    data.qpos[:] = [hx, hy, kn] * 4
    mujoco.mj_kinematics(model, data)
    down = 0.3205 * math.cos(hy) + 0.025 * math.sin(hy) + 0.3365 * math.cos(hy + kn)
    ahead = 0.025 * math.cos(hy) - 0.3205 * math.sin(hy) - 0.3365 * math.sin(hy + kn)
    for leg, end, side in (("fl", 1, 1), ("fr", 1, -1), ("hl", -1, 1), ("hr", -1, -1)):
        shin = data.body(f"{leg}.lleg")
        foot = shin.xpos + shin.xmat.reshape(3, 3) @ [0.0, 0.0, -0.3365]
        out = side * 0.110945
        y = side * 0.055 + out * math.cos(hx) + down * math.sin(hx)
        z = out * math.sin(hx) - down * math.cos(hx)
        assert foot == pytest.approx([end * 0.29785 + ahead, y, z], abs=1e-6)


def test_frames_of_the_polled_state_form_a_tree(robot: Any) -> None:
    from bosdyn.client.frame_helpers import get_a_tform_b, get_odom_tform_body, get_vision_tform_body

    frames = robot.get_frame_tree_snapshot()
    odom_from_body = get_odom_tform_body(frames)
    assert (odom_from_body.x, odom_from_body.y, odom_from_body.z) == pytest.approx((1.0, 2.0, 0.5))
    assert get_vision_tform_body(frames).x == pytest.approx(3.0)
    ground = get_a_tform_b(frames, "odom", "gpe")
    assert (ground.x, ground.y, ground.z) == pytest.approx((1.0, 2.0, 0.0))
    assert get_a_tform_b(frames, "body", "feet_center").z == pytest.approx(-0.5)


def test_identity_and_directory(robot: Any, call: Callable[..., Any]) -> None:
    assert robot.get_id().species == "spot"
    assert robot.get_cached_robot_id().serial_number.startswith("spot-FAKE")
    services = {entry.name: entry.type for entry in robot.list_services()}
    assert services["robot-state-streaming"] == "bosdyn.api.RobotStateStreamingService"
    assert call(DirectoryClient, "get_entry", "lease").authority.endswith(".spot.robot")
    with pytest.raises(NonexistentServiceError):
        robot.ensure_client("directory").get_entry("coffee")
    registration = robot.ensure_client(DirectoryRegistrationClient.default_service_name)
    words = ("mine", "my.Service", "mine.spot.robot", "127.0.0.1", 4000)
    registration.register(*words)
    assert "mine" in {entry.name for entry in robot.list_services()}
    with pytest.raises(ServiceAlreadyExistsError):
        registration.register(*words)
    registration.update(*words)
    registration.unregister("mine")
    assert "mine" not in {entry.name for entry in robot.list_services()}


def test_time_sync_measures_the_skew(robot: Any, stub: Any) -> None:
    robot.time_sync.wait_for_sync(timeout_sec=10)
    endpoint = robot.time_sync.endpoint
    expected_s = stub.robot.clock.now_ns() * 1e-9 - time.time()
    skew_s = endpoint.clock_skew.seconds + endpoint.clock_skew.nanos * 1e-9
    assert skew_s == pytest.approx(expected_s, abs=5.0)
    assert endpoint.clock_identifier
    robot.stop_time_sync()


def test_power_extras_and_fans(robot: Any, stub: Any, call: Callable[..., Any]) -> None:
    from bosdyn.client import power

    robot.ensure_client("lease").acquire()
    client = robot.ensure_client(PowerClient.default_service_name)
    power.power_off_wifi_radio(client, timeout_sec=5)
    assert robot.ensure_client("robot-state").get_robot_state().power_state.wifi_radio_power_state == 2
    power.power_on_wifi_radio(client, timeout_sec=5)
    power.power_off_payload_ports(client, timeout_sec=5)
    power.power_on_payload_ports(client, timeout_sec=5)
    assert set(call(PowerClient, "get_fan_info").fan_information) == {"fan_front", "fan_rear"}
    command = client.fan_power_command(50, 10)
    feedback = call(PowerClient, "fan_power_command_feedback", command.command_id)
    assert feedback.status == power_pb2.FanPowerCommandFeedbackResponse.STATUS_RUNNING
    stub.robot.clock.pass_s(11)
    feedback = client.fan_power_command_feedback(command.command_id)
    assert feedback.status == power_pb2.FanPowerCommandFeedbackResponse.STATUS_COMPLETE


def test_licence(robot: Any, stub: Any) -> None:
    client = robot.ensure_client(LicenseClient.default_service_name)
    assert client.get_license_info().status == client.get_license_info().STATUS_VALID
    assert client.get_feature_enabled(["joint_control", "choreography"]) == {
        "joint_control": True,
        "choreography": False,
    }
    stub.server.world.license.state = "missing"
    assert client.get_license_info().status == client.get_license_info().STATUS_NO_LICENSE
    assert client.get_feature_enabled(["joint_control"]) == {"joint_control": False}


def test_payloads(robot: Any, stub: Any, call: Callable[..., Any]) -> None:
    assert list(call(PayloadClient, "list_payloads")) == []
    registration = robot.ensure_client(PayloadRegistrationClient.default_service_name)
    registration.register_payload(payload_pb2.Payload(GUID="g", name="lamp"), "a secret")
    assert [payload.name for payload in call(PayloadClient, "list_payloads")] == ["lamp"]
    assert stub.server.world.auth.user_of(registration.get_payload_auth_token("g", "a secret")) == "payload:g"
    registration.detach_payload("g", "a secret")
    assert not call(PayloadClient, "list_payloads")[0].is_enabled
    from bosdyn.client.payload_registration import InvalidPayloadCredentialsError

    with pytest.raises(InvalidPayloadCredentialsError):
        registration.get_payload_auth_token("g", "guess")


def test_service_faults(robot: Any) -> None:
    client = robot.ensure_client(FaultClient.default_service_name)
    fault_id = service_fault_pb2.ServiceFaultId(fault_name="hot", service_name="mine")
    client.trigger_service_fault(service_fault_pb2.ServiceFault(fault_id=fault_id, attributes=["lamp"], severity=2))
    state = robot.ensure_client("robot-state").get_robot_state().service_fault_state
    assert state.faults[0].fault_id == fault_id
    assert state.aggregated["lamp"] == 2
    with pytest.raises(ServiceFaultAlreadyExistsError):
        client.trigger_service_fault(service_fault_pb2.ServiceFault(fault_id=fault_id))
    client.clear_service_fault(fault_id)
    state = robot.ensure_client("robot-state").get_robot_state().service_fault_state
    assert not state.faults
    assert state.historical_faults[0].fault_id == fault_id
    with pytest.raises(ServiceFaultDoesNotExistError):
        client.clear_service_fault_async(fault_id).result()


def test_data_buffer_and_what_it_keeps(robot: Any) -> None:
    robot.time_sync.wait_for_sync(timeout_sec=10)
    robot.operator_comment("hello")
    robot.log_event("walk", data_buffer_pb2.Event.LEVEL_LOW, "began", time.time())
    client = robot.ensure_client(DataBufferClient.default_service_name)
    client.add_text_messages([data_buffer_pb2.TextMessage(message="text")])
    client.add_blob(b"bytes", "a type")
    client.add_protobuf_async(data_buffer_pb2.TextMessage(message="text")).result()
    client.register_signal_schema([data_buffer_pb2.SignalSchema.Variable(name="x")], "schema")
    client.add_signal_tick(b"1", 1)
    request = data_index_pb2.EventsCommentsSpec(comments=True, events=[data_index_pb2.EventSpec(type="walk")])
    found = robot.ensure_client(DataServiceClient.default_service_name).get_events_comments(request).events_comments
    assert [comment.message for comment in found.operator_comments] == ["hello"]
    assert [event.description for event in found.events] == ["began"]
    robot.stop_time_sync()


def test_senses_are_empty_but_answer(robot: Any, call: Callable[..., Any]) -> None:
    assert list(call(PointCloudClient, "list_point_cloud_sources")) == []
    assert list(call(WorldObjectClient, "list_world_objects").world_objects) == []
    docked = call(DockingClient, "get_docking_state")
    assert docked.status == docked.DOCK_STATUS_UNDOCKED
    assert list(call(LogStatusClient, "get_active_log_statuses").log_statuses) == []


def test_images_are_acquired_at_once_and_listed_by_action(robot: Any) -> None:
    client, store = robot.ensure_client("data-acquisition"), robot.ensure_client("data-acquisition-store")
    source = client.get_service_info().image_sources[0].image_source_names[0]
    robot.time_sync.wait_for_sync(timeout_sec=20)

    def of(name: str, service: str = "image") -> AcquisitionRequestList:
        capture = ImageSourceCapture(image_service=service, image_request=ImageRequest(image_source_name=name))
        return AcquisitionRequestList(image_captures=[capture])

    request_id = client.acquire_data(of(source), "door", "tour")
    client.acquire_data(of(source), "stairs", "tour")
    status = client.get_status(request_id)
    assert status.status == status.STATUS_COMPLETE
    assert [(data.channel, data.action_id.action_name) for data in status.data_saved] == [(source, "door")]
    everything, door = DataQueryParams(), DataQueryParams()
    door.action_ids.action_ids.add(action_name="door", group_name="tour")
    assert [action.action_name for action in store.list_capture_actions(everything)] == ["door", "stairs"]
    assert list(store.list_stored_images(door)) == list(status.data_saved)
    with pytest.raises(CancellationFailedError):
        client.cancel_acquisition(request_id)
    plugin = AcquisitionRequestList(data_captures=[DataCapture(name="gas")])
    for refused in (of("no-such-camera"), of(source, "thermal-camera"), plugin):
        with pytest.raises(UnknownCaptureTypeError):
            client.acquire_data(refused, "door", "tour")
    with pytest.raises(NoSuchRequestError):
        client.get_status(99)
    robot.stop_time_sync()


def test_local_grids_map_the_ground_below_the_body(robot: Any) -> None:
    client = robot.ensure_client(LocalGridClient.default_service_name)
    names = [listed.name for listed in client.get_local_grid_types()]
    assert {"terrain", "obstacle_distance"} <= set(names)
    (unknown,) = client.get_local_grids(["no-such-grid"])
    assert unknown.status == unknown.STATUS_NO_SUCH_GRID
    for answer in client.get_local_grids(names):
        grid = answer.local_grid
        size = {grid.CELL_FORMAT_FLOAT32: 4, grid.CELL_FORMAT_UINT8: 1}[grid.cell_format]
        assert len(grid.data) == size * grid.extent.num_cells_x * grid.extent.num_cells_y
        corner = get_a_tform_b(grid.transforms_snapshot, "odom", grid.frame_name_local_grid_data)
        body = get_a_tform_b(grid.transforms_snapshot, "odom", "body")
        half_m = 0.5 * grid.extent.cell_size * grid.extent.num_cells_x
        assert corner.x + half_m == pytest.approx(body.x, abs=grid.extent.cell_size)
        assert corner.y + half_m == pytest.approx(body.y, abs=grid.extent.cell_size)
        if answer.local_grid_type_name == "terrain":
            ground = get_a_tform_b(grid.transforms_snapshot, "odom", "gpe")
            assert corner.z + struct.unpack_from("<f", grid.data)[0] == pytest.approx(ground.z, abs=1e-6)


def test_a_log_runs_until_its_end_or_until_it_is_terminated(robot: Any, call: Callable[..., Any], stub: Any) -> None:
    client = robot.ensure_client(LogStatusClient.default_service_name)
    first = client.start_experiment_log(5.0).log_status
    with pytest.raises(ExperimentAlreadyRunningError):
        client.start_retro_log(2.0)
    stub.robot.clock.pass_s(4.0)
    assert client.update_experiment(first.id, 5.0).log_status.status == LogStatus.STATUS_IN_PROGRESS
    stub.robot.clock.pass_s(4.0)
    assert [log.run_time.seconds for log in client.get_active_log_statuses().log_statuses] == [8]
    stub.robot.clock.pass_s(1.1)
    assert call(LogStatusClient, "get_log_status", first.id).log_status.status == LogStatus.STATUS_DONE
    with pytest.raises(InactiveLogError):
        client.update_experiment(first.id, 5.0)
    past = client.start_retro_log(2.0).log_status
    assert (past.status, past.end_time.seconds - past.start_time.seconds) == (LogStatus.STATUS_DONE, 2)
    second = client.start_concurrent_log(60.0, data_buffer_pb2.Event(type="walk")).log_status
    assert client.terminate_log(second.id).log_status.status == LogStatus.STATUS_TERMINATED
    with pytest.raises(RequestIdDoesNotExistError):
        client.get_log_status("log-99")


def test_a_ray_meets_the_ground_plane(robot: Any, call: Callable[..., Any]) -> None:
    # The stub's body is level at (1, 2, 0.5) in odom, the ground at 0: 3-4-5 down and ahead from half a metre.
    ground = [ray_cast_pb2.RayIntersection.TYPE_GROUND_PLANE]
    ahead = call(ray_cast.RayCastClient, "raycast", Vec3(0, 0, 0), Vec3(4, 0, -3), ground, frame_name="body")
    assert (ahead.hits[0].distance_meters, ahead.hit_frame_name) == (pytest.approx(0.5 / 0.6), "body")
    assert ahead.hits[0].hit_position_in_hit_frame.x == pytest.approx(0.5 / 0.6 * 0.8)
    assert not call(ray_cast.RayCastClient, "raycast", Vec3(0, 0, 0.1), Vec3(4, 0, 3), [], frame_name="odom").hits
    assert not call(ray_cast.RayCastClient, "raycast", Vec3(0, 0, 0), Vec3(0, 0, -1), ground, 1.0, "body").hits
    with pytest.raises(ray_cast.UnknownFrameError):
        call(ray_cast.RayCastClient, "raycast", Vec3(0, 0, 0), Vec3(0, 0, -1), [], frame_name="moon")
    with pytest.raises(ray_cast.InvalidIntersectionTypeError):
        call(
            ray_cast.RayCastClient,
            "raycast",
            Vec3(0, 0, 0),
            Vec3(0, 0, -1),
            [ray_cast_pb2.RayIntersection.TYPE_HAND_DEPTH],
        )
    with pytest.raises(ray_cast.InvalidRequestError):
        call(ray_cast.RayCastClient, "raycast", Vec3(0, 0, 0), Vec3(0, 0, 0), [])


def test_keepalive_policy_acts_once_when_its_client_is_silent(robot: Any, stub: Any) -> None:
    client = robot.ensure_client(KeepaliveClient.default_service_name)
    policy = Policy()
    policy.name = "watch"
    policy.add_controlled_motors_off_action(5.0)
    with PolicyKeepalive(client, policy, rpc_interval_seconds=60, remove_policy_on_exit=True):
        assert client.get_status().status[0].policy.name == "watch"
        stub.robot.clock.pass_s(4.9)
        stub.server.world.tick()
        assert "safe_power_off" not in stub.robot.calls
        stub.robot.clock.pass_s(0.2)
        stub.server.world.tick()
        stub.server.world.tick()
        assert stub.robot.calls.count("safe_power_off") == 1
        # What a silent client's policy has switched off, nobody switches on before that client is heard, or gone.
        power, leases = robot.ensure_client(PowerClient.default_service_name), robot.ensure_client("lease")
        leases.acquire()
        motors_off = keepalive_pb2.GetStatusResponse.POLICY_CONTROL_ACTION_MOTORS_OFF
        assert list(client.get_status().active_control_actions) == [motors_off]
        with pytest.raises(KeepaliveMotorsOffError):
            power.power_command(power_pb2.PowerCommandRequest.REQUEST_ON_MOTORS)
        client.check_in(client.get_status().status[0].policy_id)
        assert list(client.get_status().active_control_actions) == []
        power.power_command(power_pb2.PowerCommandRequest.REQUEST_ON_MOTORS)
    assert not client.get_status().status
    with pytest.raises(InvalidPolicyError):
        client.check_in(77)


def test_a_service_that_a_base_spot_has_and_the_fake_has_not(robot: Any) -> None:
    for name in ("spot-check", "data-acquisition", "recording-service", "map-processing-service", "auto-return"):
        robot.ensure_client(name)
    client = robot.ensure_client("inverse-kinematics")
    with pytest.raises(UnimplementedError) as refused:
        client.inverse_kinematics(InverseKinematicsRequest())
    with pytest.raises(UnregisteredServiceNameError, match="manipulation"):
        robot.ensure_client("manipulation")
    assert "no service 'bosdyn.api.spot.InverseKinematicsService'" in refused.value.error.details()


@pytest.mark.parametrize(
    ("edges", "is_joined"),
    [
        ({"vision": "", "cup": "vision"}, True),
        ({"map": "", "vision": "map", "cup": "map"}, True),
        ({"cup": "odom"}, True),
        ({"map": "", "cup": "map"}, False),
    ],
    ids=["root of both", "root above one of both", "below one of both", "none of both"],
)
def test_an_objects_frames_and_the_robots_form_one_tree(robot: Any, edges: dict[str, str], is_joined: bool) -> None:
    thing = WorldObject(name="cup")
    drawn = thing.drawable_properties.add(frame_name_drawable="cup")
    drawn.frame.arrow_length, drawn.frame.arrow_radius, drawn.color.a = 0.1, 0.01, 1.0
    for child, parent in edges.items():
        edge = thing.transforms_snapshot.child_to_parent_edge_map[child]
        edge.parent_frame_name, edge.parent_tform_child.position.x = parent, 1.0 if parent else 0.0
        edge.parent_tform_child.rotation.w = 1.0
    client = robot.ensure_client(WorldObjectClient.default_service_name)
    client.mutate_world_objects(MutateWorldObjectRequest(mutation={"action": "ACTION_ADD", "object": thing}))
    (listed,) = client.list_world_objects().world_objects
    tree = listed.transforms_snapshot
    assert validate_frame_tree_snapshot(tree)
    for child, parent in edges.items():
        if parent:
            assert get_a_tform_b(tree, parent, child).x == pytest.approx(1.0)
    assert (get_a_tform_b(tree, "body", "cup") is not None) == is_joined


def test_a_service_that_a_client_registered_is_reached_through_the_robot(robot: Any) -> None:
    class Remote(remote_service_pb2_grpc.RemoteMissionServiceServicer):  # type: ignore[misc]
        def Tick(self, request: Any, context: Any) -> Any:  # noqa: N802
            if request.session_id == "bad":
                context.abort(grpc.StatusCode.FAILED_PRECONDITION, "no such session")
            return remote_pb2.TickResponse(status=remote_pb2.TickResponse.STATUS_SUCCESS)

    server = grpc.server(futures.ThreadPoolExecutor(2))
    remote_service_pb2_grpc.add_RemoteMissionServiceServicer_to_server(Remote(), server)
    port = server.add_insecure_port("127.0.0.1:0")
    server.start()
    try:
        register = robot.ensure_client(DirectoryRegistrationClient.default_service_name).register
        register("hello", "bosdyn.api.mission.RemoteMissionService", "hello.spot.robot", "127.0.0.1", port)
        robot.sync_with_directory()
        stub = remote_service_pb2_grpc.RemoteMissionServiceStub(robot.ensure_channel("hello"))
        assert stub.Tick(remote_pb2.TickRequest(), timeout=10).status == remote_pb2.TickResponse.STATUS_SUCCESS
        with pytest.raises(grpc.RpcError, match="a registered service: no such session") as refused:
            stub.Tick(remote_pb2.TickRequest(session_id="bad"), timeout=10)
        assert refused.value.code() is grpc.StatusCode.FAILED_PRECONDITION
    finally:
        server.stop(None).wait()
    with pytest.raises(grpc.RpcError) as refused:
        stub.Tick(remote_pb2.TickRequest(), timeout=10)
    assert refused.value.code() is grpc.StatusCode.UNAVAILABLE
