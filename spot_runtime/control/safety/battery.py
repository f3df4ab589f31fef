"""Whether battery and temperatures can be true: what is no number, or none of a Spot's, is unknown, and so not good."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

from spot_model.robot.stamps import NS_PER_S
from spot_model.robot.state import SlowState
from spot_runtime.stops import Stop, StopReason

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


class BatteryMemory(NamedTuple):
    """What was seen of charge, current and temperatures."""

    has_discharged: bool = False
    """Whether the battery ever gave current; a robot that reports none, or counts it the other way, is not judged."""
    charging_since_ns: int = 0
    """Host clock; 0 while it does not charge."""
    charge_percent: float | None = None
    """Of the last poll; None before any."""
    temperatures: int = 0
    """How many the last poll held, of motors and battery."""


def unknown(slow: SlowState) -> str:
    """Names of the values that cannot be true; a voltage or a current of exactly 0 is one that is not reported."""
    return ", ".join(_unknown(slow))


def watch(memory: BatteryMemory, slow: SlowState) -> tuple[BatteryMemory, Stop | None]:
    """Hold what was polled against what it was, and the current against the motors, which have power."""
    after, charging_s = _with_current(memory, slow)
    if after.temperatures < memory.temperatures:
        missing = memory.temperatures - after.temperatures
        return after, Stop(StopReason.BATTERY_UNKNOWN, "temperatures: some are missing", {"missing": float(missing)})
    charge = slow.battery_charge_percent
    leap_percent = abs(charge - (charge if memory.charge_percent is None else memory.charge_percent))
    if leap_percent > CHARGE_LEAP_PERCENT:
        values = {"leap_percent": leap_percent, "bound_percent": CHARGE_LEAP_PERCENT}
        return after, Stop(StopReason.BATTERY_UNKNOWN, "charge: it leaps", values)
    if after.has_discharged and charging_s >= CHARGING_S:
        values = {"charging_s": charging_s, "bound_s": CHARGING_S}
        return after, Stop(StopReason.BATTERY_UNKNOWN, "current: it charges though the motors have power", values)
    return after, None


def _with_current(memory: BatteryMemory, slow: SlowState) -> tuple[BatteryMemory, float]:
    """The memory after one more poll, and for how long the battery has charged, s."""
    charge, temperatures = slow.battery_charge_percent, len(slow.motor_temperature_c) + len(slow.battery_temperature_c)
    if not slow.motors_powered or slow.battery_current_a <= 0.0:
        has_discharged = memory.has_discharged or slow.battery_current_a < 0.0
        return BatteryMemory(has_discharged, 0, charge, temperatures), 0.0
    since_ns = memory.charging_since_ns or slow.host_stamp_ns
    charging_s = (slow.host_stamp_ns - since_ns) / NS_PER_S
    return BatteryMemory(memory.has_discharged, since_ns, charge, temperatures), charging_s


def _unknown(slow: SlowState) -> Iterator[str]:
    ranges = [("charge", slow.battery_charge_percent, CHARGE_PERCENT)]
    ranges += [("voltage", slow.battery_voltage_v, VOLTAGE_V)] if slow.battery_voltage_v else []
    ranges += [("current", slow.battery_current_a, CURRENT_A)]
    ranges += [(f"battery temperature {i + 1}", t, TEMPERATURE_C) for i, t in enumerate(slow.battery_temperature_c)]
    ranges += [(name, t, TEMPERATURE_C) for name, t in slow.motor_temperature_c.items()]
    for name, value, (low, high) in ranges:
        if not low <= value <= high:  # NaN, too
            yield name
