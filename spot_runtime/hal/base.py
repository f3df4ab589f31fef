"""What the loop needs of a robot: one small protocol that every adapter keeps.

The order of a run: ``connect``, ``stand``, ``begin_joint_control`` with a first command, then ``receive`` and ``send``
in turn; ``end_joint_control``, with ``send`` going on until it is done; ``power_off``; ``close``. After a failure at
any point, ``release``, ``power_off`` and ``close`` still work.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from spot_model.robot.state import JointCommand, RobotState, SlowState
from spot_runtime.stops import Stop


@dataclass(frozen=True)
class RobotInfo:
    """Who answered."""

    adapter: str
    """Name of the adapter."""
    robot_id: str
    """Serial number and nickname, or what the adapter knows."""
    clock_skew_s: float
    """Robot clock minus host clock."""
    round_trip_s: float
    """Shortest round trip of the time sync."""


class JointControl(Enum):
    """How far the switch to joint control is."""

    OFF = "off"
    PENDING = "pending"
    ACTIVE = "active"
    LEAVING = "leaving"
    """The vendor's stand has been asked to take the joints back."""
    FAILED = "failed"
    """Refused, or the stream has ended; ``problems`` says why."""


class Hal(Protocol):
    """One robot. Everything but ``receive``, ``connect``, ``stand`` and ``power_off`` returns at once."""

    def connect(self) -> RobotInfo:
        """Reach the robot, sync clocks, check e-stop and faults, take the lease; start the state stream.

        Raises:
            HalError: One of its subclasses says what is in the way and what to do.
        """

    def stand(self) -> None:
        """Let the vendor's controller stand; returns when it does. Raises HalError.

        Only the first call powers on. If the power was cut since, somebody stands beside the robot, and it stays off.
        """

    def receive(self, until_robot_ns: int, timeout_s: float) -> list[RobotState]:
        """States that have arrived since the last call, oldest first; empty when none came within the time-out.

        May return before a state stamped ``until_robot_ns`` has come. In lock-step, advances the robot towards it.
        """

    def go_on(self, until_robot_ns: int, timeout_s: float) -> None:
        """Take note that :meth:`receive` comes next, with these arguments. Never blocks.

        In lock-step the robot begins to advance, while the loop still does what does not concern it.
        """

    def robot_now_ns(self) -> int:
        """The robot's clock, now."""

    def host_now_ns(self) -> int:
        """The host's clock, now: UNIX time that never jumps."""

    def begin_joint_control(self, first: JointCommand) -> None:
        """Open the command stream with a first command and ask for joint control; see :attr:`joint_control`."""

    def end_joint_control(self) -> None:
        """Ask the vendor's stand to take the joints back; commands go on until it has. See :attr:`joint_control`."""

    @property
    def joint_control(self) -> JointControl:
        """How far the switch to joint control is."""

    def send(self, command: JointCommand) -> None:
        """Hand a command to the stream; an unsent older one is replaced. Never blocks."""

    def departures(self) -> Sequence[tuple[int, int]]:
        """Key and host stamp of each command that the transport has taken since the last call."""

    def release(self) -> None:
        """Send nothing more; the last command lapses."""

    def estop(self) -> None:
        """Have the robot cut its motors' power, by the software e-stop; it is not taken back. Never blocks.

        Commands still go out meanwhile, so that the joints are damped until the power is gone.
        """

    @property
    def slow_state(self) -> SlowState | None:
        """The newest poll of battery, temperatures and faults."""

    @property
    def clock_age_s(self) -> float:
        """Seconds since the clocks were last compared; what passed since then is extrapolated."""

    def problems(self) -> Sequence[Stop]:
        """What went wrong beside the streams since the last call: lease, e-stop, polls, a stream that ended."""

    def power_off(self) -> None:
        """Sit and cut motor power, from any state. Raises HalError, also where the lease was lost."""

    def close(self) -> None:
        """Stop all threads and give everything back; a second call does nothing."""
