"""Services that a base Spot has and that the fake answers from a table, most of them without doing anything.

Importing the vendor's service modules registers their descriptors, by which the table names services and methods.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from bosdyn.api import (
    data_acquisition_store_service_pb2,
    ir_enable_disable_service_pb2,
    local_grid_service_pb2,
    point_cloud_service_pb2,
    ray_cast_service_pb2,
)
from bosdyn.api.auto_return import auto_return_service_pb2
from bosdyn.api.docking import docking_service_pb2
from bosdyn.api.gps import registration_service_pb2
from bosdyn.api.graph_nav import graph_nav_service_pb2, recording_service_pb2
from bosdyn.api.log_status import log_status_service_pb2
from bosdyn.api.mission import mission_service_pb2
from bosdyn.api.spot import spot_check_service_pb2

from fake_robot.services.calls.access import refuse_request
from fake_robot.services.calls.unary import Answer, Call
from fake_robot.services.reports.log_status import ANSWERS as LOG_ANSWERS
from fake_robot.services.reports.robot_state_message import fill_kinematics
from fake_robot.services.sensors.local_grids import get_grids, list_types
from fake_robot.services.sensors.ray_cast import cast_ray

_REGISTERED: Final = (
    auto_return_service_pb2,
    ir_enable_disable_service_pb2,
    ray_cast_service_pb2,
    registration_service_pb2,
    data_acquisition_store_service_pb2,
    docking_service_pb2,
    graph_nav_service_pb2,
    local_grid_service_pb2,
    log_status_service_pb2,
    mission_service_pb2,
    point_cloud_service_pb2,
    recording_service_pb2,
    spot_check_service_pb2,
)


def _empty(call: Call) -> None:
    """Nothing to tell."""


def _status(name: str, *, needs_lease: bool = False) -> Answer:
    """A status by its name; the lease is judged first where the request bears one."""

    def answer(call: Call) -> None:
        if needs_lease:
            call.response.lease_use_result.CopyFrom(call.world.leases.use(call.request.lease))
        call.response.status = call.response.Status.Value(name)

    return answer


def _refused(reason: str) -> Answer:
    def answer(call: Call) -> None:
        refuse_request(call.response, reason)

    return answer


def _undocked(call: Call) -> None:
    state = call.response.dock_state
    state.status = state.DOCK_STATUS_UNDOCKED


def _no_point_clouds(call: Call) -> None:
    for _ in call.request.point_cloud_requests:
        entry = call.response.point_cloud_responses.add()
        entry.status = entry.STATUS_UNKNOWN_SOURCE


def _no_mission(call: Call) -> None:
    state = call.response.state
    state.status, state.tick_counter, state.mission_id = state.STATUS_NONE, -1, -1


def _not_localized(call: Call) -> None:
    call.response.lost_detector_state.SetInParent()
    fill_kinematics(call.response.robot_kinematics, call.world.robot.snapshot())


_NO_SPOT_CHECK: Final = _refused("the robot has no cameras to calibrate and no payload to check")

ANSWERS: Final[Mapping[str, Mapping[str, Answer]]] = {
    "bosdyn.api.DataAcquisitionStoreService": {
        "ListStoredMetadata": _empty,
        "ListStoredAlertData": _empty,
        "ListStoredData": _empty,
    },
    "bosdyn.api.LocalGridService": {"GetLocalGridTypes": list_types, "GetLocalGrids": get_grids},
    "bosdyn.api.PointCloudService": {
        "ListPointCloudSources": _empty,
        "GetPointCloud": _no_point_clouds,
    },
    "bosdyn.api.docking.DockingService": {
        "GetDockingState": _undocked,
        "GetDockingConfig": _empty,
        "DockingCommand": _status("STATUS_ERROR_DOCK_NOT_FOUND", needs_lease=True),
        "DockingCommandFeedback": _status("STATUS_OLD_DOCKING_COMMAND"),
    },
    "bosdyn.api.graph_nav.GraphNavService": {
        "ClearGraph": _empty,
        "DownloadGraph": _empty,
        "GetLocalizationState": _not_localized,
        "NavigateTo": _status("STATUS_UNKNOWN_WAYPOINT"),
        "NavigateRoute": _status("STATUS_UNKNOWN_ROUTE_ELEMENTS"),
        "NavigationFeedback": _status("STATUS_NO_ROUTE"),
        "SetLocalization": _status("STATUS_UNKNOWN_WAYPOINT"),
    },
    "bosdyn.api.graph_nav.GraphNavRecordingService": {
        "GetRecordStatus": _empty,
        "StartRecording": _status("STATUS_COULD_NOT_CREATE_WAYPOINT"),
        "StopRecording": _status("STATUS_NOT_LOCALIZED_TO_END"),
    },
    "bosdyn.api.IREnableDisableService": {"IREnableDisable": _empty},
    "bosdyn.api.RayCastService": {"Raycast": cast_ray},
    "bosdyn.api.auto_return.AutoReturnService": {
        "Configure": _status("STATUS_OK"),
        "GetConfiguration": _empty,
        "Start": _refused("the robot has recorded no way back"),
    },
    "bosdyn.api.gps.RegistrationService": {
        "GetLocation": _status("STATUS_NEED_DEVICE"),
        "ResetRegistration": _empty,
    },
    "bosdyn.api.log_status.LogStatusService": LOG_ANSWERS,
    "bosdyn.api.mission.MissionService": {
        "GetState": _no_mission,
        "GetInfo": _empty,
        "GetMission": _empty,
        "LoadMission": _status("STATUS_VALIDATE_ERROR"),
        "PlayMission": _status("STATUS_NO_MISSION"),
        "PauseMission": _status("STATUS_NO_MISSION_PLAYING"),
        "StopMission": _status("STATUS_NO_MISSION_PLAYING"),
        "RestartMission": _status("STATUS_NO_MISSION"),
        "AnswerQuestion": _status("STATUS_INVALID_QUESTION_ID"),
    },
    "bosdyn.api.spot.SpotCheckService": {
        "SpotCheckCommand": _NO_SPOT_CHECK,
        "SpotCheckFeedback": _NO_SPOT_CHECK,
        "CameraCalibrationCommand": _NO_SPOT_CHECK,
        "CameraCalibrationFeedback": _NO_SPOT_CHECK,
    },
}
"""By full service name, then by method; any other method of these services is UNIMPLEMENTED."""
