"""Battery, temperatures, power and faults as polled: whether they can be true, and which of them end a run.

What is no number, or none of a Spot's, is unknown, and so not good.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

from spot_model.robot.facts import NS_PER_S
from spot_model.robot.state import SlowState
from spot_runtime.safety_limits import SafetyLimits
from spot_runtime.stops import CRITICAL, Stop, StopReason

CHARGE_PERCENT: Final = (0.0, 100.0)
VOLTAGE_V: Final = (28.0, 65.0)
"""Fourteen cells (58.8 V when full, 4.2 V each) between 2.0 V, below which they are spoilt, and 4.65 V."""

CURRENT_A: Final = (-200.0, 200.0)
"""564 Wh at 48 V are 12 A·h; no such pack gives, or takes, sixteen times that."""

TEMPERATURE_C: Final = (-60.0, 200.0)
CHARGING_S: Final = 10.0
"""A robot whose motors have power uses more than it regains, except for moments: no slope is walked down for longer at
a pace that would feed the battery."""

CHARGE_LEAP_PERCENT: Final = 10.0
"""Between two polls. 564 Wh last for 200 s at 10 kW, so 3 s without a poll are 1.5 %; the rest is for a gauge that
corrects itself."""


NEVER_KNOWN_S: Final = 1.0
"""Longest wait for a battery that was never known, five polls: shorter than any other wait before control begins."""


class BatteryMemory(NamedTuple):
    """What was last known of charge and temperatures, and what was seen of the current."""

    since_ns: int = 0
    """When all of it was last known, or first looked at; host clock, 0 before."""
    charge_percent: float | None = None
    """Charge at that time; None if it was never known."""
    temperatures: int = 0
    """How many there were then, of motors and battery."""
    has_discharged: bool = False
    """Whether the battery ever gave current; a robot that reports none, or counts it the other way, is not judged."""
    charging_since_ns: int = 0
    """Host clock; 0 while it does not charge."""
    believed: SlowState | None = None
    """The newest poll that was not doubted: most steps see it again, and need not hold it against itself."""

    @property
    def is_unknown(self) -> bool:
        """Whether it was looked at, and never known."""
        return self.since_ns > 0 and self.charge_percent is None


def watch(
    memory: BatteryMemory, slow: SlowState, host_now_ns: int, longest_s: float
) -> tuple[BatteryMemory, Stop | None]:
    """Hold what was polled against what it was, and the current against the motors, which have power.

    A poll in which something is missing, or cannot be true, is passed over; for ``longest_s`` at most.
    """
    if slow is memory.believed:
        return memory, None
    temperatures = len(slow.motor_temperature_c) + len(slow.battery_temperature_c)
    doubts = [*_unknown(slow)]
    if temperatures < memory.temperatures:
        doubts.append(f"{memory.temperatures - temperatures} temperatures")
    charge, before = slow.battery_charge_percent, memory.charge_percent
    if "charge" not in doubts and before is not None and abs(charge - before) > CHARGE_LEAP_PERCENT:
        doubts.append(f"charge, which leaps from {before:.0f} to {charge:.0f} %")
    if doubts:
        memory = memory._replace(since_ns=memory.since_ns or host_now_ns)
        unknown_s = (host_now_ns - memory.since_ns) / NS_PER_S
        bound_s = min(longest_s, NEVER_KNOWN_S) if memory.is_unknown else longest_s
        values = {"unknown_s": unknown_s, "bound_s": bound_s}
        return memory, Stop(StopReason.BATTERY_UNKNOWN, ", ".join(doubts), values) if unknown_s > bound_s else None
    stamp_ns, current_a = slow.host_stamp_ns, slow.battery_current_a
    has_discharged = memory.has_discharged or current_a < 0.0
    since_ns = (memory.charging_since_ns or stamp_ns) if slow.motors_powered and current_a > 0.0 else 0
    after = BatteryMemory(stamp_ns, charge, temperatures, has_discharged, since_ns)
    charging_s = (stamp_ns - (since_ns or stamp_ns)) / NS_PER_S
    if has_discharged and charging_s >= CHARGING_S:
        values = {"charging_s": charging_s, "bound_s": CHARGING_S}
        return after, Stop(StopReason.BATTERY_UNKNOWN, "current: it charges though the motors have power", values)
    return after._replace(believed=slow), None


def _unknown(slow: SlowState) -> Iterator[str]:
    ranges = [("charge", slow.battery_charge_percent, CHARGE_PERCENT)]
    ranges += [("voltage", slow.battery_voltage_v, VOLTAGE_V)] if slow.battery_voltage_v else []
    ranges += [("current", slow.battery_current_a, CURRENT_A)]
    ranges += [(f"battery temperature {i + 1}", t, TEMPERATURE_C) for i, t in enumerate(slow.battery_temperature_c)]
    ranges += [(name, t, TEMPERATURE_C) for name, t in slow.motor_temperature_c.items()]
    for name, value, (low, high) in ranges:
        if not low <= value <= high:  # NaN, too
            yield name


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
