"""Battery, temperatures, power, e-stop and faults."""

from __future__ import annotations

from spot_model.robot.stamps import NS_PER_S
from spot_model.robot.state import SlowState
from spot_runtime.control.safety.battery import CHARGE_PERCENT, TEMPERATURE_C, BatteryMemory, watch
from spot_runtime.safety_limits import SafetyLimits
from spot_runtime.stops import CRITICAL, Stop, StopReason


def check_slow_state(
    memory: BatteryMemory, slow: SlowState, host_now_ns: int, limits: SafetyLimits
) -> tuple[BatteryMemory, Stop | None]:
    """Judge battery, temperatures, power, e-stop and faults, and how old that knowledge is."""
    after, doubt = watch(memory, slow, host_now_ns, limits.slow_state_age_s)
    return after, _at_once(slow, host_now_ns, limits) or doubt


def _at_once(slow: SlowState, host_now_ns: int, limits: SafetyLimits) -> Stop | None:
    """What is known to be bad. A value that cannot be true is neither low nor hot."""
    age_s = (host_now_ns - slow.host_stamp_ns) / NS_PER_S
    if age_s > limits.slow_state_age_s:
        return Stop(StopReason.LINK_LOST, "", {"age_s": age_s, "bound_s": limits.slow_state_age_s})
    if slow.estopped:
        return Stop(StopReason.ESTOPPED)
    if slow.behavior_faults:
        return Stop(StopReason.BEHAVIOR_FAULT, ", ".join(slow.behavior_faults))
    if not slow.motors_powered:
        return Stop(StopReason.MOTORS_OFF)
    if CHARGE_PERCENT[0] <= slow.battery_charge_percent < limits.battery_percent:
        values = {"charge_percent": slow.battery_charge_percent, "bound_percent": limits.battery_percent}
        return Stop(StopReason.BATTERY_LOW, "", values)
    for name, temperature_c in slow.motor_temperature_c.items():
        if limits.motor_temperature_c < temperature_c <= TEMPERATURE_C[1]:
            values = {"temperature_c": temperature_c, "bound_c": limits.motor_temperature_c}
            return Stop(StopReason.MOTOR_HOT, name, values)
    critical = [fault for fault in slow.system_faults if fault.startswith(CRITICAL)]
    return Stop(StopReason.SYSTEM_FAULT, ", ".join(critical)) if critical else None
