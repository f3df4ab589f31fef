"""RobotStateService and RobotStateStreamingService: the polled state and the 333 Hz stream."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import grpc
from bosdyn.api import robot_state_pb2, robot_state_service_pb2

from fake_robot.services.calls import Service, refuse, timestamp_from_ns
from fake_robot.services.reports.skeleton import LINK_NAMES, outline_obj, urdf
from fake_robot.services.reports.state_message import fill_state
from fake_robot.services.world import World

STATE_STREAM = "/bosdyn.api.RobotStateStreamingService/GetRobotStateStream"
STREAM_WAIT_S = 0.5


class RobotStateService(Service):
    """Power, batteries, faults, e-stops, kinematics, feet: what the stream does not carry."""

    modules = (robot_state_service_pb2,)

    def __init__(self, world: World) -> None:
        super().__init__()
        self._world = world

    def GetRobotState(self, request: Any, response: Any) -> None:  # noqa: N802
        """The state of one instant."""
        world, state = self._world, response.robot_state
        fill_state(
            state,
            world.robot.snapshot(),
            is_wifi_on=world.is_wifi_on,
            are_payload_ports_on=world.are_payload_ports_on,
        )
        state.service_fault_state.CopyFrom(world.service_faults.state())

    def GetRobotMetrics(self, request: Any, response: Any) -> None:  # noqa: N802
        """Distance and times since the fake was started."""
        snapshot, told = self._world.robot.snapshot(), response.robot_metrics
        told.timestamp.CopyFrom(timestamp_from_ns(snapshot.robot_stamp_ns))
        told.metrics.add(label="distance", units="m", float_value=snapshot.distance_m)
        for label, seconds in (("time moving", snapshot.time_moving_s), ("electric power", snapshot.time_powered_s)):
            told.metrics.add(label=label, units="s").duration.FromNanoseconds(round(seconds * 1e9))

    def GetRobotHardwareConfiguration(self, request: Any, response: Any) -> None:  # noqa: N802
        """The links and a URDF, of our own numbers: the vendor's URDF and meshes are not ours to give out."""
        hardware = response.hardware_configuration
        for name in LINK_NAMES:
            hardware.skeleton.links.add(name=name)
        hardware.skeleton.urdf = urdf()
        for what in ("off_robot", "cycle_robot", "payload_ports", "wifi_radio"):
            setattr(hardware, f"can_power_command_request_{what}", True)

    def GetRobotLinkModel(self, request: Any, response: Any) -> None:  # noqa: N802
        """A link's outline: a box."""
        name = request.link_name
        if name not in LINK_NAMES:
            refuse(response, f"no model of link {name!r}; links: {', '.join(LINK_NAMES)}")
            return
        response.link_model.file_name, response.link_model.file_contents = f"{name}.obj", outline_obj(name)


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
