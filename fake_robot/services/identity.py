"""Who the robot is and what it carries: its number, its licence, and the payloads that clients describe.

Those payloads weigh nothing here; the one that the simulated body carries is a matter of the scenario.
"""

from __future__ import annotations

import hmac
from collections.abc import Callable
from typing import Any

from bosdyn.api import (
    license_pb2,
    license_service_pb2,
    payload_pb2,
    payload_registration_service_pb2,
    payload_service_pb2,
    robot_id_service_pb2,
)

from fake_robot.scenario.parts import ServicesConfig
from fake_robot.services.auth import AuthService
from fake_robot.services.calls import Service, refuse, timestamp_from_ns
from spot_model.robot.facts import NS_PER_S

JOINT_CONTROL_FEATURE = "joint_control"
_DAY_NS = 86400 * NS_PER_S
_LICENSE_STATUS = {
    "valid": license_pb2.LicenseInfo.STATUS_VALID,
    "expired": license_pb2.LicenseInfo.STATUS_EXPIRED,
    "missing": license_pb2.LicenseInfo.STATUS_NO_LICENSE,
}


class RobotIdService(Service):
    """Tells serial number, species and software version."""

    modules = (robot_id_service_pb2,)

    def __init__(self, config: ServicesConfig) -> None:
        super().__init__()
        self._config = config

    def GetRobotId(self, request: Any, response: Any) -> None:  # noqa: N802
        """The identity from the scenario; the software's name says that this robot is a fake."""
        robot_id, config = response.robot_id, self._config
        robot_id.serial_number = robot_id.computer_serial_number = config.serial_number
        robot_id.species, robot_id.version, robot_id.nickname = "spot", "V4", config.nickname
        release, version = robot_id.software_release, robot_id.software_release.version
        version.major_version, version.minor_version, version.patch_level = config.software_version
        release.name, release.type, release.build_information = "spot-rl fake robot", "fake", "simulated"
        release.api_version = ".".join(map(str, config.software_version))


class LicenseService(Service):
    """Shows the robot's licence; ``state`` is valid, expired or missing, as a scenario or a fault makes it."""

    modules = (license_service_pb2,)

    def __init__(self, config: ServicesConfig, now_ns: Callable[[], int]) -> None:
        super().__init__()
        self.state: str = config.joint_control_license
        self._serial_number, self._now_ns = config.serial_number, now_ns

    def GetLicenseInfo(self, request: Any, response: Any) -> None:  # noqa: N802
        """The licence, valid for a year from now on, or expired yesterday."""
        told = response.license
        told.status = _LICENSE_STATUS[self.state]
        if self.state == "missing":
            return
        until_ns = self._now_ns() + (365 if self.state == "valid" else -1) * _DAY_NS
        told.id, told.robot_serial = "fake-license", self._serial_number
        told.not_valid_before.CopyFrom(timestamp_from_ns(until_ns - 366 * _DAY_NS))
        told.not_valid_after.CopyFrom(timestamp_from_ns(until_ns))
        told.licensed_features.append(JOINT_CONTROL_FEATURE)

    def GetFeatureEnabled(self, request: Any, response: Any) -> None:  # noqa: N802
        """Joint control is on with a valid licence; no other feature is licensed."""
        for code in request.feature_codes:
            response.feature_enabled[code] = code == JOINT_CONTROL_FEATURE and self.state == "valid"


class PayloadService(Service):
    """Lists, registers and authorises payloads and gives them tokens. A payload shows a secret of its own."""

    modules = (payload_service_pb2, payload_registration_service_pb2)

    def __init__(self, auth: AuthService) -> None:
        super().__init__()
        self._auth = auth
        self._payloads: dict[str, payload_pb2.Payload] = {}
        self._secrets: dict[str, str] = {}

    def ListPayloads(self, request: Any, response: Any) -> None:  # noqa: N802
        """Every registered payload, in order of registration; none at start."""
        response.payloads.extend(self._payloads.values())

    def RegisterPayload(self, request: Any, response: Any) -> None:  # noqa: N802
        """Add a payload; GUID and secret are required."""
        payload = request.payload
        if not payload.GUID or not request.payload_secret:
            refuse(response, "a payload needs a GUID and a secret")
        elif payload.GUID in self._payloads or len(self._payloads) >= 64:
            response.status = response.STATUS_ALREADY_EXISTS
        else:
            payload.is_authorized = payload.is_enabled = True
            self._payloads[payload.GUID], self._secrets[payload.GUID] = payload, request.payload_secret
            response.status = response.STATUS_OK

    def UpdatePayloadVersion(self, request: Any, response: Any) -> None:  # noqa: N802
        """Change a payload's software version."""
        payload = self._known(request, response)
        if payload is not None:
            payload.version.CopyFrom(request.updated_version)

    def UpdatePayloadAttached(self, request: Any, response: Any) -> None:  # noqa: N802
        """Attach or detach a payload."""
        payload = self._known(request, response)
        if payload is not None:
            payload.is_enabled = request.request == request.REQUEST_ATTACH

    def GetPayloadAuthToken(self, request: Any, response: Any) -> None:  # noqa: N802
        """A token for a payload that shows its secret."""
        payload = self._known(request, response)
        if payload is not None:
            response.token = self._auth.mint(f"payload:{payload.GUID}")

    def _known(self, request: Any, response: Any) -> payload_pb2.Payload | None:
        """The payload that shows its secret, else None; the answer's status says which.

        GUID and secret stand in the newer message or in the older two fields.
        """
        has_message = request.HasField("payload_credentials")
        guid = request.payload_credentials.guid if has_message else getattr(request, "payload_guid", "")
        secret = request.payload_credentials.secret if has_message else getattr(request, "payload_secret", "")
        known = self._secrets.get(guid)
        if known is not None and hmac.compare_digest(known.encode(), secret.encode()):
            response.status = response.STATUS_OK
            return self._payloads[guid]
        wrong = response.STATUS_INVALID_CREDENTIALS
        response.status = wrong if known else getattr(response, "STATUS_DOES_NOT_EXIST", wrong)
        return None
