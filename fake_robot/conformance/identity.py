"""Checks of login, headers, directory, licence and time sync."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import grpc
from bosdyn.api import header_pb2
from google.protobuf.timestamp_pb2 import Timestamp

from fake_robot.conformance.check import Basis, check
from fake_robot.conformance.power import wait_for
from fake_robot.conformance.recording import RecordedPart, record_rest
from fake_robot.conformance.server import FEATURE, RPC_TIMEOUT_S, OpenError, Server, stamp_ns, status_of

# fmt: off
BASE_SERVICES = (
    "auth", "auto-return", "autowalk-service", "data", "data-acquisition", "data-acquisition-store", "data-buffer",
    "directory", "directory-registration", "docking", "estop", "fault", "graph-nav-service", "image", "keepalive",
    "lease", "license", "local-grid-service", "log-status", "map-processing-service", "network-compute-bridge",
    "payload", "payload-registration", "power", "ray-cast", "recording-service", "robot-command",
    "robot-command-streaming", "robot-id", "robot-mission", "robot-state", "robot-state-streaming", "spot-check",
    "time-sync", "world-objects",
)
# fmt: on
"""Names of the services for which the SDK has default clients, or that its examples need of any base robot."""

_SYNCED = "more samples needed, then OK, by one identifier"
_SKEW_SLACK_NS = 5_000_000
"""Drift of the clocks and jitter of the estimate."""
_NEAR_NS = 10**9
_OLD_NS, _OLD_FOR_S = 40_000_000, 5.0
"""Age of the youngest state, older ones stop a run; and for how long, because a busy server may lag for a while."""
_FOREIGN_STAMPS = {"request_timestamp", "onset_timestamp", "changeset_date", "not_valid_before", "not_valid_after"}
_FOREIGN_STAMPS |= {"received_timestamp"}  # of the last command, whenever that was
_READS = (
    ("directory", "ListServiceEntries"),
    ("estop", "GetEstopConfig"),
    ("estop", "GetEstopSystemStatus"),
    ("lease", "ListLeases"),
    ("robot-id", "GetRobotId"),
    ("robot-state", "GetRobotHardwareConfiguration"),
    ("robot-state", "GetRobotMetrics"),
    ("robot-state", "GetRobotState"),
    ("time-sync", "TimeSyncUpdate"),
)


def _ask_reads(server: Server) -> None:
    """Ask every call that only reads; one that fails tells so by its own error."""
    for service, method in _READS:
        server.ask(service, method)


@check("any call: header.request_header", "a client's name and time", "echoed", source="header.proto")
def header_is_echoed(server: Server) -> str:
    """Every answer so far, and those of the calls that read, bear their request's header."""
    server.once(_ask_reads)
    wrong = [told.method for told in server.answered if told.header.request_header != told.sent]
    return f"{wrong[0]}: not the request's header" if wrong else "echoed"


@check("calls that read: header.error.code", "", "CODE_OK", source="header.proto")
def reads_succeed(server: Server) -> str:
    """An answer without a code is an error to the SDK."""
    server.once(_ask_reads)
    names = {method for _, method in _READS}
    for told in server.answered:
        if told.method in names and told.header.error.code != header_pb2.CommonError.CODE_OK:
            return f"{told.method}: {header_pb2.CommonError.Code.Name(told.header.error.code)}"
    return "CODE_OK"


@check("any call: header times", "", "in order, of the robot's clock", source="header.proto; time_sync.proto")
def header_times_are_the_robots(server: Server) -> str:
    """Received before answered, and between sending and receiving by the clock that the other answers tell."""
    server.once(_ask_reads)
    times = [
        (told, stamp_ns(told.header.request_received_timestamp), stamp_ns(told.header.response_timestamp))
        for told in server.answered
    ]
    for told, received, answered in times:
        if not 0 < received <= answered:
            return f"{told.method}: missing or out of order"
    ahead_ns = server.sync.ahead_ns
    for told, received, answered in times:
        if received - ahead_ns < told.sent_ns - _NEAR_NS or answered - ahead_ns > told.received_ns + _NEAR_NS:
            return f"{told.method}: {(answered - ahead_ns - told.received_ns) * 1e-9:.1f} s off"
    return "in order, of the robot's clock"


def _stamps_in(message: Any, path: str) -> Iterator[tuple[str, int]]:
    """Every timestamp of a message that is set, but those of other clocks and times."""
    for descriptor, value in message.ListFields():
        kind, name = descriptor.message_type, f"{path}.{descriptor.name}"
        if kind is None or kind.GetOptions().map_entry or descriptor.name in _FOREIGN_STAMPS:
            continue
        for part in value if descriptor.is_repeated else [value]:
            yield from [(name, stamp_ns(part))] if isinstance(part, Timestamp) else _stamps_in(part, name)


def _age_ns(server: Server, recording: RecordedPart) -> int:
    """Of the youngest state when it came, or of its last packet if that is older."""
    ages = []
    for state, at_ns in zip(recording.states, recording.arrived_ns, strict=True):
        told = [state.joint_states.acquisition_timestamp, *(p.timestamp for p in state.inertial_state.packets[-1:])]
        ages.append(at_ns + server.sync.ahead_ns - min(map(stamp_ns, told)))
    return min(ages)


@check("every stamp of a state", "a robot at rest", "the robot's clock", source="robot_state.proto; time_sync.proto")
def stamps_are_robot_time(server: Server) -> str:
    """Every stamp of streamed and polled states is of the instant at which it came, by the robot's clock."""
    recording, sync = server.once(record_rest), server.sync
    for name, message, arrived_ns in (
        ("streamed", recording.states[-1], recording.arrived_ns[-1]),
        ("polled", recording.polls[-1], recording.polled_ns[-1]),
    ):
        for path, told_ns in _stamps_in(message, name):
            off_ns = told_ns - arrived_ns - sync.ahead_ns
            if abs(off_ns) > _NEAR_NS:
                return f"{path}: {off_ns * 1e-9:.1f} s off"
    age_ns = wait_for(lambda: _age_ns(server, record_rest(server)), lambda seen: seen < _OLD_NS, _OLD_FOR_S)
    if age_ns > _OLD_NS:
        return f"the youngest state or its packets are {age_ns * 1e-6:.0f} ms old when they come"
    return "the robot's clock"


@check("any call: authorization", "no user token", "as the directory says", source="directory.proto")
def token_is_asked_for_as_listed(server: Server) -> str:
    """The state needs a token and the robot's name none, as the directory says; nothing is told to a stranger."""
    for name, method in (
        ("robot-state", "GetRobotState"),
        ("directory", "ListServiceEntries"),
        ("robot-id", "GetRobotId"),
    ):
        server.require(name)
        try:
            server.ask(name, method, stranger_at=server.listed[name].authority)
            is_needed = False
        except grpc.RpcError as error:
            is_needed = error.code() == grpc.StatusCode.UNAUTHENTICATED
        if is_needed != server.listed[name].user_token_required or is_needed == (name == "robot-id"):
            return f"{name}: {'asked for' if is_needed else 'served without'}"
    return "as the directory says"


@check("robot-id.GetRobotId", "asked twice, without a user token", "one robot", source="robot_id.proto")
def robot_id_stays(server: Server) -> str:
    """Serial number, species and version are there, and the same each time."""
    first, second = (server.ask("robot-id", "GetRobotId").robot_id for _ in range(2))
    if not (first.serial_number and first.species and first.software_release.version.major_version):
        return "something is missing"
    return "one robot" if first == second else "two robots"


@check("license.GetLicenseInfo, GetFeatureEnabled", "", "one licence, of this robot", source="license.proto")
def licence_is_this_robots(server: Server) -> str:
    """A status; if it is valid, this robot's number and the present time; and whether a feature is licensed."""
    told = server.ask("license", "GetLicenseInfo").license
    if not told.status:
        return "no status"
    if told.status == told.STATUS_VALID:
        serial = server.ask("robot-id", "GetRobotId").robot_id.serial_number
        if told.robot_serial != serial:
            return f"valid, and of {told.robot_serial or 'no robot'}"
        now_ns, until_ns = stamp_ns(server.robot_stamp(0.0)), stamp_ns(told.not_valid_after)
        if stamp_ns(told.not_valid_before) > now_ns or (until_ns and until_ns < now_ns):
            return "valid, but not at present"
    enabled = server.ask("license", "GetFeatureEnabled", feature_codes=[FEATURE]).feature_enabled
    return "one licence, of this robot" if FEATURE in enabled else "does not say whether a feature is licensed"


@check("directory.ListServiceEntries, GetServiceEntry", "", "all there, of the SDK's types", source="SDK: its clients")
def services_are_listed(server: Server) -> str:
    """Every service that programs make clients of on a base robot; each of its type, and looked up as listed."""
    if missing := set(BASE_SERVICES) - set(server.listed):
        return f"missing: {', '.join(sorted(missing))}"
    for name, listed in server.listed.items():
        if listed.type != server.types.get(name, listed.type) or not listed.authority:
            return f"{name}: {listed.type} at {listed.authority or 'no authority'}"
        found = server.ask("directory", "GetServiceEntry", service_name=name).service_entry
        if (found.name, found.type, found.authority) != (listed.name, listed.type, listed.authority):
            return f"{name}: looked up, it is {found.name or 'nothing'}, {found.type}"
    return "all there, of the SDK's types"


@check("any call: method", "a method of no service", "UNIMPLEMENTED", source="gRPC: status codes")
def unknown_method(server: Server) -> str:
    """Call what is not there."""
    call = server.channel("robot-state").unary_unary("/bosdyn.api.NoSuchService/NoSuchMethod")
    call(b"", timeout=RPC_TIMEOUT_S)
    return "OK"


@check("time-sync.TimeSyncUpdate", "round trips", _SYNCED, source="time_sync.proto")
def time_sync_is_reached(server: Server) -> str:
    """A new client gets an identifier, which stays, and is synchronised after some round trips, but not before."""
    answers = server.sync.answers
    if len({a.clock_identifier for a in answers} - {""}) != 1:
        return "no identifier, or several"
    if status_of(answers[0].state) != "STATUS_MORE_SAMPLES_NEEDED":
        return f"{status_of(answers[0].state)} at once"
    if not server.sync.is_established:
        return f"{status_of(answers[-1].state)} after {len(answers)} round trips"
    return _SYNCED


@check("time-sync: best_estimate", "", "what the round trips allow", source="time_sync.proto: TimeSyncEstimate")
def estimate_is_the_clocks(server: Server) -> str:
    """The skew lies between the two legs of the shortest trip; a round trip takes some time, but not the longest."""
    sync = server.sync
    if not sync.is_established:
        raise OpenError("time sync is not reached")
    best = sync.answers[-1].state.best_estimate
    skew_ns, trip_ns = stamp_ns(best.clock_skew), stamp_ns(best.round_trip_time)
    off_ns = max(sync.least_ns - skew_ns, skew_ns - sync.most_ns)
    if off_ns > _SKEW_SLACK_NS:
        return f"a skew {off_ns * 1e-6:.0f} ms outside"
    longest_ns = max(t.received_ns - t.sent_ns for t in server.answered if t.method == "TimeSyncUpdate")
    is_possible = 0 <= trip_ns <= longest_ns + _SKEW_SLACK_NS
    return "what the round trips allow" if is_possible else f"a round trip of {trip_ns * 1e-6:.1f} ms"


@check("time-sync: clock_identifier", "two new clients", "two identifiers", source="time_sync.proto")
def identifiers_differ(server: Server) -> str:
    """Each client gets an identifier of its own."""
    first, second = (server.ask("time-sync", "TimeSyncUpdate") for _ in range(2))
    return "two identifiers" if first.clock_identifier != second.clock_identifier else "one identifier"


@check("time-sync: clock_identifier", "one never given", "a new one", basis=Basis.GUESS, source="as after a reboot")
def unknown_clock_identifier(server: Server) -> str:
    """A client from before a reboot."""
    told = server.ask("time-sync", "TimeSyncUpdate", clock_identifier="no-such-client").clock_identifier
    return "a new one" if told not in {"", "no-such-client"} else f"identifier {told!r}"
