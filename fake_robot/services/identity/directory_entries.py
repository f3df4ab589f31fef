"""The directory: which services the robot has, under which TLS authority, of which type. No gRPC."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field

from bosdyn.api import directory_pb2

from fake_robot.services.authority.liveness import Heartbeat, LivenessClock
from fake_robot.services.calls.stamps import timestamp_from_ns

_API, _HOST = "bosdyn.api.", ".spot.robot"
_OWN = {
    # name: (type, authority, is a user token required)
    "auth": ("AuthService", "auth", False),
    "data": ("DataService", "data", True),
    "data-buffer": ("DataBufferService", "buffer", True),
    "directory": ("DirectoryService", "api", True),
    "directory-registration": ("DirectoryRegistrationService", "api", True),
    "docking": ("docking.DockingService", "docking", True),
    "estop": ("EstopService", "estop", True),
    "fault": ("FaultService", "fault", True),
    "image": ("ImageService", "api", True),
    "keepalive": ("keepalive.KeepaliveService", "keepalive", True),
    "lease": ("LeaseService", "api", True),
    "license": ("LicenseService", "api", True),
    "local-grid-service": ("LocalGridService", "localgrid", True),
    "log-status": ("log_status.LogStatusService", "log-status", True),
    "payload": ("PayloadService", "payload", True),
    "payload-registration": ("PayloadRegistrationService", "payload-registration", False),
    "point-cloud": ("PointCloudService", "api", True),
    "power": ("PowerService", "power", True),
    "ray-cast": ("RayCastService", "ray-cast", True),
    "robot-command": ("RobotCommandService", "command", True),
    "robot-command-streaming": ("RobotCommandStreamingService", "command-streaming", True),
    "robot-id": ("RobotIdService", "id", False),
    "robot-state": ("RobotStateService", "state", True),
    "robot-state-streaming": ("RobotStateStreamingService", "state-streaming", True),
    "time-sync": ("TimeSyncService", "api", True),
    "world-objects": ("WorldObjectService", "world-objects", True),
}
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
OWN_SERVICES = {name: (_API + kind, host + _HOST, needs_token) for name, (kind, host, needs_token) in _OWN.items()}
LISTED_ONLY = {name: (_API + kind, host + _HOST) for name, (kind, host) in _LISTED_ONLY.items()}
TOKENLESS_TYPES = frozenset(kind for kind, _, needs_token in OWN_SERVICES.values() if not needs_token)


@dataclass
class DirectoryEntries:
    """The robot's own services, and those that clients registered. Thread-safe."""

    clock: LivenessClock
    _registered: dict[str, directory_pb2.ServiceEntry] = field(default_factory=dict)
    _heartbeats: dict[str, Heartbeat] = field(default_factory=dict)
    _addresses: dict[str, str] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self) -> None:
        self._started_robot_stamp_ns = self.clock.beat().robot_stamp_ns

    def entries(self) -> list[directory_pb2.ServiceEntry]:
        """Every entry, by name."""
        with self._lock:
            everything = [self._own(name) for name in (*OWN_SERVICES, *LISTED_ONLY)] + list(self._registered.values())
        return sorted(everything, key=lambda entry: str(entry.name))

    def entry(self, name: str) -> directory_pb2.ServiceEntry | None:
        """The entry of that name, or None."""
        with self._lock:
            is_own = name in OWN_SERVICES or name in LISTED_ONLY
            return self._own(name) if is_own else self._registered.get(name)

    def address_of_type(self, kind: str) -> str:
        """Where a client's service of a type is reached, host and port; empty if none, or several, are registered."""
        with self._lock:
            found = {self._addresses.get(name, "") for name, entry in self._registered.items() if entry.type == kind}
        return found.pop() if len(found) == 1 else ""

    def register(self, entry: directory_pb2.ServiceEntry, address: str = "") -> bool:
        """Add a client's service, reached at an address; False if the name is taken."""
        with self._lock:
            if entry.name in OWN_SERVICES or entry.name in LISTED_ONLY or entry.name in self._registered:
                return False
            self._store(entry)
            self._addresses[entry.name] = address
            return True

    def update(self, entry: directory_pb2.ServiceEntry, address: str = "") -> bool:
        """Replace a client's service; False if there is none of that name."""
        with self._lock:
            if entry.name not in self._registered:
                return False
            self._store(entry)
            self._addresses[entry.name] = address or self._addresses[entry.name]
            return True

    def unregister(self, name: str) -> bool:
        """Drop a client's service; False if there is none of that name."""
        with self._lock:
            self._heartbeats.pop(name, None)
            self._addresses.pop(name, None)
            return self._registered.pop(name, None) is not None

    def silent(self) -> frozenset[str]:
        """Clients' services that have not been registered or updated for longer than their liveness time-out."""
        with self._lock:
            return frozenset(
                name
                for name, entry in self._registered.items()
                if 0.0 < entry.liveness_timeout_secs < self.clock.elapsed_s(self._heartbeats[name])
            )

    def _store(self, entry: directory_pb2.ServiceEntry) -> None:
        kept = directory_pb2.ServiceEntry()
        kept.CopyFrom(entry)
        heartbeat = self.clock.beat()
        kept.last_update.CopyFrom(timestamp_from_ns(heartbeat.robot_stamp_ns))
        self._heartbeats[kept.name] = heartbeat
        self._registered[kept.name] = kept

    def _own(self, name: str) -> directory_pb2.ServiceEntry:
        kind, authority, needs_token = OWN_SERVICES.get(name) or (*LISTED_ONLY[name], True)
        entry = directory_pb2.ServiceEntry(name=name, type=kind, authority=authority, user_token_required=needs_token)
        entry.last_update.CopyFrom(timestamp_from_ns(self._started_robot_stamp_ns))
        return entry
