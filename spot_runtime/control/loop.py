"""The control loop: takes what has arrived, lets :func:`~spot_runtime.control.step.control_step` decide, and does it.

One thread runs it. Whatever fails ends in damping, then in silence.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from spot_log.format.records import CommandRecord, EventRecord, TickRecord
from spot_log.write.sink import LogSink
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.facts import NS_PER_S, Array
from spot_model.robot.state import JointCommand, RobotState
from spot_runtime.config import RunConfig
from spot_runtime.control.loop_stats import LoopStats
from spot_runtime.control.memory import NOTHING_ASKED, Act, Memory, Plan, Step, Tick, first_memory
from spot_runtime.control.modes import Mode
from spot_runtime.control.safety.body_height import check_policy, with_speed_limit
from spot_runtime.control.snapshot import Snapshot
from spot_runtime.control.step import after_failure, check_step, control_step, stopped
from spot_runtime.control.warm_up import WarmReceiver
from spot_runtime.hal.base import Hal, JointControl
from spot_runtime.host.pauses import Pause, Pauses
from spot_runtime.host.realtime import let_others_run
from spot_runtime.sources import CommandSource, Wanted
from spot_runtime.stops import Ending, Stop

_NOTHING: Final[NDArray[np.float32]] = np.zeros(0, dtype=np.float32)


def command_record(step: Step, command: JointCommand, host_ns: int) -> CommandRecord:
    """The command as it was sent at this instant of the host's clock, beside what was requested."""
    state_ns = 0 if step.newest is None else step.newest.robot_stamp_ns
    memory = step.memory
    return CommandRecord(command, memory.drive.requested_rad, host_ns, memory.sent_ns, state_ns)


def state_age_s(tick: Tick, now: Snapshot) -> float:
    """Time from the receipt of a tick's state to the start of the step, s."""
    return (now.host_ns - tick.state.host_stamp_ns) / NS_PER_S


def tick_record(step: Step, tick: Tick, now: Snapshot, compute_s: float) -> TickRecord:
    """The tick with all that the policy saw and gave."""
    memory, result = step.memory, tick.result
    command = memory.drive.command
    return TickRecord(
        index=tick.number,
        robot_stamp_ns=tick.state.robot_stamp_ns,
        host_stamp_ns=now.host_ns,
        mode=memory.phase.mode.value,
        observation=_NOTHING if result is None else result.observation,
        action=_NOTHING if result is None else result.action,
        velocity_command=command if command.shape == NOTHING_ASKED.shape else NOTHING_ASKED,
        state_age_s=state_age_s(tick, now),
        inference_s=tick.inference_s,
        compute_s=compute_s,
        command_key=memory.key,
        skipped=tick.lost,
    )


RECEIVE_TIMEOUT_S: Final = 0.004
"""Longest wait for a state; watchdogs run at least this often."""


@dataclass(frozen=True)
class LoopStatus:
    """What a progress line shows."""

    mode: Mode
    command: Array = field(default_factory=lambda: np.zeros(3))
    """V_x, V_y (m/s), ω_z (rad/s), or a joint script's offsets in rad."""
    active_s: float = 0.0
    """Robot time since the policy has been in full control."""


class ControlLoop:
    """Drives the joints from the vendor's stand to the policy and back, or to a safe stop."""

    def __init__(
        self,
        hal: Hal,
        policy: Policy,
        source: CommandSource,
        config: RunConfig,
        sink: LogSink,
        *,
        on_event: Callable[[EventRecord], None] = lambda _: None,
        wall_s: Callable[[], float] = time.perf_counter,
        pauses: Pauses | None = None,
    ) -> None:
        """Prepare; the robot stands under the vendor's control.

        ``on_event`` is also told of every event, and must not block; ``wall_s`` measures how long computing takes;
        ``pauses`` tells whether this process is why states are old, and is None where robot time waits for it.
        """
        self._pauses = pauses
        self._hal, self._sink, self._on_event, self._wall_s = hal, sink, on_event, wall_s
        contract, pose_rad = policy.contract, policy.default_position_rad[policy.canonical_from_policy]
        self._plan = Plan(
            config,
            policy,
            policy.gains(),
            source.sample,
            wall_s,
            with_speed_limit(config.safety, contract.rate_hz, policy.setpoint_speed_rad_s),
            check_policy(contract, pose_rad, config.safety),
        )
        self._receiver = WarmReceiver(hal)
        self.memory: Memory = first_memory(self._plan, hal.robot_now_ns())
        self.stats = LoopStats()

    # Outside view ----------------------------------------------------------------------------------------------------

    @property
    def mode(self) -> Mode:
        """What the loop does with the joints."""
        return self.memory.phase.mode

    @property
    def ending(self) -> Ending | None:
        """How the run ends; None while it goes on."""
        return self.memory.ending

    @property
    def stop(self) -> Stop | None:
        """Why the run ends; None while it goes on."""
        return None if self.memory.ending is None else self.memory.ending.cause

    @property
    def newest(self) -> RobotState | None:
        """The newest state that may be used."""
        return self.memory.watch.newest

    @property
    def missed_states(self) -> int:
        """States that never came, since the first."""
        return self.memory.watch.states.missed

    @property
    def is_done(self) -> bool:
        """Whether the loop has nothing more to do: the vendor's stand has the joints, or nothing is sent."""
        if self.mode is Mode.STANDING:
            return self._hal.joint_control is JointControl.OFF
        return self.mode is Mode.RELEASED

    @property
    def status(self) -> LoopStatus:
        """For a progress line."""
        newest, since_ns = self.newest, self.memory.phase.active_since_ns
        active_s = (newest.robot_stamp_ns - since_ns) / NS_PER_S if newest is not None and since_ns else 0.0
        return LoopStatus(self.mode, self.memory.drive.command, max(0.0, active_s))

    def ask_stop(self, stop: Stop) -> None:
        """End the run for this reason, unless a reaction as strong is already under way."""
        self._take_up(stopped(self.memory, stop, self._now()))

    # One cycle -------------------------------------------------------------------------------------------------------

    def cycle(self) -> None:
        """Take what has arrived, decide, send. A failure of any kind ends in damping; one while damping, in silence."""
        try:
            self._cycle()
        except Exception as error:  # noqa: BLE001 - whatever it is, the robot must not be left to it
            self._take_up(after_failure(self.memory, error, self._now()))

    def _cycle(self) -> None:
        states = self._receive()
        begin_s = self._wall_s()
        now = self._look(states)
        step = control_step(self.memory, now, self._plan)
        self._take_up(step)
        command = step.command
        if command is not None and Act.BEGIN not in step.acts:
            self._hal.send(command)
        compute_s = self._wall_s() - begin_s
        self._hal.go_on(self._due_ns, RECEIVE_TIMEOUT_S)
        # Nothing from here on is needed before the command leaves, and another thread sends it.
        if command is not None:
            sent_host_ns = self._hal.host_now_ns()
            let_others_run()
            self._sink.put(command_record(step, command, sent_host_ns))
        if step.tick is not None:
            if command is not None:
                self.stats.sent(command.key, step.tick.state.host_stamp_ns)
            record = tick_record(step, step.tick, now, compute_s)
            self._sink.put(record)
            stamp_ns = step.tick.state.robot_stamp_ns
            acquisition_age_s = (now.robot_ns - stamp_ns) / NS_PER_S
            self.stats.ticked(stamp_ns, compute_s, state_age_s(step.tick, now), acquisition_age_s, step.tick.lost)
        if step.usable:
            self.memory = check_step(step)
        self.stats.departures(self._hal.departures())
        if now.log is not None and self._pauses is not None:
            self._pauses.mark()
        if step.newest is not None:
            self._receiver.arrivals.add(step.newest)

    def _take_up(self, step: Step) -> None:
        """Remember, tell, and do what a step wants beside sending."""
        self.memory = step.memory
        for event in step.events:
            self._sink.put(event)
            self._on_event(event)
        for act in step.acts:
            if act is Act.RELEASE:
                self._hal.release()
            elif act is Act.ESTOP:
                self._hal.estop()
            elif act is Act.END:
                self._hal.end_joint_control()
            elif step.command is not None:
                self._hal.begin_joint_control(step.command)

    @property
    def _due_ns(self) -> int:
        return self.memory.schedule.next_due_robot_ns or 0

    def _receive(self) -> list[RobotState]:
        due_ns, newest = self._due_ns, self.newest
        is_next = newest is not None and due_ns - newest.robot_stamp_ns <= facts.STATE_PERIOD_NS
        if newest is None or not (is_next and self.mode.runs_policy and self._plan.config.control.warm_up):
            return self._hal.receive(due_ns, RECEIVE_TIMEOUT_S)
        return self._receiver.receive(newest, due_ns, RECEIVE_TIMEOUT_S, lambda: self._dry_run(newest))

    def _dry_run(self, newest: RobotState) -> None:
        """Take the step of the state that comes next, as if it came now. A step is pure, so nothing changes."""
        command = Wanted(self.memory.drive.command)
        plan = self._plan._replace(wanted_at=lambda *_: command)
        state = replace(newest, robot_stamp_ns=newest.robot_stamp_ns + facts.STATE_PERIOD_NS)
        control_step(self.memory, self._now()._replace(states=(state,)), plan)

    def _look(self, states: list[RobotState]) -> Snapshot:
        hal, watch = self._hal, self.memory.watch
        host_ns, robot_ns = hal.host_now_ns(), hal.robot_now_ns()
        log = self._sink.health() if robot_ns >= watch.next_log_check_ns else None
        newest = states[-1] if states else watch.newest
        pause, control, problems = self._pause(newest, robot_ns), hal.joint_control, hal.problems()
        clock_age_s = 0.0 if log is None else hal.clock_age_s
        return Snapshot(host_ns, robot_ns, states, control, problems, hal.slow_state, clock_age_s, log, pause)

    def _pause(self, newest: RobotState | None, robot_ns: int) -> Pause | None:
        """This process's own, of late; where a state is so old that the run ends, also that there was none."""
        pauses = self._pauses
        if pauses is None:
            return None
        pauses.look()
        if newest is None or self.mode is Mode.READY or self.memory.ending is not None:
            return pauses.recent
        is_stale = (robot_ns - newest.robot_stamp_ns) / NS_PER_S >= self._plan.limits.state_age_damp_s
        return pauses.waits() if is_stale else pauses.recent

    def _now(self) -> Snapshot:
        return Snapshot(self._hal.host_now_ns(), self._hal.robot_now_ns(), joint_control=self._hal.joint_control)
