"""What the services share: the robot, and the services that remember who may do what with it."""

from __future__ import annotations

import secrets
import time
from typing import Any

from bosdyn.api.keepalive import keepalive_pb2

from fake_robot.network.status import MotorPower
from fake_robot.robot.robot import Robot
from fake_robot.scenario.parts import ServicesConfig
from fake_robot.services.auth import AuthService, Credentials
from fake_robot.services.authority.estop import EstopService
from fake_robot.services.authority.keepalive import KeepaliveService
from fake_robot.services.authority.lease import LeaseService
from fake_robot.services.authority.liveness import LivenessClock
from fake_robot.services.directory import DirectoryService
from fake_robot.services.gate import Link
from fake_robot.services.identity import LicenseService, PayloadService, RobotIdService
from fake_robot.services.reports.records import DataBufferService, FaultService, LogStatusService, liveness_fault
from fake_robot.services.time_sync import TimeSyncService


class World:
    """One robot and everything that its services remember.

    ``tick`` brings time-outs to the robot: e-stop endpoints and leases of silent clients, keep-alive policies.
    """

    def __init__(self, robot: Robot, config: ServicesConfig, credentials: Credentials) -> None:
        self.robot = robot
        self.config = config
        self.now_ns = robot.clock.now_ns
        clock = LivenessClock(
            self.now_ns, robot.clock.elapsed_ns, needs_both=robot.is_lock_step and config.liveness_clock == "both"
        )
        self.link = Link()
        self.auth = AuthService(credentials, config)
        self.directory = DirectoryService(clock)
        self.robot_id = RobotIdService(config)
        self.license = LicenseService(config, self.now_ns)
        self.payloads = PayloadService(self.auth)
        self.time_sync = TimeSyncService(config.time_sync_samples, uses_newest=robot.is_lock_step)
        self.leases = LeaseService(
            clock, epoch=secrets.token_hex(8), timeout_s=config.lease_timeout_s, user_name=credentials.username
        )
        self.estop = EstopService(
            clock,
            cut_after_settle_s=config.estop_cut_after_settle_s,
            are_motors_on=self.are_motors_on,
            apply_level=robot.set_estop_level,
            has_operator=config.operator_estop,
        )
        self.keepalive = KeepaliveService(clock, self.leases.owns)
        self.service_faults = FaultService(self.now_ns)
        self.notes = DataBufferService(self.now_ns)
        self.logs = LogStatusService(self.now_ns)
        self._silent_services: frozenset[str] = frozenset()
        self.stepped_s = time.monotonic()
        """When robot time was last made to pass, by the host's clock; of a robot in lock-step."""
        self.is_wifi_on = True
        self.are_payload_ports_on = True

    def are_motors_on(self) -> bool:
        """Whether the motors have power, or are about to."""
        return self.robot.snapshot().motor_power in {MotorPower.ON, MotorPower.POWERING_ON}

    def tick(self) -> None:
        """Act on whoever has fallen silent. Cheap; called some twenty times a second and after every step."""
        self.estop.apply()
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
        self.auth.revoke_all()
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
            self.service_faults.clear(liveness_fault(name).fault_id.__eq__)
        self._silent_services = silent

    def _take_action(self, action: keepalive_pb2.ActionAfter) -> None:
        """Take the action of a client that has fallen silent; one that the fake does not know is none."""
        actions: dict[str, Any] = {
            "controlled_motors_off": self.robot.safe_power_off,
            "immediate_motors_off": self.robot.power_off,
            "immediate_robot_off": self.reboot,
            "lease_stale": self.leases.revoke,
            "halt_robot": self.robot.stop_motion,
            "record_event": lambda: self.notes.keep(action.record_event.events),
        }
        take = actions.get(action.WhichOneof("action") or "")
        if take is not None:
            take()
