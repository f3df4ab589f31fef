"""RobotStateService and RobotStateStreamingService: the polled state and the 333 Hz stream."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import grpc
from bosdyn.api import robot_state_pb2

from fake_robot.services.calls.access import refuse_request
from fake_robot.services.calls.stamps import timestamp_from_ns
from fake_robot.services.reports.robot_state_message import robot_state_message
from fake_robot.services.reports.skeleton import LINK_NAMES, outline_obj, urdf
from fake_robot.services.sensors.world import World

STATE_STREAM = "/bosdyn.api.RobotStateStreamingService/GetRobotStateStream"
STREAM_WAIT_S = 0.5


class RobotStateService:
    """Power, batteries, faults, e-stops, kinematics, feet: what the stream does not carry."""

    def __init__(self, world: World) -> None:
        self._world = world

    def GetRobotState(self, request: Any) -> Any:  # noqa: N802
        """The state of one instant."""
        state = robot_state_message(
            self._world.robot.snapshot(),
            self._world.service_faults.state(),
            is_wifi_on=self._world.is_wifi_on,
            are_payload_ports_on=self._world.are_payload_ports_on,
        )
        return robot_state_pb2.RobotStateResponse(robot_state=state)

    def GetRobotMetrics(self, request: Any) -> Any:  # noqa: N802
        """Distance and times since the fake was started."""
        snapshot = self._world.robot.snapshot()
        response = robot_state_pb2.RobotMetricsResponse()
        metrics = response.robot_metrics
        metrics.timestamp.CopyFrom(timestamp_from_ns(snapshot.robot_stamp_ns))
        metrics.metrics.add(label="distance", units="m", float_value=snapshot.distance_m)
        for label, seconds in (("time moving", snapshot.time_moving_s), ("electric power", snapshot.time_powered_s)):
            metrics.metrics.add(label=label, units="s").duration.FromNanoseconds(round(seconds * 1e9))
        return response

    def GetRobotHardwareConfiguration(self, request: Any) -> Any:  # noqa: N802
        """The links and a URDF, of our own numbers: the vendor's URDF and meshes are not ours to give out."""
        response = robot_state_pb2.RobotHardwareConfigurationResponse()
        hardware = response.hardware_configuration
        for name in LINK_NAMES:
            hardware.skeleton.links.add(name=name)
        hardware.skeleton.urdf = urdf()
        hardware.can_power_command_request_off_robot = True
        hardware.can_power_command_request_cycle_robot = True
        hardware.can_power_command_request_payload_ports = True
        hardware.can_power_command_request_wifi_radio = True
        return response

    def GetRobotLinkModel(self, request: Any) -> Any:  # noqa: N802
        """A link's outline: a box."""
        response = robot_state_pb2.RobotLinkModelResponse()
        name = request.link_name
        if name not in LINK_NAMES:
            told = f"no model of link {name!r}; links: {', '.join(LINK_NAMES)}"
            return refuse_request(response, told)
        response.link_model.file_name, response.link_model.file_contents = f"{name}.obj", outline_obj(name)
        return response


def stream_handler(world: World) -> grpc.GenericRpcHandler:
    """The state stream. Messages arrive here as bytes, so nothing is serialised twice."""

    def stream(_: robot_state_pb2.RobotStateStreamRequest, context: grpc.ServicerContext) -> Iterator[bytes]:
        subscription = world.robot.subscribe_state()
        forget = world.link.listen("state", subscription.close)
        if not context.add_callback(subscription.close):
            subscription.close()
        try:
            while not subscription.is_closed:
                message = subscription.get(STREAM_WAIT_S)
                if message is not None:
                    yield message
        finally:
            forget()
            subscription.close()
        if context.is_active():
            context.abort(grpc.StatusCode.UNAVAILABLE, world.link.why_down() or "the robot ended the state stream")

    handler: grpc.RpcMethodHandler[Any, Any] = grpc.unary_stream_rpc_method_handler(
        stream, request_deserializer=robot_state_pb2.RobotStateStreamRequest.FromString, response_serializer=None
    )
    service, _, method = STATE_STREAM.lstrip("/").rpartition("/")
    return grpc.method_handlers_generic_handler(service, {method: handler})
