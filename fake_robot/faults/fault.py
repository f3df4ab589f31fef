"""What a fault of the body is: a name, parameters, and what it changes while it is active."""

from __future__ import annotations

from typing import ClassVar, Protocol

from pydantic import BaseModel, ConfigDict

from fake_robot.faults.fault_effects import Knobs
from spot_model.robot.facts import Array


class Victim(Protocol):
    """What a fault may do once."""

    def push(self, linear_velocity_m_s: Array, angular_velocity_rad_s: Array) -> None:
        """Add to the body's velocity."""

    def lose_power(self, reason: str) -> None:
        """Cut the motors' power now."""

    def fail_behavior(self, cause: str, message: str) -> None:
        """Raise a behaviour fault."""


class Fault(BaseModel):
    """Base of all faults; the fields are its parameters."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    name: ClassVar[str]

    def turn(self, knobs: Knobs, onset_robot_stamp_ns: int) -> None:
        """Add to what is changed, as long as the fault is active."""

    def start(self, victim: Victim) -> None:
        """Do something once."""
