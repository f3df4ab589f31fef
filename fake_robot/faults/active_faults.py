"""Which faults are active, and until when."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from fake_robot.body.energy import Energy
from fake_robot.body.fault_effects import FaultEffects
from fake_robot.faults.fault import Fault
from fake_robot.network.status import SystemFault
from fake_robot.scenario.scenario import Scenario


@dataclass(frozen=True)
class ActiveFault:
    """A fault that was injected and is not over."""

    fault_id: int
    fault: Fault
    onset_robot_stamp_ns: int
    until_ns: int | None
    """Robot time since the start at which it ends; None until it is cleared."""


class ActiveFaults:
    """The active faults, and the effects that they turn together."""

    def __init__(self) -> None:
        self._next_id = 1
        self.active: list[ActiveFault] = []
        self.effects = FaultEffects()

    def add(self, fault: Fault, onset_robot_stamp_ns: int, until_ns: int | None) -> int:
        """A fault becomes active; returns its number."""
        fault_id = self._next_id
        self._next_id += 1
        self.active.append(ActiveFault(fault_id, fault, onset_robot_stamp_ns, until_ns))
        self._sum_up()
        return fault_id

    def end_due(self, now_ns: int) -> bool:
        """End the faults whose time is over; whether there were any."""
        left = [f for f in self.active if f.until_ns is None or f.until_ns > now_ns]
        return self._keep(left)

    def clear(self, fault_ids: Iterable[int] | None) -> list[int]:
        """End faults by number, or all; returns those that were active."""
        chosen = {f.fault_id for f in self.active} if fault_ids is None else set(fault_ids)
        cleared = [f.fault_id for f in self.active if f.fault_id in chosen]
        self._keep([f for f in self.active if f.fault_id not in chosen])
        return cleared

    def _keep(self, left: list[ActiveFault]) -> bool:
        if len(left) == len(self.active):
            return False
        self.active = left
        self._sum_up()
        return True

    def _sum_up(self) -> None:
        self.effects = FaultEffects()
        for active in self.active:
            active.fault.apply(self.effects, active.onset_robot_stamp_ns)


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
