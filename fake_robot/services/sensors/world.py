"""What the services share: the robot, and the records of who may do what with it."""

from __future__ import annotations

import secrets
import time

from bosdyn.api.keepalive import keepalive_pb2

from fake_robot.network.status import EstopLevel, MotorPower
from fake_robot.robot.robot import Robot
from fake_robot.scenario.parts import ServicesConfig
from fake_robot.services.authority.estop_endpoints import CUT, NONE, SETTLE_THEN_CUT, EstopEndpoints
from fake_robot.services.authority.keepalive import KeepalivePolicies
from fake_robot.services.authority.lease_records import LeaseRecords
from fake_robot.services.authority.liveness import LivenessClock
from fake_robot.services.calls.link import Link
from fake_robot.services.identity.directory_entries import DirectoryEntries
from fake_robot.services.identity.payload import RegisteredPayloads
from fake_robot.services.identity.time_sync_clients import TimeSyncClients
from fake_robot.services.identity.tokens import Credentials, TokenMint
from fake_robot.services.reports.data_buffer import DataBuffer
from fake_robot.services.reports.fault import ServiceFaults, liveness_fault
from fake_robot.services.reports.log_status import LogBook

_LEVELS = {NONE: EstopLevel.NONE, SETTLE_THEN_CUT: EstopLevel.SETTLE_THEN_CUT, CUT: EstopLevel.CUT}


class World:
    """One robot and everything that its services remember.

    ``tick`` brings time-outs to the robot: e-stop endpoints and leases of silent clients, keep-alive policies.
    """

    def __init__(self, robot: Robot, config: ServicesConfig, credentials: Credentials) -> None:
        self.robot = robot
        self.config = config
        self.now_ns = robot.clock.now_ns
        liveness = LivenessClock(
            self.now_ns,
            robot.clock.elapsed_ns,
            needs_both=robot.is_lock_step and config.liveness_clock == "both",
        )
        self.link = Link()
        self.tokens = TokenMint(
            credentials,
            serial_number=config.serial_number,
            lifetime_s=config.token_lifetime_s,
            max_failed_logins=config.max_failed_logins,
            lockout_s=config.lockout_s,
        )
        self.directory = DirectoryEntries(liveness)
        self.time_sync = TimeSyncClients(config.time_sync_samples, uses_newest=robot.is_lock_step)
        self.leases = LeaseRecords(liveness, epoch=secrets.token_hex(8), timeout_s=config.lease_timeout_s)
        self.estop = EstopEndpoints(
            liveness,
            cut_after_settle_s=config.estop_cut_after_settle_s,
            are_motors_on=self.are_motors_on,
            has_operator=config.operator_estop,
        )
        self.keepalive = KeepalivePolicies(liveness)
        self.payloads = RegisteredPayloads()
        self.service_faults = ServiceFaults(self.now_ns)
        self.notes = DataBuffer(self.now_ns)
        self.logs = LogBook(self.now_ns)
        self.license_state: str = config.joint_control_license
        self._silent_services: frozenset[str] = frozenset()
        self.stepped_s = time.monotonic()
        """When robot time was last made to pass, by the host's clock; of a robot in lock-step."""
        self.is_wifi_on = True
        self.are_payload_ports_on = True

    def are_motors_on(self) -> bool:
        """Whether the motors have power, or are about to."""
        return self.robot.snapshot().motor_power in {MotorPower.ON, MotorPower.POWERING_ON}

    def apply_estop(self) -> None:
        """Bring the e-stop's level to the robot."""
        self.robot.set_estop_level(_LEVELS[self.estop.level()])

    def tick(self) -> None:
        """Act on whoever has fallen silent. Cheap; called some twenty times a second and after every step."""
        self.apply_estop()
        if self.leases.expire():
            self._on_lease_expiry()
        for action in self.keepalive.due():
            self._take_action(action)
        self._watch_services()

    def expire_lease(self) -> None:
        """Treat the holder of the lease as one that fell silent."""
        self.leases.revoke()
        self._on_lease_expiry()

    def reboot(self) -> None:
        """Cut the motors, forget every client, and be away for as long as the configuration says."""
        self.robot.power_off()
        self.tokens.revoke_all()
        self.leases.reset(secrets.token_hex(8))
        self.estop.reset()
        self.time_sync.reset()
        self.keepalive.reset()
        self.link.cut(self.config.reboot_s, "the robot is rebooting")

    def _on_lease_expiry(self) -> None:
        if not self.are_motors_on():
            return
        if self.config.on_lease_expiry == "safe_power_off":
            self.robot.safe_power_off()
        elif self.config.on_lease_expiry == "stop":
            self.robot.stop_motion()

    def _watch_services(self) -> None:
        """A client's service that falls silent is a service fault until it is heard again, or unregistered."""
        silent = self.directory.silent()
        for name in silent - self._silent_services:
            self.service_faults.trigger(liveness_fault(name))
        for name in self._silent_services - silent:
            fault_id = liveness_fault(name).fault_id
            self.service_faults.clear(lambda other, wanted=fault_id: other == wanted)  # type: ignore[misc]
        self._silent_services = silent

    def _take_action(self, action: keepalive_pb2.ActionAfter) -> None:
        kind = action.WhichOneof("action")
        if kind == "controlled_motors_off":
            self.robot.safe_power_off()
        elif kind == "immediate_motors_off":
            self.robot.power_off()
        elif kind == "immediate_robot_off":
            self.reboot()
        elif kind == "lease_stale":
            self.leases.revoke()
        elif kind == "halt_robot":
            self.robot.stop_motion()
        elif kind == "record_event":
            with self.notes.lock:
                self.notes.events.extend(action.record_event.events)
