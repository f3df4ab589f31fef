"""PowerService: motors on and off, ports, Wi-Fi, fans, reboot."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

from bosdyn.api import lease_pb2, license_pb2, power_pb2

from fake_robot.network.status import EstopLevel, MotorPower, Snapshot, SystemFault
from fake_robot.services.calls.access import refuse_request
from fake_robot.services.calls.stamps import ns_from_duration, timestamp_from_ns
from fake_robot.services.reports.robot_state_message import system_fault_message
from fake_robot.services.sensors.world import World

Request = power_pb2.PowerCommandRequest
MAX_COMMANDS = 256
REBOOTS = {Request.REQUEST_OFF_ROBOT, Request.REQUEST_CYCLE_ROBOT, Request.REQUEST_SOFT_REBOOT_ROBOT}
PAYLOAD_PORTS = {Request.REQUEST_ON_PAYLOAD_PORTS: True, Request.REQUEST_OFF_PAYLOAD_PORTS: False}
WIFI_RADIO = {Request.REQUEST_ON_WIFI_RADIO: True, Request.REQUEST_OFF_WIFI_RADIO: False}
FAN_KEYS = ("fan_front", "fan_rear")
FAN_FREQUENCY_HZ = 50.0
STANDSTILL_S = 3.0
"""Of host time, after which a client that waits for a robot in lock-step is told that nobody steps it."""
STANDSTILL = (
    "the motors wait for robot time, which stands still: this fake robot runs in lock-step, and for {:.0f} s nobody "
    "has stepped it; start the client with --lock-step and the fake's admin address, or the fake without --lock-step"
)


@dataclass
class FanCommand:
    """A fan command and when it ends, robot time."""

    command_id: int
    end_ns: int


class PowerService:
    """Starts power changes and tells how they go."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._lock = threading.Lock()
        self._requests: OrderedDict[int, int] = OrderedDict()
        self._last_motor_command = 0
        self._last_id = 0
        self._fan = FanCommand(0, 0)
        self._begun_s = 0.0

    def PowerCommand(self, request: Any) -> Any:  # noqa: N802
        """Begin a power change; needs the lease."""
        response = power_pb2.PowerCommandResponse(lease_use_result=self._world.leases.use(request.lease))
        response.license_status = license_pb2.LicenseInfo.STATUS_VALID
        if response.lease_use_result.status != lease_pb2.LeaseUseResult.STATUS_OK:
            response.status = power_pb2.STATUS_INTERNAL_ERROR
            return response
        if request.request not in Request.Request.values() or request.request == Request.REQUEST_UNKNOWN:
            response.status = power_pb2.STATUS_INTERNAL_ERROR
            return refuse_request(
                response, f"power request {request.request} is not known; allowed: {_known_requests()}"
            )
        response.status = self._begin(request.request, response)
        if response.status in {power_pb2.STATUS_IN_PROGRESS, power_pb2.STATUS_SUCCESS}:
            response.power_command_id = self._remember(request.request)
        return response

    def PowerCommandFeedback(self, request: Any) -> Any:  # noqa: N802
        """How a power change goes."""
        response = power_pb2.PowerCommandFeedbackResponse()
        with self._lock:
            wanted = self._requests.get(request.power_command_id)
            is_newest = request.power_command_id == self._last_motor_command
        if wanted is None:
            response.status = power_pb2.STATUS_INTERNAL_ERROR
            return refuse_request(response, f"there is no power command {request.power_command_id}")
        if wanted not in {Request.REQUEST_ON_MOTORS, Request.REQUEST_OFF_MOTORS}:
            response.status = power_pb2.STATUS_SUCCESS
        elif not is_newest:
            response.status = power_pb2.STATUS_OVERRIDDEN
        else:
            snapshot = self._world.robot.snapshot()
            response.status = _motor_status(wanted, snapshot)
            still_s = time.monotonic() - max(self._begun_s, self._world.stepped_s)
            is_waiting = self._world.robot.is_lock_step and response.status == power_pb2.STATUS_IN_PROGRESS
            if is_waiting and still_s > STANDSTILL_S:
                return refuse_request(response, STANDSTILL.format(still_s))
            response.blocking_faults.extend(map(system_fault_message, _blocking(snapshot)))
        return response

    def FanPowerCommand(self, request: Any) -> Any:  # noqa: N802
        """Set the fans for a while; needs the lease. They cool nothing here."""
        response = power_pb2.FanPowerCommandResponse(lease_use_result=self._world.leases.use(request.lease))
        if response.lease_use_result.status == lease_pb2.LeaseUseResult.STATUS_OK:
            end_ns = self._world.now_ns() + ns_from_duration(request.duration)
            with self._lock:
                self._fan = FanCommand(self._fan.command_id + 1, end_ns)
                response.command_id = self._fan.command_id
            response.desired_end_time.CopyFrom(timestamp_from_ns(end_ns))
        response.status = response.STATUS_OK
        return response

    def FanPowerCommandFeedback(self, request: Any) -> Any:  # noqa: N802
        """Whether a fan command still runs."""
        response = power_pb2.FanPowerCommandFeedbackResponse()
        with self._lock:
            fan = self._fan
        if not 0 < request.command_id <= fan.command_id:
            response.status = response.STATUS_COMPLETE
            return refuse_request(response, f"there is no fan command {request.command_id}")
        response.desired_end_time.CopyFrom(timestamp_from_ns(fan.end_ns))
        if request.command_id != fan.command_id:
            response.status = response.STATUS_OVERRIDDEN_BY_COMMAND
        else:
            is_over = self._world.now_ns() >= fan.end_ns
            response.status = response.STATUS_COMPLETE if is_over else response.STATUS_RUNNING
        return response

    def GetFanInformation(self, request: Any) -> Any:  # noqa: N802
        """Two fans at one speed."""
        response = power_pb2.GetFanInformationResponse()
        for key in FAN_KEYS:
            response.fan_information[key].frequency = FAN_FREQUENCY_HZ
        return response

    def ResetSafetyStop(self, request: Any) -> Any:  # noqa: N802
        """The base robot has no redundant safety stop."""
        response = power_pb2.ResetSafetyStopResponse(lease_use_result=self._world.leases.use(request.lease))
        response.status = response.STATUS_INCOMPATIBLE_HARDWARE_ERROR
        return response

    def _begin(self, wanted: int, response: power_pb2.PowerCommandResponse) -> int:
        world = self._world
        if wanted in PAYLOAD_PORTS:
            world.are_payload_ports_on = PAYLOAD_PORTS[wanted]
            return int(power_pb2.STATUS_SUCCESS)
        if wanted in WIFI_RADIO:
            world.is_wifi_on = WIFI_RADIO[wanted]
            return int(power_pb2.STATUS_SUCCESS)
        if wanted in REBOOTS:
            world.reboot()
            return int(power_pb2.STATUS_SUCCESS)
        if wanted == Request.REQUEST_OFF_MOTORS:
            self._begun_s = time.monotonic()
            world.robot.power_off()
            return int(power_pb2.STATUS_IN_PROGRESS)
        world.apply_estop()
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
        with self._lock:
            self._last_id += 1
            self._requests[self._last_id] = wanted
            if wanted in {Request.REQUEST_ON_MOTORS, Request.REQUEST_OFF_MOTORS}:
                self._last_motor_command = self._last_id
            while len(self._requests) > MAX_COMMANDS:
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
    if wanted == Request.REQUEST_OFF_MOTORS:
        is_off = snapshot.motor_power is MotorPower.OFF
        return int(power_pb2.STATUS_SUCCESS if is_off else power_pb2.STATUS_IN_PROGRESS)
    if snapshot.motor_power is MotorPower.ON:
        return int(power_pb2.STATUS_SUCCESS)
    refusal = _why_not_on(snapshot)
    if refusal is not None:
        return refusal
    if snapshot.motor_power is MotorPower.POWERING_ON:
        return int(power_pb2.STATUS_IN_PROGRESS)
    # The motors were switched off again by something other than a power command.
    return int(power_pb2.STATUS_OVERRIDDEN)


def _blocking(snapshot: Snapshot) -> list[SystemFault]:
    return [fault for fault in snapshot.system_faults if fault.severity == "critical"]


def _known_requests() -> str:
    return ", ".join(name for name in Request.Request.keys() if name != "REQUEST_UNKNOWN")  # noqa: SIM118
