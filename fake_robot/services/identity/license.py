"""LicenseService: whether joint control is licensed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bosdyn.api import license_pb2

from fake_robot.services.calls.stamps import timestamp_from_ns
from spot_model.robot.stamps import NS_PER_S

JOINT_CONTROL_FEATURE = "joint_control"
_DAY_NS = 86400 * NS_PER_S
_STATUS = {
    "valid": license_pb2.LicenseInfo.STATUS_VALID,
    "expired": license_pb2.LicenseInfo.STATUS_EXPIRED,
    "missing": license_pb2.LicenseInfo.STATUS_NO_LICENSE,
}


class LicenseService:
    """Shows the robot's licence, which a scenario or a fault can make expired or missing."""

    def __init__(self, serial_number: str, state: Callable[[], str], robot_now_ns: Callable[[], int]) -> None:
        self._serial_number = serial_number
        self._state = state
        self._robot_now_ns = robot_now_ns

    def GetLicenseInfo(self, request: Any) -> Any:  # noqa: N802
        """The licence, valid for a year from now on, or expired yesterday."""
        state, now_ns = self._state(), self._robot_now_ns()
        response = license_pb2.GetLicenseInfoResponse()
        response.license.status = _STATUS[state]
        if state == "missing":
            return response
        until_ns = now_ns + 365 * _DAY_NS if state == "valid" else now_ns - _DAY_NS
        response.license.id = "fake-license"
        response.license.robot_serial = self._serial_number
        response.license.not_valid_before.CopyFrom(timestamp_from_ns(until_ns - 366 * _DAY_NS))
        response.license.not_valid_after.CopyFrom(timestamp_from_ns(until_ns))
        response.license.licensed_features.append(JOINT_CONTROL_FEATURE)
        return response

    def GetFeatureEnabled(self, request: Any) -> Any:  # noqa: N802
        """Joint control is on with a valid licence; no other feature is licensed."""
        response = license_pb2.GetFeatureEnabledResponse()
        for code in request.feature_codes:
            response.feature_enabled[code] = code == JOINT_CONTROL_FEATURE and self._state() == "valid"
        return response
