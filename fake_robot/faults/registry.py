"""Every fault by name, and who injects them: those of the services here, those of the body by the robot.

A class with a name, in one of the modules imported here or anywhere else, is in the list.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from fake_robot.faults import body, link, services
from fake_robot.faults.fault import FAULTS, Fault, ServiceFault
from spot_model.errors import BadInputError
from spot_model.io.settings import explain

__all__ = ["FAULTS", "body", "link", "make_fault", "services"]


def make_fault(name: str, parameters: Mapping[str, Any]) -> Fault:
    """Build a fault from its name and parameters. Raises BadInputError."""
    if name not in FAULTS:
        raise BadInputError(f"there is no fault {name!r}; allowed: {', '.join(sorted(FAULTS))}")
    try:
        return FAULTS[name].model_validate(dict(parameters), strict=True)
    except ValidationError as error:
        raise BadInputError(f"fault {name}:\n{explain(error, FAULTS[name])}") from error


FIRST_SERVICE_FAULT_ID = 1_000_000
"""Numbers from here on are of service faults; the robot numbers its own from 1."""


@dataclass(frozen=True)
class LastingFault:
    """A fault that goes on until its end, robot time elapsed (None: until cleared)."""

    name: str
    end_ns: int | None
    undo: Callable[[], None]


class FaultInjector:
    """The faults of one fake, whatever they act on. Thread-safe."""

    def __init__(self, world: Any) -> None:
        self._world = world
        self._elapsed_ns = world.robot.clock.elapsed_ns
        self._lasting: dict[int, LastingFault] = {}
        self._last_id = FIRST_SERVICE_FAULT_ID
        self._lock = threading.Lock()

    def inject(self, name: str, parameters: Mapping[str, float | str], duration_s: float | None) -> int:
        """Make a fault happen now; returns its number. Raises BadInputError."""
        if duration_s is not None and not 0 < duration_s < 1e6:
            raise BadInputError(f"fault {name}: duration_s = {duration_s:g} is not allowed; give 0 < duration_s < 1e6")
        fault = make_fault(name, parameters)
        if not isinstance(fault, ServiceFault):
            number: int = self._world.robot.inject(name, parameters, duration_s)
            return number
        undo = fault.begin(self._world, duration_s)
        with self._lock:
            self._last_id += 1
            if undo is not None:
                end_ns = None if duration_s is None else self._elapsed_ns() + round(duration_s * 1e9)
                self._lasting[self._last_id] = LastingFault(name, end_ns, undo)
            return self._last_id

    def active(self) -> dict[int, str]:
        """Number and name of every fault that goes on."""
        with self._lock:
            mine = {fault_id: fault.name for fault_id, fault in self._lasting.items()}
        return mine | dict(self._world.robot.active_faults())

    def clear(self, fault_ids: tuple[int, ...] = ()) -> tuple[int, ...]:
        """End faults (all, if empty); returns the numbers of those that ended. Raises BadInputError."""
        active = self.active()
        for fault_id in fault_ids:
            if fault_id not in active:
                raise BadInputError(f"fault {fault_id} is not active; active: {', '.join(map(str, active)) or 'none'}")
        chosen = fault_ids or tuple(active)
        mine = [fault_id for fault_id in chosen if fault_id > FIRST_SERVICE_FAULT_ID]
        theirs = tuple(fault_id for fault_id in chosen if fault_id <= FIRST_SERVICE_FAULT_ID)
        cleared = [fault_id for fault_id in mine if self._end(fault_id)]
        return (*cleared, *(self._world.robot.clear_faults(theirs) if theirs else ()))

    def tick(self) -> None:
        """End the faults whose time is over."""
        now_ns = self._elapsed_ns()
        with self._lock:
            over = [i for i, fault in self._lasting.items() if fault.end_ns is not None and now_ns >= fault.end_ns]
        for fault_id in over:
            self._end(fault_id)

    def _end(self, fault_id: int) -> bool:
        with self._lock:
            fault = self._lasting.pop(fault_id, None)
        if fault is None:
            return False
        fault.undo()
        self._world.tick()
        return True
