"""Checks of login, headers, directory and time sync."""

from __future__ import annotations

import secrets
import time

from bosdyn.api import robot_state_pb2, robot_state_service_pb2_grpc

from fake_robot.conformance.check import Basis, check
from fake_robot.conformance.server import CLIENT_NAME, RPC_TIMEOUT_S, Server, header, status_of

BASE_SERVICES = (
    "auth",
    "auto-return",
    "autowalk-service",
    "data",
    "data-acquisition",
    "data-acquisition-store",
    "data-buffer",
    "directory",
    "directory-registration",
    "docking",
    "estop",
    "fault",
    "graph-nav-service",
    "image",
    "keepalive",
    "lease",
    "license",
    "local-grid-service",
    "log-status",
    "map-processing-service",
    "network-compute-bridge",
    "payload",
    "payload-registration",
    "power",
    "ray-cast",
    "recording-service",
    "robot-command",
    "robot-id",
    "robot-mission",
    "robot-state",
    "spot-check",
    "time-sync",
    "world-objects",
)
"""Names of the services for which the SDK has default clients, or that its examples need of any base robot."""

_SKEW_SLACK_NS = 5_000_000
"""Drift of the clocks and jitter of the estimate."""


@check("Auth.GetAuthToken: password", "a wrong password", "STATUS_INVALID_LOGIN", source="auth.proto")
def wrong_password(server: Server) -> str:
    """Log in with a wrong password."""
    return status_of(server.ask("auth", "GetAuthToken", username=CLIENT_NAME, password=secrets.token_hex(8)))


@check("Auth.GetAuthToken: token", "an unknown token", "STATUS_INVALID_TOKEN", source="auth.proto")
def wrong_token(server: Server) -> str:
    """Renew an unknown token."""
    return status_of(server.ask("auth", "GetAuthToken", token="none"))  # noqa: S106


@check("any call: authorization", "no user token", "UNAUTHENTICATED", source="directory.proto: user_token_required")
def call_without_token(server: Server) -> str:
    """List the directory without a token."""
    server.ask("directory", "ListServiceEntries", stranger_at="api.spot.robot")
    return "OK"


@check("RobotId.GetRobotId", "no user token", "OK", source="SDK: robot.get_id() before authenticate()")
def robot_id_without_token(server: Server) -> str:
    """Ask who the robot is without a token."""
    return "OK" if server.ask("robot-id", "GetRobotId").robot_id.serial_number else "no serial number"


@check("any call: header", "a client's name and time", "echoed", source="header.proto: request_header")
def header_is_echoed(server: Server) -> str:
    """The answer bears the request's header, two times of the robot's clock in order, and code OK."""
    sent = header()
    stub = server.stub(robot_state_service_pb2_grpc.RobotStateServiceStub, "robot-state")
    got = stub.GetRobotState(robot_state_pb2.RobotStateRequest(header=sent), timeout=RPC_TIMEOUT_S).header
    if (got.request_header.client_name, got.request_header.request_timestamp) != (CLIENT_NAME, sent.request_timestamp):
        return "the request's header is not echoed"
    received, answered = got.request_received_timestamp.ToNanoseconds(), got.response_timestamp.ToNanoseconds()
    if not 0 < received <= answered:
        return "the times of receipt and answer are missing or out of order"
    return "echoed" if got.error.code == got.error.CODE_OK else "the error code is not CODE_OK"


@check("Directory.ListServiceEntries", "", "all there", source="SDK: default service clients; spot_wrapper")
def base_services_are_listed(server: Server) -> str:
    """Every service that programs make clients of on a base robot."""
    answer = server.ask("directory", "ListServiceEntries")
    missing = set(BASE_SERVICES) - {entry.name for entry in answer.service_entries}
    return f"missing: {', '.join(sorted(missing))}" if missing else "all there"


@check(
    "Directory.GetServiceEntry: service_name",
    "a name that no service has",
    "STATUS_NONEXISTENT_SERVICE",
    source="directory.proto",
)
def unknown_service(server: Server) -> str:
    """Look up an unknown service."""
    return status_of(server.ask("directory", "GetServiceEntry", service_name="no-such-service"))


@check(
    "DirectoryRegistration.UnregisterService",
    "a name that no service has",
    "STATUS_NONEXISTENT_SERVICE",
    source="directory_registration.proto",
)
def unregister_unknown(server: Server) -> str:
    """Unregister an unknown service."""
    return status_of(server.ask("directory-registration", "UnregisterService", service_name="no-such-service"))


@check(
    "DirectoryRegistration.RegisterService: name",
    "the name of one of the robot's services",
    "STATUS_ALREADY_EXISTS",
    source="directory_registration.proto",
)
def register_taken_name(server: Server) -> str:
    """Register a service under a name that is taken."""
    taken = {"name": "robot-state", "type": "bosdyn.api.RobotStateService", "authority": "robot-state.spot.robot"}
    return status_of(server.ask("directory-registration", "RegisterService", service_entry=taken))


@check(
    "TimeSync.TimeSyncUpdate",
    "the first request of a client",
    "an identifier, STATUS_MORE_SAMPLES_NEEDED",
    source="time_sync.proto: clock_identifier",
)
def first_time_sync(server: Server) -> str:
    """A new client gets an identifier, and is not synchronised yet."""
    answer = server.ask("time-sync", "TimeSyncUpdate")
    return f"{'an' if answer.clock_identifier else 'no'} identifier, {status_of(answer.state)}"


@check(
    "TimeSync.TimeSyncUpdate: previous_round_trip",
    "round trips, until the state is OK",
    "STATUS_OK",
    source="time_sync.proto",
)
def time_sync_is_reached(server: Server) -> str:
    """The SDK's own time sync has finished; its estimate has a skew."""
    response = server.robot.time_sync.endpoint.response
    return "no answer" if response is None else status_of(response.state)


@check(
    "TimeSync.TimeSyncUpdate: clock_skew",
    "a round trip",
    "between its two legs",
    source="time_sync.proto: TimeSyncEstimate",
)
def skew_is_the_clocks(server: Server) -> str:
    """The estimate of the finished time sync is a skew that the times of one more round trip allow."""
    skew_ns = server.robot.time_sync.endpoint.clock_skew.ToNanoseconds()
    sent_ns = time.time_ns()
    told = server.ask("time-sync", "TimeSyncUpdate").header
    most_ns = told.request_received_timestamp.ToNanoseconds() - sent_ns
    least_ns = told.response_timestamp.ToNanoseconds() - time.time_ns()
    off_ns = max(least_ns - skew_ns, skew_ns - most_ns)
    return "between its two legs" if off_ns < _SKEW_SLACK_NS else f"{off_ns * 1e-6:.0f} ms outside"


@check(
    "TimeSync.TimeSyncUpdate: clock_identifier",
    "an identifier that was never given",
    "a new identifier",
    basis=Basis.GUESS,
    source="a robot that was rebooted does not know its clients",
)
def unknown_clock_identifier(server: Server) -> str:
    """A client from before a reboot."""
    answer = server.ask("time-sync", "TimeSyncUpdate", clock_identifier="no-such-client")
    is_new = answer.clock_identifier not in {"", "no-such-client"}
    return "a new identifier" if is_new else f"identifier {answer.clock_identifier!r}"
