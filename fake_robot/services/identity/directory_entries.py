"""The directory: which services the robot has, under which TLS authority, of which type. No gRPC."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field

from bosdyn.api import directory_pb2

from fake_robot.services.authority.liveness import Heartbeat, LivenessClock
from fake_robot.services.calls.stamps import timestamp_from_ns

OWN_SERVICES = {
    # name: (type, authority, is a user token required)
    "auth": ("bosdyn.api.AuthService", "auth.spot.robot", False),
    "data": ("bosdyn.api.DataService", "data.spot.robot", True),
    "data-buffer": ("bosdyn.api.DataBufferService", "buffer.spot.robot", True),
    "directory": ("bosdyn.api.DirectoryService", "api.spot.robot", True),
    "directory-registration": ("bosdyn.api.DirectoryRegistrationService", "api.spot.robot", True),
    "docking": ("bosdyn.api.docking.DockingService", "docking.spot.robot", True),
    "estop": ("bosdyn.api.EstopService", "estop.spot.robot", True),
    "fault": ("bosdyn.api.FaultService", "fault.spot.robot", True),
    "image": ("bosdyn.api.ImageService", "api.spot.robot", True),
    "keepalive": ("bosdyn.api.keepalive.KeepaliveService", "keepalive.spot.robot", True),
    "lease": ("bosdyn.api.LeaseService", "api.spot.robot", True),
    "license": ("bosdyn.api.LicenseService", "api.spot.robot", True),
    "local-grid-service": ("bosdyn.api.LocalGridService", "localgrid.spot.robot", True),
    "log-status": ("bosdyn.api.log_status.LogStatusService", "log-status.spot.robot", True),
    "payload": ("bosdyn.api.PayloadService", "payload.spot.robot", True),
    "payload-registration": (
        "bosdyn.api.PayloadRegistrationService",
        "payload-registration.spot.robot",
        False,
    ),
    "point-cloud": ("bosdyn.api.PointCloudService", "api.spot.robot", True),
    "power": ("bosdyn.api.PowerService", "power.spot.robot", True),
    "ray-cast": ("bosdyn.api.RayCastService", "ray-cast.spot.robot", True),
    "robot-command": ("bosdyn.api.RobotCommandService", "command.spot.robot", True),
    "robot-command-streaming": (
        "bosdyn.api.RobotCommandStreamingService",
        "command-streaming.spot.robot",
        True,
    ),
    "robot-id": ("bosdyn.api.RobotIdService", "id.spot.robot", False),
    "robot-state": ("bosdyn.api.RobotStateService", "state.spot.robot", True),
    "robot-state-streaming": (
        "bosdyn.api.RobotStateStreamingService",
        "state-streaming.spot.robot",
        True,
    ),
    "time-sync": ("bosdyn.api.TimeSyncService", "api.spot.robot", True),
    "world-objects": ("bosdyn.api.WorldObjectService", "world-objects.spot.robot", True),
}
LISTED_ONLY = {
    # Every robot lists these, so programs make clients of them at start; most calls to them are UNIMPLEMENTED here.
    "auto-return": ("bosdyn.api.auto_return.AutoReturnService", "auto-return.spot.robot"),
    "autowalk-service": ("bosdyn.api.autowalk.AutowalkService", "autowalk.spot.robot"),
    "choreography": ("bosdyn.api.spot.ChoreographyService", "choreography.spot.robot"),
    "data-acquisition": ("bosdyn.api.DataAcquisitionService", "data-acquisition.spot.robot"),
    "data-acquisition-store": ("bosdyn.api.DataAcquisitionStoreService", "data-acquisition-store.spot.robot"),
    "door": ("bosdyn.api.spot.DoorService", "door.spot.robot"),
    "gps-aggregator": ("bosdyn.api.gps.AggregatorService", "gps-aggregator.spot.robot"),
    "gps-registration": ("bosdyn.api.gps.RegistrationService", "gps-registration.spot.robot"),
    "graph-nav-service": ("bosdyn.api.graph_nav.GraphNavService", "graph-nav.spot.robot"),
    "hazard-avoidance-service": ("bosdyn.api.HazardAvoidanceService", "hazard-avoidance.spot.robot"),
    "inverse-kinematics": ("bosdyn.api.spot.InverseKinematicsService", "inverse-kinematics.spot.robot"),
    "ir-enable-disable-service": ("bosdyn.api.IREnableDisableService", "ir-enable-disable.spot.robot"),
    "map-processing-service": ("bosdyn.api.graph_nav.MapProcessingService", "map-processing.spot.robot"),
    "metrics-logging": ("bosdyn.api.metrics_logging.MetricsLoggingRobotService", "metrics-logging.spot.robot"),
    "network-compute-bridge": ("bosdyn.api.NetworkComputeBridge", "network-compute-bridge.spot.robot"),
    "payload-software-update": ("bosdyn.api.PayloadSoftwareUpdateService", "payload-software-update.spot.robot"),
    "payload-software-update-initiation": (
        "bosdyn.api.PayloadSoftwareUpdateInitiationService",
        "payload-software-update-initiation.spot.robot",
    ),
    "recording-service": ("bosdyn.api.graph_nav.GraphNavRecordingService", "recording.spot.robot"),
    "robot-mission": ("bosdyn.api.mission.MissionService", "robot-mission.spot.robot"),
    "spot-check": ("bosdyn.api.spot.SpotCheckService", "check.spot.robot"),
}
TOKENLESS_TYPES = frozenset(kind for kind, _, needs_token in OWN_SERVICES.values() if not needs_token)


@dataclass
class DirectoryEntries:
    """The robot's own services, and those that clients registered. Thread-safe."""

    clock: LivenessClock
    _registered: dict[str, directory_pb2.ServiceEntry] = field(default_factory=dict)
    _heartbeats: dict[str, Heartbeat] = field(default_factory=dict)
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

    def register(self, entry: directory_pb2.ServiceEntry) -> bool:
        """Add a client's service; False if the name is taken."""
        with self._lock:
            if entry.name in OWN_SERVICES or entry.name in LISTED_ONLY or entry.name in self._registered:
                return False
            self._store(entry)
            return True

    def update(self, entry: directory_pb2.ServiceEntry) -> bool:
        """Replace a client's service; False if there is none of that name."""
        with self._lock:
            if entry.name not in self._registered:
                return False
            self._store(entry)
            return True

    def unregister(self, name: str) -> bool:
        """Drop a client's service; False if there is none of that name."""
        with self._lock:
            self._heartbeats.pop(name, None)
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
