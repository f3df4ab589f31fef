"""The states of the service, with what may be asked in each."""

from __future__ import annotations

from enum import Enum


class State(Enum):
    """Where the service stands. Commands reach the joints in ``running`` alone."""

    IDLE = "idle"
    ARMING = "arming"
    ARMED = "armed"
    RUNNING = "running"
    ENDING = "ending"

    @property
    def meaning(self) -> str:
        """In words."""
        return _TABLE[self][0]

    @property
    def allows(self) -> tuple[str, ...]:
        """The calls of an operator that are not refused."""
        return _TABLE[self][1]

    @property
    def advice(self) -> str:
        """What to do."""
        return f"allowed now: {', '.join(self.allows) or 'to wait'}"


_TABLE = {
    State.IDLE: ("no lease is held, nothing is commanded", ("Arm",)),
    State.ARMING: ("connecting, powering on, standing up by the vendor's controller", ("Stop", "Damp")),
    State.ARMED: (
        "the vendor's controller stands, the lease is ours, the policy waits",
        ("Start", "Stop", "Damp", "SwitchPolicy", "StartLog", "LabelLog", "Attend"),
    ),
    State.RUNNING: (
        "the policy has the joints, or takes them over, or hands them back",
        ("SetVelocity", "Stop", "Damp", "LabelLog", "Attend"),
    ),
    State.ENDING: ("sitting, powering off, giving the lease back", ("Stop", "Damp")),
}
