"""Where commands to the policy come from."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from spot_model.robot.state import Array


class Wanted(NamedTuple):
    """What the operator wants now."""

    command: Array
    """V_x, V_y (m/s), ω_z (rad/s), shape (3,); for a joint script, offsets of the set-points in rad, shape (12,)."""
    is_finished: bool = False
    """The source has nothing more to say: stop and hand back."""


class CommandSource(Protocol):
    """Asked once a policy tick; never blocks."""

    name: str

    def sample(self, active_s: float, host_stamp_ns: int) -> Wanted:
        """The command at this instant: so much robot time after the policy came into full control.

        The host's clock is for dead-man timers.
        """

    def close(self) -> None:
        """Give back what is held (a terminal's mode, a device)."""
