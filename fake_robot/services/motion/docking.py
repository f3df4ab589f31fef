"""DockingService and LogStatusService: no dock is near, and nothing is being logged."""

from __future__ import annotations

import grpc
from bosdyn.api.docking import docking_pb2, docking_service_pb2_grpc
from bosdyn.api.log_status import log_status_pb2, log_status_service_pb2_grpc

from fake_robot.services.authority.lease_records import LeaseBook
from fake_robot.services.calls.access import refuse_request


class DockingService(docking_service_pb2_grpc.DockingServiceServicer):  # type: ignore[misc]
    """The robot is not docked and finds no dock."""

    def __init__(self, leases: LeaseBook) -> None:
        self._leases = leases

    def GetDockingState(  # noqa: N802
        self, request: docking_pb2.GetDockingStateRequest, context: grpc.ServicerContext
    ) -> docking_pb2.GetDockingStateResponse:
        """Undocked."""
        response = docking_pb2.GetDockingStateResponse()
        response.dock_state.status = docking_pb2.DockState.DOCK_STATUS_UNDOCKED
        return response

    def GetDockingConfig(  # noqa: N802
        self, request: docking_pb2.GetDockingConfigRequest, context: grpc.ServicerContext
    ) -> docking_pb2.GetDockingConfigResponse:
        """No docks are configured."""
        return docking_pb2.GetDockingConfigResponse()

    def DockingCommand(  # noqa: N802
        self, request: docking_pb2.DockingCommandRequest, context: grpc.ServicerContext
    ) -> docking_pb2.DockingCommandResponse:
        """No dock is found."""
        response = docking_pb2.DockingCommandResponse(lease_use_result=self._leases.use(request.lease))
        response.status = response.STATUS_ERROR_DOCK_NOT_FOUND
        return response

    def DockingCommandFeedback(  # noqa: N802
        self, request: docking_pb2.DockingCommandFeedbackRequest, context: grpc.ServicerContext
    ) -> docking_pb2.DockingCommandFeedbackResponse:
        """There is no such command."""
        response = docking_pb2.DockingCommandFeedbackResponse()
        response.status = response.STATUS_OLD_DOCKING_COMMAND
        return response


class LogStatusService(log_status_service_pb2_grpc.LogStatusServiceServicer):  # type: ignore[misc]
    """The fake records no logs of its own; a client logs what it sees."""

    def GetActiveLogStatuses(  # noqa: N802
        self, request: log_status_pb2.GetActiveLogStatusesRequest, context: grpc.ServicerContext
    ) -> log_status_pb2.GetActiveLogStatusesResponse:
        """None is active."""
        response = log_status_pb2.GetActiveLogStatusesResponse()
        response.status = response.STATUS_OK
        return response

    def GetLogStatus(  # noqa: N802
        self, request: log_status_pb2.GetLogStatusRequest, context: grpc.ServicerContext
    ) -> log_status_pb2.GetLogStatusResponse:
        """There is no such log."""
        response = log_status_pb2.GetLogStatusResponse()
        response.status = response.STATUS_ID_NOT_FOUND
        return response

    def UpdateExperimentLog(  # noqa: N802
        self, request: log_status_pb2.UpdateExperimentLogRequest, context: grpc.ServicerContext
    ) -> log_status_pb2.UpdateExperimentLogResponse:
        """There is no such log."""
        response = log_status_pb2.UpdateExperimentLogResponse()
        response.status = response.STATUS_ID_NOT_FOUND
        return response

    def TerminateLog(  # noqa: N802
        self, request: log_status_pb2.TerminateLogRequest, context: grpc.ServicerContext
    ) -> log_status_pb2.TerminateLogResponse:
        """There is no such log."""
        response = log_status_pb2.TerminateLogResponse()
        response.status = response.STATUS_ID_NOT_FOUND
        return response

    def StartExperimentLog(  # noqa: N802
        self, request: log_status_pb2.StartExperimentLogRequest, context: grpc.ServicerContext
    ) -> log_status_pb2.StartExperimentLogResponse:
        """Refused: the fake records nothing."""
        refused: log_status_pb2.StartExperimentLogResponse = refuse_request(
            log_status_pb2.StartExperimentLogResponse(), "the fake robot records no logs"
        )
        return refused

    def StartRetroLog(  # noqa: N802
        self, request: log_status_pb2.StartRetroLogRequest, context: grpc.ServicerContext
    ) -> log_status_pb2.StartRetroLogResponse:
        """Refused: the fake records nothing."""
        refused: log_status_pb2.StartRetroLogResponse = refuse_request(
            log_status_pb2.StartRetroLogResponse(), "the fake robot records no logs"
        )
        return refused

    def StartConcurrentLog(  # noqa: N802
        self, request: log_status_pb2.StartConcurrentLogRequest, context: grpc.ServicerContext
    ) -> log_status_pb2.StartConcurrentLogResponse:
        """Refused: the fake records nothing."""
        refused: log_status_pb2.StartConcurrentLogResponse = refuse_request(
            log_status_pb2.StartConcurrentLogResponse(), "the fake robot records no logs"
        )
        return refused
