"""What the vendor's own controller does for us: power, standing, sitting, and the switch to joint control."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Final

from bosdyn.api import basic_command_pb2, power_pb2
from bosdyn.client.power import CommandInProgressError, PowerClient
from bosdyn.client.robot_command import NotPoweredOnError, RobotCommandBuilder

from spot_runtime.config import RobotConfig
from spot_runtime.hal.errors import MotionError
from spot_runtime.hal.spot.calls import Calls
from spot_runtime.hal.spot.vendor_errors import enum_word
from spot_runtime.hal.time_sync import SyncedCommandClient

POLL_S: Final = 0.05
"""Robot time between two looks at the progress of a motion."""

CUT_S: Final = 3.0
"""Robot time in which an e-stop lets the robot settle and cuts its power."""

_STANDS: Final = basic_command_pb2.StandCommand.Feedback.STATUS_IS_STANDING
_FEEDBACK: Final = basic_command_pb2.RobotCommandFeedbackStatus

Wait = Callable[[float], None]
"""Lets this many seconds of robot time pass."""


class Helm:
    """Lets one motion command the robot: the one that was asked for last.

    A call is made again by a thread that waited, when the run may long want something else. Each command gets a lease
    that is newer than the one before, so the robot refuses one that was overtaken on its way.
    """

    def __init__(self, newer_lease: Callable[[], Any]) -> None:
        self._newer_lease = newer_lease
        self._lock = threading.Lock()
        self._holder: object = None

    def hand_to(self, holder: object) -> None:
        """From now on no other holder's command leaves."""
        with self._lock:
            self._holder = holder

    def lease_for(self, holder: object) -> Any:
        """The lease of one command, in the vendor's message. Raises MotionError for any but the holder."""
        with self._lock:
            if holder is not self._holder:
                raise MotionError("it is no longer wanted")
            return self._newer_lease()

    def do_for(self, holder: object, act: Callable[[], None]) -> None:
        """Do this if the holder still is one, and let nobody take over meanwhile."""
        with self._lock:
            if holder is self._holder:
                act()


class Motions:
    """The vendor's motions. Every method raises HalError and nothing else.

    Where another one was made since, or the helm was taken away, no method commands the robot any more.
    """

    def __init__(
        self,
        calls: Calls,
        config: RobotConfig,
        *,
        helm: Helm,
        is_powered: Callable[[], bool],
        is_without_power: Callable[[], bool],
        pause: Wait,
    ) -> None:
        """Take the helm over; ``pause`` lets robot time pass.

        While the motors are being powered on, neither ``is_powered`` nor ``is_without_power`` holds.
        """
        self._calls, self._config, self._pause = calls, config, pause
        self._is_powered, self._is_without_power = is_powered, is_without_power
        self._helm = helm
        helm.hand_to(self)

    def if_wanted(self, act: Callable[[], None]) -> None:
        """Do this unless something else is wanted of the robot by now."""
        self._helm.do_for(self, act)

    def power_on(self) -> None:
        """Give the motors power; returns when they have it."""
        if self._is_powered():
            return
        client, timeout_s = self._calls.client(PowerClient), self._config.rpc_timeout_s
        request = power_pb2.PowerCommandRequest.REQUEST_ON_MOTORS
        # A change of power that is under way cannot be overwritten, as of a run that has just ended.
        answer = self._ask_again_while(
            lambda refusal: isinstance(refusal, CommandInProgressError),
            lambda: self._calls.make("powering on", lambda: client.power_command(request, timeout=timeout_s)),
        )

        def is_done() -> bool:
            status = self._calls.make(
                "powering on", lambda: client.power_command_feedback(answer.power_command_id, timeout=timeout_s)
            )
            if status in (power_pb2.STATUS_SUCCESS, power_pb2.STATUS_IN_PROGRESS):
                return bool(status == power_pb2.STATUS_SUCCESS)
            word = enum_word(power_pb2.PowerCommandStatus, status)
            raise MotionError(f"powering on failed: {word}; see the robot's page")

        if answer.status != power_pb2.STATUS_SUCCESS:
            self._wait(is_done, "power on", self._config.power_timeout_s)

    def _ask_again_while(self, may_pass: Callable[[BaseException | None], bool], ask: Callable[[], Any]) -> Any:
        waited_s = 0.0
        while True:
            try:
                return ask()
            except MotionError as error:
                if not may_pass(error.__cause__) or waited_s >= self._config.power_timeout_s:
                    raise
            self._pause(POLL_S)
            waited_s += POLL_S

    def stand(self) -> None:
        """Let the vendor's controller stand; returns when it does."""
        # Motors that have power may not be ready yet: a robot says so by the status for motors without power.
        command_id = self._ask_again_while(
            lambda refusal: isinstance(refusal, NotPoweredOnError) and self._is_powered(),
            lambda: self._command(RobotCommandBuilder.synchro_stand_command(), "standing"),
        )
        self._wait(lambda: self._stands(command_id), "stand", self._config.stand_timeout_s)

    def ask_for_stand(self) -> None:
        """Ask the vendor's controller to stand, and do not wait for it."""
        self._command(RobotCommandBuilder.synchro_stand_command(), "standing")

    def ask_for_joint_control(self) -> None:
        """Ask the robot to follow the command stream."""
        self._command(RobotCommandBuilder.joint_command(), "entering joint control")

    def power_off(self, *, even_if_off: bool = False) -> None:
        """Sit where needed and cut power; returns when it is cut.

        With ``even_if_off`` it is also asked for where the motors are off, since a request to power them on may be
        under way: that bears an older lease, and is refused from now on.
        """
        if not even_if_off and self._is_without_power():
            return
        try:
            self._command(RobotCommandBuilder.safe_power_off_command(), "powering off")
        except MotionError:
            # While an e-stop cuts the power nothing is carried out any more, and nothing needs to be.
            if not self._is_cut_anyway():
                raise
            return
        self._wait(self._is_without_power, "power off", self._config.power_timeout_s)

    def _is_cut_anyway(self) -> bool:
        waited_s = 0.0
        while not self._is_without_power():
            if waited_s >= CUT_S:
                return False
            self._pause(POLL_S)
            waited_s += POLL_S
        return True

    def _command(self, command: Any, doing: str) -> Any:
        client, timeout_s = self._calls.client(SyncedCommandClient), self._config.rpc_timeout_s

        def send() -> Any:
            return client.robot_command(command, lease=self._helm.lease_for(self), timeout=timeout_s)

        return self._calls.make(doing, lambda: client.synced(send))

    def _stands(self, command_id: Any) -> bool:
        client, timeout_s = self._calls.client(SyncedCommandClient), self._config.rpc_timeout_s
        answer = self._calls.make("standing", lambda: client.robot_command_feedback(command_id, timeout=timeout_s))
        feedback = answer.feedback.synchronized_feedback.mobility_command_feedback
        if feedback.status != _FEEDBACK.STATUS_PROCESSING:
            name = enum_word(_FEEDBACK.Status, feedback.status)
            raise MotionError(f"standing was not carried out: {name}; see the robot's own page")
        return bool(feedback.stand_feedback.status == _STANDS)

    def _wait(self, is_done: Callable[[], bool], what: str, timeout_s: float) -> None:
        waited_s = 0.0
        while not is_done():
            if waited_s >= timeout_s:
                raise MotionError(f"the robot did not {what} within {timeout_s:g} s; see the robot's own page")
            self._pause(POLL_S)
            waited_s += POLL_S
