"""Joint control: streams of commands, the newest one in effect, and what becomes of it in time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fake_robot.network.status import StreamFailure
from fake_robot.robot.streamed_command import (
    EXPIRED,
    INACTIVE,
    TOO_DISTANT,
    CommandRefusedError,
    StreamedCommand,
    StreamGrammar,
)
from fake_robot.scenario.parts import JointControlConfig
from spot_model.plant.command_channel import ServoCommand
from spot_model.robot.facts import JOINT_NAMES, N_JOINTS, NS_PER_S, Array


class Stream:
    """The body's end of one joint-control stream."""

    def __init__(self, opened_ns: int, on_failure: Callable[[], None], n_joints: int = N_JOINTS) -> None:
        self.grammar = StreamGrammar(n_joints)
        self.inactive_since_ns = opened_ns
        self.failure: StreamFailure | None = None
        self._on_failure = on_failure

    def fail(self, failure: StreamFailure) -> None:
        """End the stream with this status; the first one counts."""
        if self.failure is None:
            self.failure = failure
            self._on_failure()


@dataclass(frozen=True)
class Expiry:
    """The newest command is past its end."""

    message: str


class JointControl:
    """The streams and the command in effect. Times are nanoseconds of robot time since the start.

    ``stamp_ns`` turns such a time into a stamp of the robot's clock, as commands bear them.
    """

    def __init__(self, config: JointControlConfig, stamp_ns: Callable[[int], int]) -> None:
        self._config = config
        self.stamp_ns = stamp_ns
        self.streams: list[Stream] = []
        self.is_active = False
        self._since_ns = 0
        self._newest: StreamedCommand | None = None
        self.last_key = 0
        self.last_received_ns = 0
        self.received = 0
        self.is_failed = False
        """Whether joint control ended last by itself: expired, or through a fault."""

    # Entering and leaving ---------------------------------------------------------------------------------------------

    def enter(self, now_ns: int) -> None:
        """From now on commands take effect; what arrived before does not."""
        self.is_active, self.is_failed = True, False
        self._since_ns = now_ns
        self._newest = None

    def leave(self, now_ns: int, failure: StreamFailure | None) -> None:
        """Commands have no effect any more. With a failure, which is the robot's own doing, the streams end."""
        self.is_active = False
        self._newest = None
        for stream in self.streams:
            stream.inactive_since_ns = now_ns
        if failure is not None:
            self.is_failed = True
            self.fail_streams(failure)

    def fail_streams(self, failure: StreamFailure) -> None:
        """End all streams."""
        for stream in self.streams:
            stream.fail(failure)
        self.streams.clear()

    def forget(self, stream: Stream) -> None:
        """A stream is over. What it has sent may still arrive, and then counts."""
        if stream in self.streams:
            self.streams.remove(stream)

    # Commands ---------------------------------------------------------------------------------------------------------

    def receive(self, stream: Stream, command: StreamedCommand, now_ns: int, position_rad: Array) -> None:
        """A command has arrived on a stream; measured joint positions have shape (12,)."""
        if stream.failure is not None:
            return
        self.received += 1
        self.last_key, self.last_received_ns = command.key, now_ns
        try:
            self._check(command, now_ns, position_rad)
        except CommandRefusedError as error:
            stream.fail(error.failure)
            self.forget(stream)
            return
        if self.is_active:
            self._newest = command.received_at(self.stamp_ns(now_ns))

    def check_end_time(self, command: StreamedCommand, now_ns: int) -> None:
        """A command is neither over nor ends in the far future.

        Raises:
            CommandRefusedError: It is, or does; EXPIRED or TOO_DISTANT.
        """
        ahead_s = (command.end_stamp_ns - self.stamp_ns(now_ns)) * 1e-9
        if ahead_s < 0.0:
            raise CommandRefusedError(
                EXPIRED,
                f"command {command.key} arrived {-ahead_s * 1e3:.1f} ms after its end_time; "
                "check the time synchronisation, the link, and how far ahead end_time lies",
            )
        if ahead_s > self._config.max_end_time_ahead_s:
            raise CommandRefusedError(
                TOO_DISTANT,
                f"end_time of command {command.key} lies {ahead_s:.3g} s ahead; "
                f"allowed: {self._config.max_end_time_ahead_s:g} s",
            )

    def servo(self, now_ns: int) -> ServoCommand | Expiry | None:
        """Set-points in effect now; None before the first command, and the reason once the newest one is void."""
        command = self._newest
        if command is None:
            return None
        stamp_ns = self.stamp_ns(now_ns)
        if stamp_ns > command.end_stamp_ns:
            late_ms = (stamp_ns - command.end_stamp_ns) * 1e-6
            return Expiry(f"command {command.key} ended {late_ms:.1f} ms ago, and no newer one has arrived")
        return command.servo_at(stamp_ns)

    def arm_servo(self) -> ServoCommand | None:
        """What the newest command asks of the arm; None without a command, or an arm."""
        return None if self._newest is None else self._newest.arm

    def excess_velocity(self, velocity_rad_s: Array) -> str | None:
        """How the command's velocity safety limit is exceeded; None while it holds."""
        limit = None if self._newest is None else self._newest.velocity_limit_rad_s
        if limit is None or float(np.abs(velocity_rad_s).max()) <= limit:
            return None
        joint = int(np.abs(velocity_rad_s).argmax())
        return f"{JOINT_NAMES[joint]} moves at {velocity_rad_s[joint]:.2f} rad/s; velocity_safety_limit = {limit:g}"

    # Waiting ----------------------------------------------------------------------------------------------------------

    def has_waited_too_long(self, now_ns: int) -> bool:
        """Whether joint control is active without a command for longer than it may be."""
        return self._newest is None and now_ns - self._since_ns > self._config.activation_wait_s * NS_PER_S

    def end_idle_streams(self, now_ns: int, doing: str) -> None:
        """End streams that have run for too long while the robot is not in joint control but ``doing`` this."""
        wait_s = self._config.activation_wait_s
        for stream in [s for s in self.streams if now_ns - s.inactive_since_ns > wait_s * NS_PER_S]:
            stream.fail(
                StreamFailure(
                    INACTIVE, f"the robot is {doing}, not in joint control, for {wait_s:g} s; send a joint request"
                )
            )
            self.forget(stream)

    # Private ----------------------------------------------------------------------------------------------------------

    def _check(self, command: StreamedCommand, now_ns: int, position_rad: Array) -> None:
        self.check_end_time(command, now_ns)
        bound = self._config.max_first_setpoint_distance_rad
        if bound is not None and self.is_active and self._newest is None:
            distance = np.abs(command.servo.position_rad - position_rad)[0]
            joint = int(distance.argmax())
            if distance[joint] > bound:
                raise CommandRefusedError(
                    TOO_DISTANT,
                    f"the first set-point of {JOINT_NAMES[joint]} lies {distance[joint]:.3f} rad from the measured "
                    f"position; allowed: {bound:g} rad",
                )
