"""The server under test, as the SDK reaches it, and the vendor's stubs on its channels."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from typing import Any

from bosdyn.api import (
    auth_service_pb2,
    directory_registration_service_pb2,
    directory_service_pb2,
    estop_service_pb2,
    fault_service_pb2,
    header_pb2,
    image_service_pb2,
    lease_pb2,
    lease_service_pb2,
    power_service_pb2,
    robot_command_service_pb2,
    robot_id_service_pb2,
    robot_state_pb2,
    robot_state_service_pb2,
    time_sync_service_pb2,
    world_object_service_pb2,
)
from bosdyn.api.docking import docking_service_pb2
from bosdyn.api.graph_nav import graph_nav_service_pb2
from bosdyn.api.keepalive import keepalive_service_pb2
from bosdyn.api.mission import mission_service_pb2
from bosdyn.client.lease import LeaseKeepAlive
from bosdyn.client.robot import Robot
from bosdyn.client.robot_command import blocking_stand
from google.protobuf.message_factory import GetMessageClass
from google.protobuf.timestamp_pb2 import Timestamp

CLIENT_NAME = "spot-rl-conformance"
RPC_TIMEOUT_S = 10.0
MOTION_TIMEOUT_S = 20.0
POLL_S = 0.1
_MODULES = {
    "auth": auth_service_pb2,
    "directory": directory_service_pb2,
    "directory-registration": directory_registration_service_pb2,
    "docking": docking_service_pb2,
    "estop": estop_service_pb2,
    "fault": fault_service_pb2,
    "graph-nav-service": graph_nav_service_pb2,
    "image": image_service_pb2,
    "keepalive": keepalive_service_pb2,
    "lease": lease_service_pb2,
    "power": power_service_pb2,
    "robot-command": robot_command_service_pb2,
    "robot-id": robot_id_service_pb2,
    "robot-mission": mission_service_pb2,
    "robot-state": robot_state_service_pb2,
    "time-sync": time_sync_service_pb2,
    "world-objects": world_object_service_pb2,
}
_METHODS = {
    (name, method.name): method
    for name, module in _MODULES.items()
    for service in module.DESCRIPTOR.services_by_name.values()
    for method in service.methods
}
_NO_TOKEN = {"auth": "auth.spot.robot", "robot-id": "id.spot.robot"}
"""Authorities of services that are asked before a login."""


class SkippedError(Exception):
    """The check cannot be made on this server now; the message says why."""


class Server:
    """One server, logged in and synchronised.

    Args:
        robot: Authenticated, with a running time sync.
        stranger: The same host, not logged in.
    """

    def __init__(self, robot: Robot, stranger: Robot) -> None:
        self.robot, self.stranger = robot, stranger
        self._listed: frozenset[str] | None = None

    def stub(self, stub_type: Any, service_name: str) -> Any:
        """The vendor's stub of a service."""
        return stub_type(self.robot.ensure_channel(service_name))

    def require(self, service: str) -> None:
        """Raise SkippedError where the directory does not list a service: what is not offered breaks no rule."""
        if self._listed is None:
            self._listed = frozenset(entry.name for entry in self.robot.ensure_client("directory").list())
        if service not in self._listed:
            raise SkippedError(f"the server offers no {service}")

    def ask(self, service: str, method: str, *, stranger_at: str = "", **fields: Any) -> Any:
        """Call a unary method of a service, by its name in the directory, with these fields of the request.

        A service that needs no login is asked without a token; so is one whose authority is given.

        Raises:
            SkippedError: The directory does not list the service.
        """
        found = _METHODS[service, method]
        authority = stranger_at or _NO_TOKEN.get(service)
        if not authority:
            self.require(service)
        channel = self.stranger.ensure_secure_channel(authority) if authority else self.robot.ensure_channel(service)
        request_type, response_type = GetMessageClass(found.input_type), GetMessageClass(found.output_type)
        call = channel.unary_unary(
            f"/{found.containing_service.full_name}/{method}",
            request_serializer=request_type.SerializeToString,
            response_deserializer=response_type.FromString,
        )
        return call(request_type(header=header(), **fields), timeout=RPC_TIMEOUT_S)

    @property
    def clock_identifier(self) -> str:
        """The identifier of this client's finished time sync."""
        return str(self.robot.time_sync.endpoint.clock_identifier)

    def robot_stamp(self, ahead_s: float) -> Timestamp:
        """An instant of the robot's clock."""
        stamp: Timestamp = self.robot.time_sync.endpoint.robot_timestamp_from_local_secs(time.time() + ahead_s)
        return stamp

    def state(self) -> robot_state_pb2.RobotState:
        """The robot's state, polled."""
        return self.robot.ensure_client("robot-state").get_robot_state()

    @contextlib.contextmanager
    def lease(self, resource: str = "body") -> Iterator[lease_pb2.Lease]:
        """The lease for as long as the block runs; somebody else's is never taken.

        Raises:
            SkippedError: Somebody holds it.
        """
        from bosdyn.client.lease import ResourceAlreadyClaimedError

        client = self.robot.ensure_client("lease")
        try:
            lease = client.acquire(resource)
        except ResourceAlreadyClaimedError as error:
            raise SkippedError("somebody else holds the lease") from error
        try:
            yield lease.lease_proto
        finally:
            with contextlib.suppress(Exception):
                client.return_lease(lease)

    def wait_for(self, is_done: Any, what: str) -> None:
        """Poll until it is so.

        Raises:
            SkippedError: It does not come.
        """
        deadline_s = time.monotonic() + MOTION_TIMEOUT_S
        while not is_done():
            if time.monotonic() > deadline_s:
                raise SkippedError(f"the robot did not {what} within {MOTION_TIMEOUT_S:g} s")
            time.sleep(POLL_S)


def header() -> header_pb2.RequestHeader:
    """A request's header as the SDK fills it."""
    filled = header_pb2.RequestHeader(client_name=CLIENT_NAME)
    filled.request_timestamp.GetCurrentTime()
    return filled


def status_of(response: Any) -> str:
    """The name of a response's status."""
    return enum_name(response, "status")


def enum_name(message: Any, field: str) -> str:
    """The name of an enumeration's value in a message."""
    value = getattr(message, field)
    found = message.DESCRIPTOR.fields_by_name[field].enum_type.values_by_number.get(value)
    return str(value) if found is None else str(found.name)


def is_off(state: robot_state_pb2.RobotState) -> bool:
    """Whether the motors have no power."""
    return bool(state.power_state.motor_power_state == robot_state_pb2.PowerState.STATE_OFF)


@contextlib.contextmanager
def powered(server: Server) -> Iterator[lease_pb2.Lease]:
    """Acquire the lease, power on, stand; at the end sit, power off, return the lease.

    Raises:
        SkippedError: Somebody holds the lease, or the e-stop is pressed.
    """
    robot = server.robot
    if robot.is_estopped(timeout=RPC_TIMEOUT_S):
        raise SkippedError("the e-stop is pressed")
    if robot.is_powered_on(timeout=RPC_TIMEOUT_S):
        raise SkippedError("the motors are on already")
    with server.lease(), LeaseKeepAlive(robot.ensure_client("lease"), return_at_exit=False):
        try:
            robot.power_on(timeout_sec=MOTION_TIMEOUT_S)
            blocking_stand(robot.ensure_client("robot-command"), timeout_sec=MOTION_TIMEOUT_S)
            # The commands so far went out under newer sub-leases, so the one that was granted is too old.
            yield robot.lease_wallet.advance("body").lease_proto
        finally:
            robot.power_off(cut_immediately=False, timeout_sec=MOTION_TIMEOUT_S)
