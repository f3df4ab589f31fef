"""Which faults are active, and until when."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from fake_robot.body.fault_effects import FaultEffects
from fake_robot.faults.fault import Fault


@dataclass(frozen=True)
class ActiveFault:
    """A fault that was injected and is not over."""

    fault_id: int
    fault: Fault
    onset_robot_stamp_ns: int
    until_ns: int | None
    """Robot time since the start at which it ends; None until it is cleared."""

    @property
    def name(self) -> str:
        """The fault's name."""
        return self.fault.name


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
