"""The states of the service, and the commands allowed in each."""

from __future__ import annotations

from enum import Enum

from typing_extensions import Self


class State(Enum):
    """Where the service stands. Commands reach the joints in ``running`` alone."""

    IDLE = "idle", "no lease is held, nothing is commanded", "arm"
    ARMING = "arming", "connecting, powering on, standing up by the vendor's controller", "stop damp"
    ARMED = (
        "armed",
        "the vendor's controller stands, the lease is ours, the policy waits",
        "start stop damp switch-policy start-log label-log attend",
    )
    RUNNING = (
        "running",
        "the policy has the joints, or takes them over, or hands them back",
        "velocity stop damp label-log attend",
    )
    ENDING = "ending", "sitting, powering off, giving the lease back", "stop"

    meaning: str
    allows: tuple[str, ...]
    """The commands of ``spot-rl ctl`` that are not refused."""

    def __new__(cls, value: str, meaning: str, allows: str) -> Self:
        """A state has its name on the wire as its value."""
        state = object.__new__(cls)
        state._value_, state.meaning, state.allows = value, meaning, tuple(allows.split())
        return state

    @property
    def advice(self) -> str:
        """What to do."""
        return f"allowed now: {', '.join(self.allows)}"
