"""The adapter that takes a log for a robot: the states come as recorded, whatever is sent."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from spot_log import read_run
from spot_log.write.sink import LogSink
from spot_model.errors import BadInputError
from spot_model.robot.facts import NS_PER_S
from spot_model.robot.state import JointCommand, RobotState, SlowState
from spot_runtime.hal.base import Hal, JointControl, RobotInfo
from spot_runtime.hal.registry import Adapter, HalRequest
from spot_runtime.stops import Stop, StopReason

BEFORE_CONTROL_NS: Final = NS_PER_S
"""What is played of the time before the recorded control: the robot stands, as it must before it is taken over."""


def adapter(request: HalRequest) -> Adapter:
    """The adapter of the log at the path that is given as the robot; for ``--hal replay``.

    What the loop sends goes nowhere, so loads contradict it: set ``safety.signals: warn``.
    """
    path = Path(request.robot)
    run = read_run(path)
    if not len(run.ticks):
        raise BadInputError(f"log {path} holds no policy tick, so control never began; give a log of a run")
    begin_ns = int(run.ticks.robot_stamp_ns[0]) - BEFORE_CONTROL_NS
    states = [run.states.state(int(row)) for row in np.flatnonzero(run.states.robot_stamp_ns >= begin_ns)]

    def make(sink: LogSink) -> Hal:
        return ReplayHal(states, sink, robot_id=run.header.robot_id)

    return Adapter(str(path), make)


class ReplayHal:
    """Plays states as fast as they are asked for."""

    def __init__(self, states: Sequence[RobotState], sink: LogSink, *, robot_id: str = "") -> None:
        """Take recorded states, oldest first; the sink takes every state that is played.

        Raises:
            BadInputError: There is no state.
        """
        if not states:
            raise BadInputError("the log holds no state to replay; give a log of a run")
        self._states, self._sink, self._robot_id = states, sink, robot_id
        self._played = 0
        self._now_ns = states[0].robot_stamp_ns
        self._skew_ns = states[0].robot_stamp_ns - states[0].host_stamp_ns
        self._joint_control = JointControl.OFF
        self._has_told_end = False

    def connect(self) -> RobotInfo:
        """See the protocol."""
        return RobotInfo("replay", self._robot_id, self._skew_ns / 1e9, 0.0)

    def stand(self) -> None:
        """A recorded robot stands as it stood."""

    def receive(self, until_robot_ns: int, timeout_s: float) -> list[RobotState]:
        """The recorded states up to the instant that is asked for, at least one; at most those that are due."""
        received: list[RobotState] = []
        while self._played < len(self._states):
            state = self._states[self._played]
            if received and state.robot_stamp_ns > until_robot_ns:
                break
            received.append(state)
            self._sink.put(state)
            self._now_ns = state.robot_stamp_ns
            self._played += 1
        if not received:
            self._now_ns += round(timeout_s * 1e9)
        return received

    def go_on(self, until_robot_ns: int, timeout_s: float) -> None:
        """A recording plays when it is asked to."""

    def robot_now_ns(self) -> int:
        """The stamp of the newest state that was played; runs on with the time that was waited after the last."""
        return self._now_ns

    def host_now_ns(self) -> int:
        """The recorded host clock at that instant."""
        return self._now_ns - self._skew_ns

    def begin_joint_control(self, first: JointCommand) -> None:
        """See the protocol."""
        self._joint_control = JointControl.ACTIVE

    def end_joint_control(self) -> None:
        """See the protocol."""
        self.release()

    @property
    def joint_control(self) -> JointControl:
        """See the protocol."""
        return self._joint_control

    def send(self, command: JointCommand) -> None:
        """It goes nowhere."""

    def departures(self) -> Sequence[tuple[int, int]]:
        """Nothing departs."""
        return ()

    def estop(self) -> None:
        """There are no motors."""

    def release(self) -> None:
        """See the protocol."""
        self._joint_control = JointControl.OFF

    @property
    def slow_state(self) -> SlowState | None:
        """A recording is not polled."""
        return None

    @property
    def clock_age_s(self) -> float:
        """The recording has one clock."""
        return 0.0

    def problems(self) -> Sequence[Stop]:
        """The end of the recording, once."""
        if self._played < len(self._states) or self._has_told_end:
            return []
        self._has_told_end = True
        return [Stop(StopReason.RECORDING_OVER)]

    def power_off(self) -> None:
        """See the protocol."""
        self.release()

    def close(self) -> None:
        """See the protocol."""
        self.release()
