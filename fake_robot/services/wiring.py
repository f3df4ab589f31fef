"""Every service of the robot, hung onto one gRPC server."""

from __future__ import annotations

from typing import Any, ClassVar

import grpc
from bosdyn.api import (
    data_acquisition_store_service_pb2,
    ir_enable_disable_service_pb2,
    point_cloud_service_pb2,
    robot_command_service_pb2_grpc,
)
from bosdyn.api.auto_return import auto_return_service_pb2
from bosdyn.api.docking import docking_service_pb2
from bosdyn.api.gps import registration_service_pb2
from bosdyn.api.graph_nav import graph_nav_service_pb2, recording_service_pb2
from bosdyn.api.mission import mission_service_pb2
from bosdyn.api.spot import spot_check_service_pb2

from fake_robot.services.authority.power import PowerService
from fake_robot.services.calls import Answer, Service, UnaryCalls, refuse
from fake_robot.services.directory import UnknownServiceHandler
from fake_robot.services.motion.joint_stream import RobotCommandStreamingService
from fake_robot.services.motion.robot_command import RobotCommandService
from fake_robot.services.reports.cameras import DataAcquisitionService, ImageService
from fake_robot.services.reports.robot_state import RobotStateService, stream_handler
from fake_robot.services.reports.state_message import fill_kinematics
from fake_robot.services.reports.surroundings import GroundService, WorldObjectService
from fake_robot.services.world import World


def add_services(server: grpc.Server, world: World) -> None:
    """Add every service; the full name of a method tells them apart, so one server has room for all."""
    images = ImageService(world)
    services = (
        *(part for part in vars(world).values() if isinstance(part, Service)),
        PowerService(world),
        RobotStateService(world),
        RobotCommandService(world),
        images,
        DataAcquisitionService(world, images),
        WorldObjectService(world.robot.snapshot),
        GroundService(world.robot.snapshot),
        AbsentServices(world),
    )
    robot_command_service_pb2_grpc.add_RobotCommandStreamingServiceServicer_to_server(
        RobotCommandStreamingService(world), server
    )
    # The first handler that takes a method wins: the stream of bytes, our own services, then nobody's.
    server.add_generic_rpc_handlers(
        (
            stream_handler(world),
            UnaryCalls(services, world.now_ns),
            UnknownServiceHandler(world.directory.address_of_type),
        )
    )


def _nothing(request: object, response: object) -> None:
    """Nothing to tell."""


def _status(name: str) -> Answer:
    return lambda _, response: setattr(response, "status", response.Status.Value(name))


def _refused(reason: str) -> Answer:
    return lambda _, response: refuse(response, reason)


_NO_SPOT_CHECK = _refused("the robot has no cameras to calibrate and no payload to check")


class AbsentServices(Service):
    """Services that a base Spot has and that have nothing to do here: no dock, map, mission, way back, point cloud."""

    modules = (
        auto_return_service_pb2,
        data_acquisition_store_service_pb2,
        docking_service_pb2,
        graph_nav_service_pb2,
        ir_enable_disable_service_pb2,
        mission_service_pb2,
        point_cloud_service_pb2,
        recording_service_pb2,
        registration_service_pb2,
        spot_check_service_pb2,
    )
    table: ClassVar = {
        # auto-return
        "Configure": _status("STATUS_OK"),
        "GetConfiguration": _nothing,
        "Start": _refused("the robot has recorded no way back"),
        # data-acquisition-store
        "ListStoredMetadata": _nothing,
        "ListStoredAlertData": _nothing,
        "ListStoredData": _nothing,
        # docking
        "GetDockingConfig": _nothing,
        "DockingCommandFeedback": _status("STATUS_OLD_DOCKING_COMMAND"),
        # gps-registration
        "GetLocation": _status("STATUS_NEED_DEVICE"),
        "ResetRegistration": _nothing,
        # graph-nav-service, recording-service
        "ClearGraph": _nothing,
        "DownloadGraph": _nothing,
        "NavigateTo": _status("STATUS_UNKNOWN_WAYPOINT"),
        "NavigateRoute": _status("STATUS_UNKNOWN_ROUTE_ELEMENTS"),
        "NavigationFeedback": _status("STATUS_NO_ROUTE"),
        "SetLocalization": _status("STATUS_UNKNOWN_WAYPOINT"),
        "GetRecordStatus": _nothing,
        "StartRecording": _status("STATUS_COULD_NOT_CREATE_WAYPOINT"),
        "StopRecording": _status("STATUS_NOT_LOCALIZED_TO_END"),
        # ir-enable-disable-service, point-cloud
        "IREnableDisable": _nothing,
        "ListPointCloudSources": _nothing,
        # robot-mission
        "GetInfo": _nothing,
        "GetMission": _nothing,
        "LoadMission": _status("STATUS_VALIDATE_ERROR"),
        "PlayMission": _status("STATUS_NO_MISSION"),
        "PauseMission": _status("STATUS_NO_MISSION_PLAYING"),
        "StopMission": _status("STATUS_NO_MISSION_PLAYING"),
        "RestartMission": _status("STATUS_NO_MISSION"),
        "AnswerQuestion": _status("STATUS_INVALID_QUESTION_ID"),
        # spot-check
        "SpotCheckCommand": _NO_SPOT_CHECK,
        "SpotCheckFeedback": _NO_SPOT_CHECK,
        "CameraCalibrationCommand": _NO_SPOT_CHECK,
        "CameraCalibrationFeedback": _NO_SPOT_CHECK,
    }
    """Answers that depend on nothing."""

    def __init__(self, world: World) -> None:
        super().__init__()
        self._world = world

    def DockingCommand(self, request: Any, response: Any) -> None:  # noqa: N802
        """There is no dock; the lease is judged first."""
        self._world.leases.admits(request, response)
        response.status = response.STATUS_ERROR_DOCK_NOT_FOUND

    def GetDockingState(self, request: Any, response: Any) -> None:  # noqa: N802
        """On no dock."""
        response.dock_state.status = response.dock_state.DOCK_STATUS_UNDOCKED

    def GetLocalizationState(self, request: Any, response: Any) -> None:  # noqa: N802
        """On no map, but with the robot's frames."""
        response.lost_detector_state.SetInParent()
        fill_kinematics(response.robot_kinematics, self._world.robot.snapshot())

    def GetPointCloud(self, request: Any, response: Any) -> None:  # noqa: N802
        """Each source is unknown."""
        for _ in request.point_cloud_requests:
            entry = response.point_cloud_responses.add()
            entry.status = entry.STATUS_UNKNOWN_SOURCE

    def GetState(self, request: Any, response: Any) -> None:  # noqa: N802
        """No mission is loaded."""
        state = response.state
        state.status, state.tick_counter, state.mission_id = state.STATUS_NONE, -1, -1
