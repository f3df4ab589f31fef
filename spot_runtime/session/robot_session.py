"""One robot from the first call to the returned lease, and the one place that says in which order a run ends.

    connect ──► stand ──► control ──► shut down: stand where it may, sit, power off, return what was taken

A signal may interrupt whatever waits for the robot. After the first, only the e-stop interrupts; after the e-stop,
nothing does.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from spot_log.format.events import EventName
from spot_model.robot.facts import NS_PER_S
from spot_model.robot.rotation import tilt_rad
from spot_model.robot.state import RobotState
from spot_runtime.control.safety.battery import BatteryMemory, check_slow_state
from spot_runtime.control.safety.states import StateMemory, screen_state
from spot_runtime.hal.base import Hal
from spot_runtime.hal.errors import FaultError, HalError
from spot_runtime.safety_limits import SafetyLimits
from spot_runtime.session.signals import OperatorInterrupt, StopSignals
from spot_runtime.session.summary import Outcome
from spot_runtime.stops import Ending, Reaction, Stop, StopReason, unforeseen

STATE_SILENCE_S: Final = 1.0
"""The vendor's controller does not need our states, so a short gap is not a reason to sit down."""


def check_standing(
    hal: Hal, newest: Sequence[RobotState], newest_host_ns: int, battery: BatteryMemory, limits: SafetyLimits
) -> tuple[BatteryMemory, Stop | None]:
    """What is known of the battery now, and what ends the waiting, if anything does.

    ``newest`` holds a state if one has come since the last look; the newest of all came at ``newest_host_ns``. A robot
    that was turned over does not stand.
    """
    problems = hal.problems()
    if problems:
        return battery, max(problems, key=lambda stop: stop.reason.reaction.level)
    for state in newest:
        fallen = screen_state(StateMemory(), state, hal.robot_now_ns(), limits)[2]
        if fallen is not None:
            return battery, fallen
    host_ns, slow = hal.host_now_ns(), hal.slow_state
    silent_s = (host_ns - newest_host_ns) / NS_PER_S
    if silent_s > STATE_SILENCE_S:
        values = {"silent_s": silent_s, "bound_s": STATE_SILENCE_S}
        return battery, Stop(StopReason.STATE_LOST, "while standing by", values)
    return (battery, None) if slow is None else check_slow_state(battery, slow, host_ns, limits)


LOOKS: Final = 10
"""Waits of 0.1 s for a first state; a stream without states is left to the loop."""

TIPPED_RAD: Final = math.radians(60.0)
"""Beyond any slope on which a robot stands or sits."""


class ControlEnd(NamedTuple):
    """How control ended."""

    stop: Stop
    may_stand: bool
    """Whether the vendor's controller may be asked to stand first, so that the robot sits down in good order: not when
    it stands already, must be quick, lies, is tipped, or is not believed."""
    later: tuple[Stop, ...] = ()
    """What is told beside it: that the body tilted too far afterwards, that the e-stop was pressed."""


def control_end(ending: Ending | None) -> ControlEnd:
    """How control ended, from what the loop says of it."""
    if ending is None:
        return ControlEnd(Stop(StopReason.COMPLETED), may_stand=True)
    is_mild = ending.reaction is Reaction.HAND_BACK and not ending.cause.reason.is_urgent
    return ControlEnd(ending.cause, may_stand=is_mild, later=ending.later)


def fall_of(hal: Hal, limits: SafetyLimits) -> Stop | None:
    """What forbids the robot to go on from the pose that the newest state shows; None: nothing, or no state came."""
    for state in hal.receive(0, 0.1)[-1:]:
        return screen_state(StateMemory(), state, hal.robot_now_ns(), limits)[2]
    return None


def _lean_rad(hal: Hal, looks: int, limits: SafetyLimits) -> float:
    """Between the body's z axis and the vertical, by the newest state.

    0 where none came in so many looks, NaN where its attitude is no rotation.
    """
    for _ in range(looks):
        for state in hal.receive(0, 0.1)[-1:]:
            norm_error = abs(math.hypot(*state.odom_from_body_wxyz.tolist()) - 1.0)
            return tilt_rad(state.odom_from_body_wxyz) if norm_error <= limits.quaternion_norm_error else math.nan
    return 0.0


class RobotSession:
    """Connects, lets something control the robot, and shuts it down whatever happened."""

    def __init__(
        self,
        signals: StopSignals,
        event: Callable[[EventName, str], None],
        *,
        limits: SafetyLimits | None = None,
        say: Callable[[str], None] = lambda _: None,
        on_shut_down: Callable[[], None] = lambda: None,
    ) -> None:
        """Prepare. What the operator asks by ``signals``, entered, ends the session.

        ``on_shut_down`` is called when shutting down begins; once, so that its own failure cannot keep the power on.
        """
        self._limits = limits or SafetyLimits()
        self._signals, self._event, self._say, self._on_shut_down = signals, event, say, on_shut_down
        self._has_told_shut_down, self._is_fall_told = False, False
        self.hal: Hal | None = None
        self.robot_id = ""
        """Who answered; empty before."""
        self.outcome = Outcome()

    def drive(self, make_hal: Callable[[], Hal], control: Callable[[Hal], ControlEnd]) -> None:
        """Connect, stand, control, shut down. Raises nothing of what the robot or the operator does."""
        try:
            self._connect_and_control(make_hal, control)
        except OperatorInterrupt as interrupt:
            self._interrupted(interrupt.stop)
            self.shut_down(interrupt.stop.reason.reaction)
        finally:
            self._signals.interrupts = False
            if self.hal is not None:
                self.hal.close()

    def shut_down(self, reaction: Reaction = Reaction.EXPIRE, *, may_stand: bool = False) -> None:
        """Bring the robot to rest and see that its motors are off. :meth:`drive` then returns lease and e-stop.

        The reaction is the strongest that anything has asked for; an e-stop is pressed first. With ``may_stand`` the
        vendor's controller stands first; any signal then cuts that short.
        """
        hal = self.hal
        if hal is None:
            return
        if reaction is Reaction.ESTOP:
            hal.estop()
        if self.robot_id and not self._has_told_shut_down:
            self._has_told_shut_down = True
            self._on_shut_down()
        try:
            if reaction is not Reaction.ESTOP:
                self._signals.interrupt_waits(only_estop=not may_stand)
            if may_stand:
                self._stand(hal)
            self._power_off(hal)
        except OperatorInterrupt as interrupt:
            self._interrupted(interrupt.stop)
            self.shut_down(interrupt.stop.reason.reaction)

    def _connect_and_control(self, make_hal: Callable[[], Hal], control: Callable[[Hal], ControlEnd]) -> None:
        """An interrupt may come at any point, also while an error is answered."""
        try:
            self._signals.interrupt_waits()
            hal = self.hal = make_hal()
            self._connect(hal)
            self._signals.interrupts = False
            end = control(hal)
            self.outcome = self.outcome.after_stop(end.stop)
            for stop in end.later:
                self.outcome = self.outcome.after_stop(stop)
            self.shut_down(may_stand=end.may_stand)
        except HalError as error:
            self.outcome = self.outcome.after_error(error)
            self._event(EventName.CONNECTION_FAILED, str(error))
            self.shut_down()
        except Exception as error:  # noqa: BLE001 - a defect here must not leave the robot standing with power
            stop = unforeseen(error)
            self.outcome = self.outcome.after_stop(stop)
            self._event(stop.event_name, f"{stop.reason.label}: {stop.sentence()}")
            self.shut_down()

    def _connect(self, hal: Hal) -> None:
        info = hal.connect()
        self.robot_id = info.robot_id
        round_trip_ms = info.round_trip_s * 1e3
        text = f"{info.robot_id}; clock {info.clock_skew_s:+.3f} s from ours, round trip {round_trip_ms:.1f} ms"
        self._event(EventName.CONNECTED, text)
        lean_rad = _lean_rad(hal, LOOKS, self._limits)
        # What is not finite, or no rotation, is left to the loop, which checks every state before it takes over.
        if lean_rad > TIPPED_RAD:  # neither stand nor policy is asked to right it
            self._is_fall_told = True
            raise FaultError(f"the body is tilted by {math.degrees(lean_rad):.0f}°; set the robot on its belly or feet")
        self._say("powering on and standing …")
        hal.stand()

    def _interrupted(self, stop: Stop) -> None:
        self.outcome = self.outcome.after_stop(stop)
        self._event(stop.event_name, f"{stop.reason.label}: {stop.sentence()}")

    def _stand(self, hal: Hal) -> None:
        try:
            hal.stand()
        except HalError as error:
            self._event(EventName.STAND_FAILED, f"{error}; it sits down as it is")
            self.outcome = self.outcome.after_error(error)
        self._look_at_fall(hal)

    def _look_at_fall(self, hal: Hal) -> None:
        """A robot that fell while it was handed back did not end well, whatever had been asked before."""
        stop = fall_of(hal, self._limits)
        if stop is not None:
            self._interrupted(stop)

    def _power_off(self, hal: Hal) -> None:
        """Sit and cut power, and look how the robot rests; log, outcome and summary say what did not go well."""
        is_off = True
        try:
            hal.power_off()
        except HalError as error:
            is_off = False
            self._event(EventName.POWER_OFF_FAILED, f"{error}; see to the robot")
            self.outcome = self.outcome.after_power_failure(error)
        if not self.robot_id:  # of a robot that was never reached, nothing is known
            return
        lean_rad = 0.0
        with contextlib.suppress(HalError):
            lean_rad = _lean_rad(hal, 1, self._limits)
        has_fallen = lean_rad > TIPPED_RAD
        if is_off:
            lies = "the motors are off; the robot has tipped over: see to it"
            self._event(EventName.POWER_OFF, lies if has_fallen else "the robot sits and its motors are off")
        if has_fallen and not self._is_fall_told:
            self._is_fall_told = True
            self.outcome = self.outcome.after_fall(lean_rad)
