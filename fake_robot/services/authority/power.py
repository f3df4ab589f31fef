"""PowerService: motors on and off, ports, Wi-Fi, fans, reboot."""

from __future__ import annotations

import time
from collections import OrderedDict
from typing import Any

from bosdyn.api import license_pb2, power_pb2, power_service_pb2

from fake_robot.network.status import EstopLevel, MotorPower, Snapshot, SystemFault
from fake_robot.services.calls import Service, ns_of, refuse, timestamp_from_ns
from fake_robot.services.reports.state_message import system_fault_message
from fake_robot.services.world import World

Request = power_pb2.PowerCommandRequest
MAX_COMMANDS = 256
OF_MOTORS = {Request.REQUEST_ON_MOTORS, Request.REQUEST_OFF_MOTORS}
REBOOTS = {Request.REQUEST_OFF_ROBOT, Request.REQUEST_CYCLE_ROBOT, Request.REQUEST_SOFT_REBOOT_ROBOT}
SWITCHES = {
    Request.REQUEST_ON_PAYLOAD_PORTS: ("are_payload_ports_on", True),
    Request.REQUEST_OFF_PAYLOAD_PORTS: ("are_payload_ports_on", False),
    Request.REQUEST_ON_WIFI_RADIO: ("is_wifi_on", True),
    Request.REQUEST_OFF_WIFI_RADIO: ("is_wifi_on", False),
}
"""What requests switch in the world."""
STANDSTILL_S = 3.0
"""Of host time, after which a client that waits for a robot in lock-step is told that nobody steps it."""
STANDSTILL = (
    "the motors wait for robot time, which stands still: this fake robot runs in lock-step, and for {:.0f} s nobody "
    "has stepped it; start the client with --lock-step and the fake's admin address, or the fake without --lock-step"
)


class PowerService(Service):
    """Starts power changes and tells how they go."""

    modules = (power_service_pb2,)

    def __init__(self, world: World) -> None:
        super().__init__()
        self._world = world
        self._requests: OrderedDict[int, int] = OrderedDict()
        self._last_motor_command = self._last_id = 0
        self._fan_command, self._fans_end_ns = 0, 0
        self._begun_s = 0.0

    def PowerCommand(self, request: Any, response: Any) -> None:  # noqa: N802
        """Begin a power change; needs the lease."""
        response.license_status = license_pb2.LicenseInfo.STATUS_VALID
        response.status = power_pb2.STATUS_INTERNAL_ERROR
        if not self._world.leases.admits(request, response):
            return
        known = {name: number for name, number in Request.Request.items() if number != Request.REQUEST_UNKNOWN}
        if request.request not in known.values():
            refuse(response, f"power request {request.request} is not known; allowed: {', '.join(known)}")
            return
        response.status = self._begin(request.request, response)
        if response.status in {power_pb2.STATUS_IN_PROGRESS, power_pb2.STATUS_SUCCESS}:
            response.power_command_id = self._remember(request.request)

    def PowerCommandFeedback(self, request: Any, response: Any) -> None:  # noqa: N802
        """How a power change goes."""
        wanted = self._requests.get(request.power_command_id)
        if wanted is None:
            response.status = power_pb2.STATUS_INTERNAL_ERROR
            refuse(response, f"there is no power command {request.power_command_id}")
        elif wanted not in OF_MOTORS:
            response.status = power_pb2.STATUS_SUCCESS
        elif request.power_command_id != self._last_motor_command:
            response.status = power_pb2.STATUS_OVERRIDDEN
        else:
            snapshot = self._world.robot.snapshot()
            response.status = _motor_status(wanted, snapshot)
            still_s = time.monotonic() - max(self._begun_s, self._world.stepped_s)
            is_waiting = self._world.robot.is_lock_step and response.status == power_pb2.STATUS_IN_PROGRESS
            if is_waiting and still_s > STANDSTILL_S:
                refuse(response, STANDSTILL.format(still_s))
                return
            response.blocking_faults.extend(map(system_fault_message, _blocking(snapshot)))

    def FanPowerCommand(self, request: Any, response: Any) -> None:  # noqa: N802
        """Set the fans for a while; needs the lease. They cool nothing here."""
        if self._world.leases.admits(request, response):
            self._fans_end_ns = self._world.now_ns() + ns_of(request.duration)
            self._fan_command += 1
            response.command_id = self._fan_command
            response.desired_end_time.CopyFrom(timestamp_from_ns(self._fans_end_ns))
        response.status = response.STATUS_OK

    def FanPowerCommandFeedback(self, request: Any, response: Any) -> None:  # noqa: N802
        """Whether a fan command still runs."""
        response.status = response.STATUS_COMPLETE
        if not 0 < request.command_id <= self._fan_command:
            refuse(response, f"there is no fan command {request.command_id}")
            return
        response.desired_end_time.CopyFrom(timestamp_from_ns(self._fans_end_ns))
        if request.command_id != self._fan_command:
            response.status = response.STATUS_OVERRIDDEN_BY_COMMAND
        elif self._world.now_ns() < self._fans_end_ns:
            response.status = response.STATUS_RUNNING

    def GetFanInformation(self, request: Any, response: Any) -> None:  # noqa: N802
        """Two fans at one speed."""
        for key in ("fan_front", "fan_rear"):
            response.fan_information[key].frequency = 50.0

    def ResetSafetyStop(self, request: Any, response: Any) -> None:  # noqa: N802
        """The base robot has no redundant safety stop."""
        self._world.leases.admits(request, response)
        response.status = response.STATUS_INCOMPATIBLE_HARDWARE_ERROR

    def _begin(self, wanted: int, response: power_pb2.PowerCommandResponse) -> int:
        world = self._world
        if wanted in SWITCHES:
            setattr(world, *SWITCHES[wanted])
            return int(power_pb2.STATUS_SUCCESS)
        if wanted in REBOOTS:
            world.reboot()
            return int(power_pb2.STATUS_SUCCESS)
        if wanted == Request.REQUEST_OFF_MOTORS:
            self._begun_s = time.monotonic()
            world.robot.power_off()
            return int(power_pb2.STATUS_IN_PROGRESS)
        world.estop.apply()
        snapshot = world.robot.snapshot()
        refusal = _why_not_on(snapshot)
        if refusal is not None:
            response.blocking_faults.extend(map(system_fault_message, _blocking(snapshot)))
            return refusal
        if world.keepalive.holds_motors_off():
            return int(power_pb2.STATUS_KEEPALIVE_MOTORS_OFF)
        if snapshot.motor_power is MotorPower.ON:
            return int(power_pb2.STATUS_SUCCESS)
        self._begun_s = time.monotonic()
        world.robot.power_on()
        return int(power_pb2.STATUS_IN_PROGRESS)

    def _remember(self, wanted: int) -> int:
        self._last_id += 1
        self._requests[self._last_id] = wanted
        if wanted in OF_MOTORS:
            self._last_motor_command = self._last_id
        if len(self._requests) > MAX_COMMANDS:
            self._requests.popitem(last=False)
        return self._last_id


def _why_not_on(snapshot: Snapshot) -> int | None:
    """The status that keeps the motors from powering on; None if nothing does."""
    if snapshot.is_battery_missing:
        return int(power_pb2.STATUS_BATTERY_MISSING)
    if snapshot.estop_level is not EstopLevel.NONE:
        return int(power_pb2.STATUS_ESTOPPED)
    return int(power_pb2.STATUS_FAULTED) if _blocking(snapshot) else None


def _motor_status(wanted: int, snapshot: Snapshot) -> int:
    goal = MotorPower.OFF if wanted == Request.REQUEST_OFF_MOTORS else MotorPower.ON
    if snapshot.motor_power is goal:
        return int(power_pb2.STATUS_SUCCESS)
    if goal is MotorPower.OFF:
        return int(power_pb2.STATUS_IN_PROGRESS)
    refusal = _why_not_on(snapshot)
    if refusal is not None:
        return refusal
    # Motors that are not powering on were switched off again by something other than a power command.
    is_coming = snapshot.motor_power is MotorPower.POWERING_ON
    return int(power_pb2.STATUS_IN_PROGRESS if is_coming else power_pb2.STATUS_OVERRIDDEN)


def _blocking(snapshot: Snapshot) -> list[SystemFault]:
    return [fault for fault in snapshot.system_faults if fault.severity == "critical"]
