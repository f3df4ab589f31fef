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
        """The commands of ``spot-rl ctl`` that are not refused."""
        return _TABLE[self][1]

    @property
    def advice(self) -> str:
        """What to do."""
        return f"allowed now: {', '.join(self.allows) or 'to wait'}"


_TABLE = {
    State.IDLE: ("no lease is held, nothing is commanded", ("arm",)),
    State.ARMING: ("connecting, powering on, standing up by the vendor's controller", ("stop", "damp")),
    State.ARMED: (
        "the vendor's controller stands, the lease is ours, the policy waits",
        ("start", "stop", "damp", "switch-policy", "start-log", "label-log", "attend"),
    ),
    State.RUNNING: (
        "the policy has the joints, or takes them over, or hands them back",
        ("velocity", "stop", "damp", "label-log", "attend"),
    ),
    State.ENDING: ("sitting, powering off, giving the lease back", ("stop", "damp")),
}
