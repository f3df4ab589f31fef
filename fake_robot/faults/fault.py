"""What a fault is: a name, parameters, and what it does; a class that bears a name is in the registry by that."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, Final

from fake_robot.body.fault_effects import FaultEffects
from spot_model.io.settings import Settings

FAULTS: Final[dict[str, type[Fault]]] = {}
"""Every fault by its name: those of the body, and those of the services."""


class Fault(Settings):
    """A fault of the body; the fields are its parameters."""

    name: ClassVar[str]

    def __init_subclass__(cls, name: str = "", **more: Any) -> None:
        super().__init_subclass__(**more)
        if name:
            cls.name = name
            FAULTS[name] = cls

    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        """Add to what is changed, as long as the fault is active."""

    def start(self, simulation: Any) -> None:
        """Do something once to the robot's :class:`~fake_robot.robot.simulation.Simulation`."""


class ServiceFault(Fault):
    """A fault of the services or the network, which the body does not notice."""

    def begin(self, world: Any, duration_s: float | None) -> Callable[[], None] | None:
        """Make it happen; returns what ends it, None for one that happens in an instant."""
        raise NotImplementedError
