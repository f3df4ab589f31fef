"""The directory: which services there are, under which TLS authority, of which type; and adding one's own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import grpc
from bosdyn.api import directory_pb2, directory_registration_service_pb2, directory_service_pb2

from fake_robot.services.authority.liveness import Heartbeat, LivenessClock
from fake_robot.services.calls import Service, refusing, timestamp_from_ns

_API, _HOST = "bosdyn.api.", ".spot.robot"
_OWN = {
    "auth": ("AuthService", "auth"),
    "data": ("DataService", "data"),
    "data-buffer": ("DataBufferService", "buffer"),
    "directory": ("DirectoryService", "api"),
    "directory-registration": ("DirectoryRegistrationService", "api"),
    "docking": ("docking.DockingService", "docking"),
    "estop": ("EstopService", "estop"),
    "fault": ("FaultService", "fault"),
    "image": ("ImageService", "api"),
    "keepalive": ("keepalive.KeepaliveService", "keepalive"),
    "lease": ("LeaseService", "api"),
    "license": ("LicenseService", "api"),
    "local-grid-service": ("LocalGridService", "localgrid"),
    "log-status": ("log_status.LogStatusService", "log-status"),
    "payload": ("PayloadService", "payload"),
    "payload-registration": ("PayloadRegistrationService", "payload-registration"),
    "point-cloud": ("PointCloudService", "api"),
    "power": ("PowerService", "power"),
    "ray-cast": ("RayCastService", "ray-cast"),
    "robot-command": ("RobotCommandService", "command"),
    "robot-command-streaming": ("RobotCommandStreamingService", "command-streaming"),
    "robot-id": ("RobotIdService", "id"),
    "robot-state": ("RobotStateService", "state"),
    "robot-state-streaming": ("RobotStateStreamingService", "state-streaming"),
    "time-sync": ("TimeSyncService", "api"),
    "world-objects": ("WorldObjectService", "world-objects"),
}
"""Type and authority by name."""
_LISTED_ONLY = {
    # Every robot lists these, so programs make clients of them at start; most calls to them are UNIMPLEMENTED here.
    "auto-return": ("auto_return.AutoReturnService", "auto-return"),
    "autowalk-service": ("autowalk.AutowalkService", "autowalk"),
    "choreography": ("spot.ChoreographyService", "choreography"),
    "data-acquisition": ("DataAcquisitionService", "data-acquisition"),
    "data-acquisition-store": ("DataAcquisitionStoreService", "data-acquisition-store"),
    "door": ("spot.DoorService", "door"),
    "gps-aggregator": ("gps.AggregatorService", "gps-aggregator"),
    "gps-registration": ("gps.RegistrationService", "gps-registration"),
    "graph-nav-service": ("graph_nav.GraphNavService", "graph-nav"),
    "hazard-avoidance-service": ("HazardAvoidanceService", "hazard-avoidance"),
    "inverse-kinematics": ("spot.InverseKinematicsService", "inverse-kinematics"),
    "ir-enable-disable-service": ("IREnableDisableService", "ir-enable-disable"),
    "map-processing-service": ("graph_nav.MapProcessingService", "map-processing"),
    "metrics-logging": ("metrics_logging.MetricsLoggingRobotService", "metrics-logging"),
    "network-compute-bridge": ("NetworkComputeBridge", "network-compute-bridge"),
    "payload-software-update": ("PayloadSoftwareUpdateService", "payload-software-update"),
    "payload-software-update-initiation": (
        "PayloadSoftwareUpdateInitiationService",
        "payload-software-update-initiation",
    ),
    "recording-service": ("graph_nav.GraphNavRecordingService", "recording"),
    "robot-mission": ("mission.MissionService", "robot-mission"),
    "spot-check": ("spot.SpotCheckService", "check"),
}
OWN_SERVICES = {name: (_API + kind, host + _HOST) for name, (kind, host) in _OWN.items()}
LISTED = OWN_SERVICES | {name: (_API + kind, host + _HOST) for name, (kind, host) in _LISTED_ONLY.items()}
TOKENLESS_TYPES = frozenset(OWN_SERVICES[name][0] for name in ("auth", "payload-registration", "robot-id"))
"""Types of the services that need no user token."""
_OF_THE_TRANSPORT = ("grpc-", "user-agent", ":")


class DirectoryService(Service):
    """Lists the robot's own services and those of clients, whose calls are passed on to them."""

    modules = (directory_service_pb2, directory_registration_service_pb2)

    def __init__(self, clock: LivenessClock) -> None:
        super().__init__()
        self._clock = clock
        self._registered: dict[str, directory_pb2.ServiceEntry] = {}
        self._heartbeats: dict[str, Heartbeat] = {}
        self._addresses: dict[str, str] = {}
        started = timestamp_from_ns(clock.beat().robot_stamp_ns)
        self._own = {
            name: directory_pb2.ServiceEntry(
                name=name,
                type=kind,
                authority=authority,
                user_token_required=kind not in TOKENLESS_TYPES,
                last_update=started,
            )
            for name, (kind, authority) in LISTED.items()
        }

    def ListServiceEntries(self, request: Any, response: Any) -> None:  # noqa: N802
        """List every entry, by name."""
        listed = self._own | self._registered
        response.service_entries.extend(listed[name] for name in sorted(listed))

    def GetServiceEntry(self, request: Any, response: Any) -> None:  # noqa: N802
        """Look one entry up by name."""
        entry = (self._own | self._registered).get(request.service_name)
        response.status = response.STATUS_OK if entry else response.STATUS_NONEXISTENT_SERVICE
        if entry:
            response.service_entry.CopyFrom(entry)

    def RegisterService(self, request: Any, response: Any) -> None:  # noqa: N802
        """Add a client's service."""
        name = request.service_entry.name
        if name in self._own or name in self._registered:
            response.status = response.STATUS_ALREADY_EXISTS
            return
        self._store(request)
        response.status = response.STATUS_OK

    def UpdateService(self, request: Any, response: Any) -> None:  # noqa: N802
        """Replace a client's service."""
        if request.service_entry.name not in self._registered:
            response.status = response.STATUS_NONEXISTENT_SERVICE
            return
        self._store(request)
        response.status = response.STATUS_OK

    def UnregisterService(self, request: Any, response: Any) -> None:  # noqa: N802
        """Drop a client's service."""
        known = self._registered.pop(request.service_name, None)
        response.status = response.STATUS_OK if known else response.STATUS_NONEXISTENT_SERVICE

    def address_of_type(self, kind: str) -> str:
        """Where a client's service of a type is reached, host and port; empty if none, or several, are registered."""
        with self.lock:
            found = {self._addresses[name] for name, entry in self._registered.items() if entry.type == kind}
        return found.pop() if len(found) == 1 else ""

    def silent(self) -> frozenset[str]:
        """Clients' services that have not been registered or updated for longer than their liveness time-out."""
        with self.lock:
            return frozenset(
                name
                for name, entry in self._registered.items()
                if 0.0 < entry.liveness_timeout_secs < self._clock.elapsed_s(self._heartbeats[name])
            )

    def _store(self, request: Any) -> None:
        kept, endpoint = request.service_entry, request.endpoint
        self._heartbeats[kept.name] = self._clock.beat()
        kept.last_update.CopyFrom(timestamp_from_ns(self._heartbeats[kept.name].robot_stamp_ns))
        if endpoint.host_ip and endpoint.port:
            self._addresses[kept.name] = f"{endpoint.host_ip}:{endpoint.port}"
        elif kept.name not in self._registered:
            self._addresses[kept.name] = ""
        self._registered[kept.name] = kept


class UnknownServiceHandler(grpc.GenericRpcHandler):
    """Answers for every method that no service took: passes it on to a client's service of that type, or refuses it.

    ``address_of_type`` gives host and port of the one service of a type that a client registered, or nothing.
    """

    def __init__(self, address_of_type: Callable[[str], str]) -> None:
        self._address_of_type = address_of_type

    def service(self, handler_call_details: grpc.HandlerCallDetails) -> grpc.RpcMethodHandler[Any, Any]:
        """Pass the call on, or refuse it with UNIMPLEMENTED, saying what there is."""
        service, _, method = handler_call_details.method.lstrip("/").rpartition("/")
        address = self._address_of_type(service)
        if address:
            return grpc.stream_stream_rpc_method_handler(_passing_on(handler_call_details, address))
        types = sorted({kind for kind, _ in OWN_SERVICES.values()})
        told = (
            f"{service} has no method {method!r}"
            if service in types
            else f"the fake robot has no service {service!r}; it has {', '.join(types)}"
        )
        return refusing(grpc.StatusCode.UNIMPLEMENTED, told)


def _passing_on(details: grpc.HandlerCallDetails, address: str) -> Callable[[Any, grpc.ServicerContext], Any]:
    """Pass the bytes of a call on to a server without TLS, as a robot does, and its answers back."""
    metadata = tuple((k, v) for k, v in details.invocation_metadata or () if not k.startswith(_OF_THE_TRANSPORT))

    def pass_on(requests: Any, context: grpc.ServicerContext) -> Any:
        with grpc.insecure_channel(address) as channel:
            call: Any = channel.stream_stream(details.method)
            answers = call(requests, metadata=metadata, timeout=context.time_remaining())
            context.add_callback(answers.cancel)
            try:
                yield from answers
            except grpc.RpcError as refusal:
                told: Any = refusal
                context.abort(told.code(), f"{address}, a registered service: {told.details()}")

    return pass_on
