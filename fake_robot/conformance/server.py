"""The server under test, as the SDK reaches it, and the vendor's stubs on its channels."""

from __future__ import annotations

import functools
import secrets
import time
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

from bosdyn.api import (
    auth_service_pb2,
    directory_pb2,
    directory_registration_service_pb2,
    directory_service_pb2,
    directory_service_pb2_grpc,
    estop_service_pb2,
    fault_service_pb2,
    header_pb2,
    image_service_pb2,
    lease_service_pb2,
    license_service_pb2,
    local_grid_service_pb2,
    power_service_pb2,
    robot_command_service_pb2,
    robot_id_service_pb2,
    robot_state_pb2,
    robot_state_service_pb2,
    time_sync_pb2,
    time_sync_service_pb2,
    world_object_service_pb2,
)
from bosdyn.api.graph_nav import graph_nav_service_pb2
from bosdyn.api.keepalive import keepalive_service_pb2
from bosdyn.api.mission import mission_service_pb2
from bosdyn.client.robot import Robot
from google.protobuf.message_factory import GetMessageClass
from google.protobuf.timestamp_pb2 import Timestamp

Made = TypeVar("Made")
CLIENT_NAME = f"spot-rl-conformance-{secrets.token_hex(4)}"
"""One for each run, so that its leases are told from those of others."""
RPC_TIMEOUT_S = 10.0
FEATURE = "joint_control"
"""The licence's name of joint control."""
# fmt: off
SERVICES = {
    service.full_name: {method.name: method for method in service.methods}
    for module in (
        auth_service_pb2, directory_registration_service_pb2, directory_service_pb2, estop_service_pb2,
        fault_service_pb2, graph_nav_service_pb2, image_service_pb2, keepalive_service_pb2, lease_service_pb2,
        license_service_pb2, local_grid_service_pb2, mission_service_pb2, power_service_pb2, robot_command_service_pb2,
        robot_id_service_pb2, robot_state_service_pb2, time_sync_service_pb2, world_object_service_pb2,
    )
    for service in module.DESCRIPTOR.services_by_name.values()
}
# fmt: on
"""Methods by the full name of their service."""
_NO_TOKEN = {"auth": "auth.spot.robot", "robot-id": "id.spot.robot"}
"""Authorities of services that are asked before a login."""


class SkippedError(Exception):
    """The server does not offer what the check is about; the message says what."""


class OpenError(Exception):
    """The check cannot be judged on this server now; the message says why."""


class Answered(NamedTuple):
    """The header of one unary answer, and what was sent when; nanoseconds of this computer's clock."""

    method: str
    sent: header_pb2.RequestHeader
    header: header_pb2.ResponseHeader
    sent_ns: int
    received_ns: int


class Sync(NamedTuple):
    """A client's round trips until the server called it synchronised, and the robot's clock by the best of them."""

    answers: list[time_sync_pb2.TimeSyncUpdateResponse]
    least_ns: int
    """The robot's clock minus ours is no less than this, by the times of the headers."""
    most_ns: int

    @property
    def ahead_ns(self) -> int:
        """The robot's clock minus ours."""
        return (self.least_ns + self.most_ns) // 2

    @property
    def clock_identifier(self) -> str:
        """The identifier of the last answer."""
        return str(self.answers[-1].clock_identifier)

    @property
    def is_established(self) -> bool:
        """Whether the server says so."""
        return bool(self.answers[-1].state.status == time_sync_pb2.TimeSyncState.STATUS_OK)


class Server:
    """One server, logged in; ``stranger`` is the same host, not logged in."""

    def __init__(self, robot: Robot, stranger: Robot) -> None:
        self.robot, self.stranger = robot, stranger
        self.answered: list[Answered] = []
        self.may_move = False
        clients = robot.service_client_factories_by_type.values()
        self.types = {client.default_service_name: client.service_type for client in clients}
        self.types["robot-mission"] = "bosdyn.api.mission.MissionService"
        self._kept: dict[Callable[[Server], Any], Any] = {}

    def once(self, make: Callable[[Server], Made]) -> Made:
        """What ``make`` makes of this server, made once: later callers get the same, or the same exception."""
        if make not in self._kept:
            try:
                self._kept[make] = make(self)
            except Exception as error:  # noqa: BLE001 - raised below, as often as it is asked for
                self._kept[make] = error
        if isinstance(self._kept[make], Exception):
            raise self._kept[make]
        made: Made = self._kept[make]
        return made

    def channel(self, service: str) -> Any:
        """A channel to a service by the authority that the directory lists, or its usual one, with our token."""
        self.require(service)
        return self.robot.ensure_secure_channel(self.listed[service].authority or f"{service}.spot.robot")

    @functools.cached_property
    def listed(self) -> dict[str, Any]:
        """The directory's entries, by name."""
        channel = self.robot.ensure_secure_channel("api.spot.robot")
        stub = directory_service_pb2_grpc.DirectoryServiceStub(channel)
        request = directory_pb2.ListServiceEntriesRequest(header=header())
        return {e.name: e for e in stub.ListServiceEntries(request, timeout=RPC_TIMEOUT_S).service_entries}

    def require(self, service: str) -> None:
        """Raise SkippedError where the directory does not list a service: what is not offered breaks no rule."""
        if service not in self.listed:
            raise SkippedError(f"the server offers no {service}")

    def ask(self, service: str, method: str, *, stranger_at: str = "", **fields: Any) -> Any:
        """Call a unary method of a service, by its name in the directory, with these fields of the request.

        A service that needs no login is asked without a token; so is one whose authority is given.

        Raises:
            SkippedError: The directory does not list the service.
        """
        found = SERVICES[self.types[service]][method]
        authority = stranger_at or _NO_TOKEN.get(service)
        channel = self.stranger.ensure_secure_channel(authority) if authority else self.channel(service)
        request_type, response_type = GetMessageClass(found.input_type), GetMessageClass(found.output_type)
        call = channel.unary_unary(
            f"/{found.containing_service.full_name}/{method}",
            request_serializer=request_type.SerializeToString,
            response_deserializer=response_type.FromString,
        )
        request: Any = request_type(header=header(), **fields)
        sent_ns = time.time_ns()
        answer = call(request, timeout=RPC_TIMEOUT_S)
        self.answered.append(Answered(method, request.header, answer.header, sent_ns, time.time_ns()))
        return answer

    @functools.cached_property
    def sync(self) -> Sync:
        """Our own time sync, so that one that is wrong can be judged; by polled states where headers bear no times."""
        answers: list[time_sync_pb2.TimeSyncUpdateResponse] = []
        bounds: list[tuple[int, int]] = []
        fields: dict[str, Any] = {}
        for _ in range(25):
            answers.append(self.ask("time-sync", "TimeSyncUpdate", **fields))
            told = self.answered[-1]
            trip = time_sync_pb2.TimeSyncRoundTrip()
            at = told.header.request_received_timestamp, told.header.response_timestamp
            if not 0 < stamp_ns(at[0]) <= stamp_ns(at[1]):
                at = (self.state().kinematic_state.acquisition_timestamp,) * 2
                told = self.answered[-1]
            trip.client_tx.FromNanoseconds(told.sent_ns)
            trip.client_rx.FromNanoseconds(told.received_ns)
            trip.server_rx.CopyFrom(at[0])
            trip.server_tx.CopyFrom(at[1])
            fields = {"clock_identifier": answers[-1].clock_identifier, "previous_round_trip": trip}
            bounds.append((stamp_ns(trip.server_tx) - told.received_ns, stamp_ns(trip.server_rx) - told.sent_ns))
            if answers[-1].state.status == time_sync_pb2.TimeSyncState.STATUS_OK:
                break
        return Sync(answers, max(least for least, _ in bounds), min(most for _, most in bounds))

    def robot_stamp(self, ahead_s: float) -> Timestamp:
        """An instant of the robot's clock, by the times of headers."""
        stamp = Timestamp()
        stamp.FromNanoseconds(time.time_ns() + self.sync.ahead_ns + round(ahead_s * 1e9))
        return stamp

    def state(self) -> robot_state_pb2.RobotState:
        """The robot's state, polled."""
        return self.ask("robot-state", "GetRobotState").robot_state


def header() -> header_pb2.RequestHeader:
    """A request's header as the SDK fills it."""
    filled = header_pb2.RequestHeader(client_name=CLIENT_NAME)
    filled.request_timestamp.GetCurrentTime()
    return filled


def stamp_ns(stamp: Any) -> int:
    """Nanoseconds of a timestamp or duration."""
    return int(stamp.seconds * 10**9 + stamp.nanos)


def status_of(response: Any) -> str:
    """The name of a response's status."""
    return enum_name(response, "status")


def enum_name(message: Any, path: str) -> str:
    """The name of an enumeration's value in a message, at a path of fields and places with dots between them."""
    *parents, field = path.split(".")
    for parent in parents:
        message = message[int(parent)] if parent.isdigit() else getattr(message, parent)
    value = getattr(message, field)
    found = message.DESCRIPTOR.fields_by_name[field].enum_type.values_by_number.get(value)
    return str(value) if found is None else str(found.name)
