"""EstopService: the software e-stop as clients see it; every change reaches the robot at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bosdyn.api import estop_pb2

from fake_robot.services.authority.estop_endpoints import EstopEndpoints


class EstopService:
    """Registers endpoints and hears their check-ins.

    ``apply_level`` brings the endpoints' level to the robot; it is called after every change.
    """

    def __init__(self, records: EstopEndpoints, apply_level: Callable[[], None]) -> None:
        self._records = records
        self._apply_level = apply_level

    def GetEstopConfig(self, request: Any) -> Any:  # noqa: N802
        """The active configuration."""
        return estop_pb2.GetEstopConfigResponse(request=request, active_config=self._records.config())

    def SetEstopConfig(self, request: Any) -> Any:  # noqa: N802
        """Replace the configuration; not while the motors are on."""
        status = self._records.set_config(request.config, request.target_config_id)
        self._apply_level()
        return estop_pb2.SetEstopConfigResponse(request=request, active_config=self._records.config(), status=status)

    def RegisterEstopEndpoint(self, request: Any) -> Any:  # noqa: N802
        """Take over an endpoint of the configuration."""
        status, endpoint = self._records.register(
            request.target_config_id, request.target_endpoint, request.new_endpoint
        )
        self._apply_level()
        return estop_pb2.RegisterEstopEndpointResponse(request=request, new_endpoint=endpoint, status=status)

    def DeregisterEstopEndpoint(self, request: Any) -> Any:  # noqa: N802
        """Let an endpoint go."""
        status = self._records.deregister(request.target_config_id, request.target_endpoint)
        self._apply_level()
        return estop_pb2.DeregisterEstopEndpointResponse(request=request, status=status)

    def EstopCheckIn(self, request: Any) -> Any:  # noqa: N802
        """Hear an endpoint and give it the next challenge."""
        status, challenge = self._records.check_in(
            request.endpoint, request.challenge, request.response, request.stop_level
        )
        self._apply_level()
        return estop_pb2.EstopCheckInResponse(request=request, challenge=challenge, status=status)

    def GetEstopSystemStatus(self, request: Any) -> Any:  # noqa: N802
        """The level, the endpoints, and why."""
        return estop_pb2.GetEstopSystemStatusResponse(status=self._records.status())
