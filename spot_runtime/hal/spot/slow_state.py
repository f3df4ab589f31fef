"""Battery, temperatures, power and faults out of a vendor RobotState message."""

from __future__ import annotations

import math

from bosdyn.api import robot_state_pb2, service_fault_pb2

from spot_model.robot.facts import NS_PER_S
from spot_model.robot.state import SlowState
from spot_runtime.hal.spot.vendor_errors import enum_word
from spot_runtime.stops import CRITICAL


def slow_state_from_message(message: robot_state_pb2.RobotState, host_stamp_ns: int) -> SlowState:
    """Convert an answer of GetRobotState, received at this instant of the host's clock.

    Returns:
        The slow state; a charge that the robot does not report is NaN, any other such value 0 or missing.
    """
    power, battery = message.power_state, reporting_battery(message)
    stamp = power.timestamp
    return SlowState(
        robot_stamp_ns=stamp.seconds * NS_PER_S + stamp.nanos,
        host_stamp_ns=host_stamp_ns,
        motors_powered=power.motor_power_state == robot_state_pb2.PowerState.MOTOR_POWER_STATE_ON,
        estopped=bool(pressed_estops(message)),
        battery_charge_percent=charge_percent(message),
        battery_voltage_v=battery.voltage.value,
        battery_current_a=battery.current.value,
        battery_temperature_c=tuple(battery.temperatures),
        # The vendor writes fl.hx where this project writes fl_hx.
        motor_temperature_c={m.name.replace(".", "_"): m.temperature for m in message.system_state.motor_temperatures},
        system_faults=tuple(_system_fault(f) for f in message.system_fault_state.faults),
        behavior_faults=tuple(_behavior_fault(f) for f in message.behavior_fault_state.faults),
        service_faults=tuple(_service_fault(f) for f in message.service_fault_state.faults),
    )


def pressed_estops(message: robot_state_pb2.RobotState) -> list[str]:
    """Names of the e-stops that hold the robot stopped."""
    stopped = robot_state_pb2.EStopState.STATE_ESTOPPED
    return [estop.name or "unnamed" for estop in message.estop_states if estop.state == stopped]


def charge_percent(message: robot_state_pb2.RobotState) -> float:
    """The charge for walking: the robot's own summary, else that of its emptiest battery; NaN without either."""
    if message.power_state.HasField("locomotion_charge_percentage"):
        return float(message.power_state.locomotion_charge_percentage.value)
    battery = reporting_battery(message)
    return float(battery.charge_percentage.value) if battery.HasField("charge_percentage") else math.nan


def reporting_battery(message: robot_state_pb2.RobotState) -> robot_state_pb2.BatteryState:
    """Of the batteries that report a charge, the emptiest, or one whose charge is no number; an empty message if none.

    The list may begin with a bay that is empty or a battery that still boots.
    """
    reporting = [battery for battery in message.battery_states if battery.HasField("charge_percentage")]
    return min(
        reporting,
        key=lambda b: -math.inf if math.isnan(b.charge_percentage.value) else b.charge_percentage.value,
        default=robot_state_pb2.BatteryState(),
    )


def _system_fault(fault: robot_state_pb2.SystemFault) -> str:
    prefix = CRITICAL if fault.severity == robot_state_pb2.SystemFault.SEVERITY_CRITICAL else ""
    return f"{prefix}{fault.name}" + (f" ({fault.error_message})" if fault.error_message else "")


def _behavior_fault(fault: robot_state_pb2.BehaviorFault) -> str:
    return f"{enum_word(robot_state_pb2.BehaviorFault.Cause, fault.cause, 'CAUSE_')} ({fault.behavior_fault_id})"


def _service_fault(fault: service_fault_pb2.ServiceFault) -> str:
    return f"{fault.fault_id.service_name}: {fault.fault_id.fault_name}"
