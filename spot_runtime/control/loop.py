"""The control loop: states in, commands out, one mode machine, one stop.

One thread runs it. A cycle takes what has arrived, judges it, moves the mode machine, computes set-points where a
policy tick is due, and sends. Set-points change at ticks only; between them the same ones go out again with a new end
time, so that a command lapses soon after this process stops.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from spot_log.format.events import EventName
from spot_log.format.records import EventRecord
from spot_log.write.sink import LogSink
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.state import Array, JointCommand, RobotState
from spot_runtime.config import RunConfig
from spot_runtime.control.handover import LoadAverage, Setpoint, hold_setpoint
from spot_runtime.control.loop_stats import LoopStats
from spot_runtime.control.modes import Mode, ModeInputs, next_mode
from spot_runtime.control.recorder import Recorder
from spot_runtime.control.safety import safety
from spot_runtime.control.safety.watchdogs import Watchdogs
from spot_runtime.control.set_point import asked_setpoint, within_stops
from spot_runtime.control.stops import Ending, Reaction, Stop, StopReason, ending_after
from spot_runtime.control.tick import TickMemory, TickResult, schedule_for, tick
from spot_runtime.control.warm_up import WarmWait
from spot_runtime.hal.base import Hal, JointControl
from spot_runtime.hal.errors import HalError
from spot_runtime.host.realtime import let_others_run
from spot_runtime.sources.base import CommandSource

NS_PER_S: Final = 1_000_000_000
RECEIVE_TIMEOUT_S: Final = 0.004
"""Longest wait for a state; watchdogs run at least this often."""

_EVERY_MODE: Final = tuple(Mode)
_NO_COMMAND: Final = np.zeros(3)
_NO_VELOCITY: Final = np.zeros(facts.N_JOINTS)
_NO_VELOCITY.flags.writeable = False


@dataclass(frozen=True)
class LoopStatus:
    """What a progress line shows."""

    mode: Mode
    velocity_command: Array = field(default_factory=lambda: np.zeros(3))
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
    ) -> None:
        """Prepare; the robot stands under the vendor's control.

        Args:
            hal: The robot.
            policy: The network with its contract.
            source: Where velocity commands come from.
            config: The run's configuration.
            sink: The log.
            on_event: Also told of every event; must not block.
            wall_s: Measures how long computing takes.
        """
        self._hal, self._policy, self._source, self._config, self._wall_s = hal, policy, source, config, wall_s
        self._record = Recorder(hal, sink, on_event)
        self._watchdogs = Watchdogs(hal, config, self._record)
        self._policy_gains = policy.gains()
        contract = policy.contract
        self._command_range = (contract.velocity_command_low, contract.velocity_command_high)
        self._handover = config.handover
        self._loads = LoadAverage(config.handover.settle_s)
        self._setpoints = safety.SetpointMemory()
        self._wait = WarmWait(hal)
        self._tick_memory = TickMemory()
        self._schedule = schedule_for(policy.contract.rate_hz)
        self._mode = Mode.READY
        self._mode_since_ns = hal.robot_now_ns()
        self._control_since_ns = 0
        self._active_since_ns = 0
        self._hold: Setpoint | None = None
        self._current: Setpoint | None = None
        self._requested_rad: Array = facts.DEFAULT_POSITION_RAD
        self._velocity_command: Array = _NO_COMMAND
        self._fade_from: Array = _NO_COMMAND
        self._key = 0
        self._sent_ns = 0
        self._ending: Ending | None = None
        self.stats = LoopStats()

    # Outside view ----------------------------------------------------------------------------------------------------

    @property
    def mode(self) -> Mode:
        """What the loop does with the joints."""
        return self._mode

    @property
    def stop(self) -> Stop | None:
        """Why the run ends; None while it goes on."""
        return None if self._ending is None else self._ending.cause

    @property
    def ending(self) -> Ending | None:
        """How the run ends; None while it goes on."""
        return self._ending

    @property
    def newest(self) -> RobotState | None:
        """The newest state that may be used."""
        return self._watchdogs.newest

    @property
    def missed_states(self) -> int:
        """States that never came, since the first."""
        return self._watchdogs.missed_states

    @property
    def is_done(self) -> bool:
        """Whether the loop has nothing more to do: the vendor's stand has the joints, or nothing is sent."""
        if self._mode is Mode.STANDING:
            return self._hal.joint_control is JointControl.OFF
        return self._mode is Mode.RELEASED

    @property
    def status(self) -> LoopStatus:
        """For a progress line."""
        newest, since_ns = self._watchdogs.newest, self._active_since_ns
        active_s = (newest.robot_stamp_ns - since_ns) / NS_PER_S if newest is not None and since_ns else 0.0
        return LoopStatus(self._mode, self._velocity_command, max(0.0, active_s))

    def ask_stop(self, stop: Stop) -> None:
        """End the run for this reason, unless a reaction as strong is already under way."""
        ending = ending_after(self._ending, stop)
        if ending is self._ending:
            return
        is_first, self._ending = self._ending is None, ending
        if is_first and stop.reason.is_urgent:  # a ramp that is under way must not jump
            self._handover = self._config.handover.hastened()
        if ending.reaction is Reaction.ESTOP:
            self._hal.estop()
        name = EventName.COMPLETED if stop.reason.exit_code == 0 else EventName.STOP
        self._record.event(name, f"{stop.reason.label}: {stop.sentence()}", stop.values)

    def cycle(self) -> None:
        """Take what has arrived, judge, decide, send. Never raises: a defect ends in damping, then in silence."""
        try:
            self._cycle()
        except Exception as error:  # noqa: BLE001 - whatever it is, the robot must not be left to it
            is_last_resort = self._mode in (Mode.READY, Mode.DAMPING, Mode.RELEASED)
            if isinstance(error, HalError):
                self.ask_stop(Stop(StopReason.LINK_LOST, str(error)))
            else:
                self.ask_stop(Stop(StopReason.INTERNAL_ERROR, f"{type(error).__name__}: {error}"))
            self._set_mode(Mode.RELEASED if is_last_resort else Mode.DAMPING)

    # One cycle -------------------------------------------------------------------------------------------------------

    def _cycle(self) -> None:
        states = self._receive()
        begin_s = self._wall_s()
        host_ns, robot_ns = self._hal.host_now_ns(), self._hal.robot_now_ns()
        newest = self._judge(states, robot_ns)
        self._move(robot_ns)
        is_tick, lost = False, 0
        if newest is not None:
            self._schedule, is_tick, lost = self._schedule.advance(newest.robot_stamp_ns)
            self._judge_lost_ticks(lost, newest.robot_stamp_ns)
        result: TickResult | None = None
        inference_s = 0.0
        if is_tick and newest is not None and self._mode.runs_policy:
            result, inference_s = self._run_policy(newest, host_ns)
        if is_tick or self._mode is Mode.DAMPING:
            self._compute(result, robot_ns)
        command = None
        if self._mode.sends and (newest is not None or self._is_damping_overdue(robot_ns)):
            command = self._send(newest, is_tick=is_tick)
        compute_s = self._wall_s() - begin_s
        # Nothing from here on is needed before the command leaves, and another thread sends it.
        if command is not None:
            sent_host_ns = self._hal.host_now_ns()
            let_others_run()
            self._record_command(command, sent_host_ns, newest)
        if is_tick and newest is not None and self._mode is not Mode.READY:
            age_s = self._record.tick(
                index=self._schedule.ticks,
                state=newest,
                host_ns=host_ns,
                mode=self._mode.value,
                result=result,
                velocity_command=self._velocity_command,
                inference_s=inference_s,
                compute_s=compute_s,
                key=self._key,
                skipped=lost,
            )
            acquisition_age_s = (robot_ns - newest.robot_stamp_ns) / NS_PER_S
            self.stats.ticked(newest.robot_stamp_ns, compute_s, age_s, acquisition_age_s, lost)
        self.stats.departures(self._hal.departures())
        if newest is not None:
            self._wait.arrivals.add(newest)

    def _receive(self) -> list[RobotState]:
        due_ns, newest = self._schedule.next_due_robot_ns or 0, self._watchdogs.newest
        if newest is None or not self._config.control.rehearse or not self._is_due_next(newest):
            return self._hal.receive(due_ns, RECEIVE_TIMEOUT_S)
        return self._wait.receive(newest, due_ns, RECEIVE_TIMEOUT_S, lambda: self._rehearse(newest))

    def _rehearse(self, state: RobotState) -> None:
        """Go through the tick on this state. All of it is pure, so nothing changes."""
        robot_ns, limits = self._hal.robot_now_ns(), self._config.safety
        safety.screen_state(safety.StateMemory(), state, robot_ns, limits)
        _, result = tick(self._tick_memory, state, self._velocity_command, self._policy)
        safety.limit_setpoint(self._setpoints, self._ask(result, robot_ns).position_rad, limits)

    def _is_due_next(self, state: RobotState) -> bool:
        """Whether the policy will tick on the state after this one."""
        due_ns = self._schedule.next_due_robot_ns
        return self._mode.runs_policy and due_ns is not None and due_ns - state.robot_stamp_ns <= facts.STATE_PERIOD_NS

    def _judge(self, states: list[RobotState], robot_ns: int) -> RobotState | None:
        """Screen what has arrived and look at all else. Returns the newest usable state of this cycle."""
        usable, stops = self._watchdogs.screen(states, robot_ns)
        if self._mode is Mode.READY:
            stops = []  # the vendor's stand is in charge
            for state in usable:
                self._loads.add(state)
        stops += self._watchdogs.look(
            self._mode, robot_ns, mode_since_ns=self._mode_since_ns, control_since_ns=self._control_since_ns
        )
        for stop in stops:
            self.ask_stop(stop)
        return usable[-1] if usable else None

    def _judge_lost_ticks(self, lost: int, stamp_ns: int) -> None:
        """Also where no policy ticks: a set-point held through a gap may be far from where the joints are by now."""
        if lost and self._mode.sends and (stop := self._watchdogs.lost_ticks(lost, stamp_ns)) is not None:
            self.ask_stop(stop)
            self._move(self._hal.robot_now_ns())

    def _move(self, robot_ns: int) -> None:
        """Move the mode machine as far as it goes now."""
        for _ in _EVERY_MODE:
            inputs = ModeInputs(
                in_mode_s=(robot_ns - self._mode_since_ns) / NS_PER_S,
                reaction=None if self._ending is None else self._ending.reaction,
                is_activation_asked=self._mode is Mode.READY and self._loads.is_full,
                is_active=self._hal.joint_control is JointControl.ACTIVE,
            )
            following = next_mode(self._mode, inputs, self._handover)
            if following is self._mode:
                return
            self._set_mode(following)

    def _set_mode(self, mode: Mode) -> None:
        previous, self._mode = self._mode, mode
        self._mode_since_ns = self._hal.robot_now_ns()
        self._record.event(EventName.MODE, f"{previous.value} → {mode.value}")
        if mode is Mode.ACTIVATING:
            self._begin()
        elif mode is Mode.RAMPING_IN:
            self._control_since_ns = self._mode_since_ns
        elif mode is Mode.ACTIVE:
            self._active_since_ns = self._mode_since_ns
        elif mode is Mode.SOFT_STOP:
            self._fade_from = self._velocity_command
        elif mode is Mode.STANDING:
            self._current, self._velocity_command = self._hold, _NO_COMMAND
            self._hal.end_joint_control()
        elif mode is Mode.RELEASED:
            self._hal.release()

    def _begin(self) -> None:
        newest = self._watchdogs.newest
        if newest is None:
            raise RuntimeError("joint control cannot begin without a state")
        self._hold = hold_setpoint(within_stops(newest.position_rad), self._within_torque(self._loads.mean_nm()))
        self._current, self._requested_rad = self._hold, self._hold.position_rad
        self._setpoints = replace(self._setpoints, sent_rad=self._hold.position_rad)
        command = self._next_command()
        self._hal.begin_joint_control(command)
        self._record_command(command, self._hal.host_now_ns(), newest)

    # Computing -------------------------------------------------------------------------------------------------------

    def _run_policy(self, state: RobotState, host_ns: int) -> tuple[TickResult, float]:
        self._velocity_command = self._wanted_velocity(state, host_ns)
        begin_s = self._wall_s()
        self._tick_memory, result = tick(self._tick_memory, state, self._velocity_command, self._policy)
        return result, self._wall_s() - begin_s

    def _wanted_velocity(self, state: RobotState, host_ns: int) -> Array:
        if self._mode is Mode.SOFT_STOP:
            in_mode_s = max(0.0, (state.robot_stamp_ns - self._mode_since_ns) / NS_PER_S)
            fade_s = self._handover.soft_stop_s
            return self._fade_from * max(0.0, 1.0 - in_mode_s / fade_s) if fade_s > 0.0 else _NO_COMMAND
        if self._mode is not Mode.ACTIVE:
            return _NO_COMMAND
        wanted = self._source.sample(max(0.0, (state.robot_stamp_ns - self._active_since_ns) / NS_PER_S), host_ns)
        if wanted.is_finished:
            self.ask_stop(Stop(StopReason.COMPLETED))
        command = wanted.command.tolist()
        within = [min(max(v, low), high) for v, low, high in zip(command, *self._command_range, strict=True)]
        if within == command:
            return wanted.command
        self._record.once(EventName.COMMAND_CLIPPED, "the velocity command was cut to the policy's range")
        return np.array(within)

    def _compute(self, result: TickResult | None, robot_ns: int) -> None:
        """Bring ``_current`` up to date, within all limits; a limit that ends the run turns it into damping."""
        if self._hold is None or not self._mode.sends:
            return
        stop = self._limit(self._ask(result, robot_ns))
        if stop is not None and self._mode is not Mode.DAMPING:
            self.ask_stop(stop)
            self._move(robot_ns)
            self._limit(self._ask(result, robot_ns))

    def _ask(self, result: TickResult | None, robot_ns: int) -> Setpoint:
        newest, hold = self._watchdogs.newest, self._hold
        if hold is None:
            raise RuntimeError("there is no held pose; joint control has not begun")
        return asked_setpoint(
            self._mode,
            (robot_ns - self._mode_since_ns) / NS_PER_S,
            hold=hold,
            policy_rad=None if result is None else result.setpoint_rad,
            policy_gains=self._policy_gains,
            measured_rad=hold.position_rad if newest is None else newest.position_rad,
            config=self._handover,
        )

    def _limit(self, asked: Setpoint) -> Stop | None:
        self._requested_rad = asked.position_rad
        if self._mode is Mode.DAMPING:
            self._current = asked
            return None
        self._setpoints, limited, stop = safety.limit_setpoint(self._setpoints, asked.position_rad, self._config.safety)
        self._current = Setpoint(limited.position_rad, self._within_torque(asked.load_nm), asked.gains)
        if limited.is_cut:
            names = [name for name, is_cut in zip(facts.JOINT_NAMES, limited.cut, strict=True) if is_cut]
            self._record.once(EventName.SETPOINT_CUT, f"requested set-points were cut: {', '.join(names)}")
        return stop

    def _within_torque(self, load_nm: Array) -> Array:
        bound_nm, loads_nm = self._config.safety.feedforward_nm, load_nm.tolist()
        if -bound_nm <= min(loads_nm) and max(loads_nm) <= bound_nm:
            return load_nm
        return np.minimum(np.maximum(load_nm, -bound_nm), bound_nm)

    # Sending ---------------------------------------------------------------------------------------------------------

    def _is_damping_overdue(self, robot_ns: int) -> bool:
        """Damping needs no state, so it is sent by the clock; anything else waits for a state."""
        return self._mode is Mode.DAMPING and robot_ns - self._sent_ns >= facts.STATE_PERIOD_NS

    def _next_command(self) -> JointCommand:
        current = self._current
        if current is None:
            raise RuntimeError("there is no set-point to send")
        robot_ns = self._hal.robot_now_ns()
        command = JointCommand(
            key=self._key + 1,
            position_rad=current.position_rad,
            velocity_rad_s=_NO_VELOCITY,
            load_nm=current.load_nm,
            gains=current.gains,
            end_robot_stamp_ns=robot_ns + round(self._config.control.end_time_ahead_s * NS_PER_S),
        )
        wrong = safety.check_command(command, self._key, robot_ns)
        if wrong is not None:
            raise RuntimeError(f"a command was held back: {wrong}")
        self._key, self._sent_ns = command.key, robot_ns
        return command

    def _record_command(self, command: JointCommand, host_ns: int, state: RobotState | None) -> None:
        self._record.command(command, self._requested_rad, host_ns=host_ns, robot_ns=self._sent_ns, state=state)

    def _send(self, state: RobotState | None, *, is_tick: bool) -> JointCommand | None:
        if not (is_tick or self._config.control.resend_on_state or self._mode is Mode.DAMPING):
            return None
        command = self._next_command()
        self._hal.send(command)
        if is_tick and state is not None:
            self.stats.sent(command.key, state.host_stamp_ns)
        return command
