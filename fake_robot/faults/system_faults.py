"""System faults that follow from the robot's state, and those that were injected."""

from __future__ import annotations

from fake_robot.body.energy import Energy
from fake_robot.body.fault_effects import FaultEffects
from fake_robot.network.status import SystemFault
from fake_robot.scenario.scenario import Scenario


def active_system_faults(
    scenario: Scenario, energy: Energy, effects: FaultEffects, has_diverged: bool
) -> tuple[SystemFault, ...]:
    """All system faults now. Those that follow from temperatures and charge bear no onset (stamp 0)."""
    faults = list(effects.system_faults)
    percent, critical = energy.shown_percent(effects), scenario.battery.critical_percent
    if percent <= critical:
        message = f"battery at {percent:.1f} %; critical at {critical:g} %"
        faults.append(SystemFault("battery_critical", 0, 2, message, "critical", ("power",)))
    for joint, temperature in energy.shown_temperatures_c(effects).items():
        if temperature > scenario.motors.limit_c:
            message = f"{joint} motor at {temperature:.0f} °C; limit {scenario.motors.limit_c:g} °C"
            faults.append(SystemFault(f"motor_over_temperature_{joint}", 0, 3, message, "critical", ("mobility",)))
    if has_diverged:
        faults.append(SystemFault("simulation_diverged", 0, 4, "the fake's physics diverged", "critical", ()))
    return tuple(faults)
