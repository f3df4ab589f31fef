"""The control loop: states in, commands out, one mode machine, one stop.

One thread runs it. A cycle takes what has arrived, judges it, moves the mode machine, computes set-points where a
policy tick is due, and sends. Set-points change at ticks only; between them the same ones go out again with a new end
time, so that a command lapses soon after this process stops.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from spot_model import facts
from spot_model.policy import Policy
from spot_model.state import Array, JointCommand, RobotState
from spot_runtime import safety
from spot_runtime.config import RunConfig
from spot_runtime.events import EventName
from spot_runtime.hal.base import Hal, JointControl
from spot_runtime.handover import (
    LoadAverage,
    Setpoint,
    blend,
    damping_setpoint,
    hold_setpoint,
    hold_weight_in,
    hold_weight_out,
    policy_setpoint,
)
from spot_runtime.log.records import CommandRecord, EventRecord, TickRecord
from spot_runtime.log.sink import LogSink
from spot_runtime.loop_stats import LoopStats
from spot_runtime.modes import Mode, ModeInputs, next_mode
from spot_runtime.sources.base import CommandSource
from spot_runtime.stops import Reaction, Stop, StopReason, stronger
from spot_runtime.tick import TickMemory, TickResult, schedule_for, tick

NS_PER_S: Final = 1_000_000_000
RECEIVE_TIMEOUT_S: Final = 0.004
"""Longest wait for a state; watchdogs run at least this often."""

LOG_CHECK_PERIOD_S: Final = 0.5
_NO_ACTION: Final = np.zeros(0, dtype=np.float32)
_ZERO: Final = np.zeros(3)


@dataclass(frozen=True)
class LoopStatus:
    """What a progress line shows."""

    mode: Mode = Mode.READY
    velocity_command: Array = field(default_factory=lambda: np.zeros(3))
    active_s: float = 0.0


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
        self._hal, self._policy, self._source = hal, policy, source
        self._config, self._sink, self._on_event, self._wall_s = config, sink, on_event, wall_s
        self._policy_gains = policy.gains()
        self._loads = LoadAverage(config.handover.settle_s)
        self._states = safety.StateMemory()
        self._setpoints = safety.SetpointMemory()
        self._tick_memory = TickMemory()
        self._schedule = schedule_for(policy.contract.rate_hz)
        self._mode = Mode.READY
        self._mode_since_ns = hal.robot_now_ns()
        self._active_since_ns = 0
        self._hold: Setpoint | None = None
        self._current: Setpoint | None = None
        self._requested_rad: Array = facts.DEFAULT_POSITION_RAD
        self._velocity_command: Array = _ZERO
        self._fade_from: Array = _ZERO
        self._key = 0
        self._last_send_ns = 0
        self._next_log_check_ns = 0
        self._told: set[EventName] = set()
        self._lost_at_ns: list[int] = []
        self._stop: Stop | None = None
        self.stats = LoopStats()

    # Outside view ----------------------------------------------------------------------------------------------------

    @property
    def mode(self) -> Mode:
        """What the loop does with the joints."""
        return self._mode

    @property
    def stop(self) -> Stop | None:
        """Why the run ends; None while it goes on."""
        return self._stop

    @property
    def is_done(self) -> bool:
        """Whether the loop has nothing more to do: the pose is held for the vendor's stand, or nothing is sent."""
        if self._mode is Mode.STANDING:
            return self._hal.joint_control is JointControl.OFF
        return self._mode is Mode.RELEASED

    @property
    def status(self) -> LoopStatus:
        """For a progress line."""
        active_s = 0.0
        if self._active_since_ns:
            active_s = max(0.0, (self._newest_stamp_ns() - self._active_since_ns) / NS_PER_S)
        return LoopStatus(self._mode, self._velocity_command, active_s)

    def ask_stop(self, stop: Stop) -> None:
        """End the run for this reason, unless a stronger one already does."""
        chosen = stronger(self._stop, stop)
        if chosen is self._stop:
            return
        self._stop = chosen
        name = EventName.COMPLETED if stop.reason.exit_code == 0 else EventName.STOP
        self._event(name, f"{stop.reason.label}: {stop.sentence()}", stop.values)

    # One cycle -------------------------------------------------------------------------------------------------------

    def cycle(self) -> None:
        """Take what has arrived, judge, decide, send. Never raises: a defect ends in damping, then in silence."""
        try:
            self._cycle()
        except Exception as error:  # noqa: BLE001 - whatever it is, the robot must not be left to it
            was_damping = self._mode in (Mode.DAMPING, Mode.RELEASED)
            self.ask_stop(Stop(StopReason.INTERNAL_ERROR, f"{type(error).__name__}: {error}"))
            self._set_mode(Mode.RELEASED if was_damping or self._mode is Mode.READY else Mode.DAMPING)

    def _cycle(self) -> None:
        due_ns = self._schedule.next_due_robot_ns
        states = self._hal.receive(0 if due_ns is None else due_ns, RECEIVE_TIMEOUT_S)
        begin_s = self._wall_s()
        host_ns, robot_ns = self._hal.host_now_ns(), self._hal.robot_now_ns()
        has_new = self._take(states, robot_ns)
        self._watch(robot_ns)
        self._move(robot_ns)
        is_tick, lost = False, 0
        newest = self._states.newest
        if has_new and newest is not None:
            self._schedule, is_tick, lost = self._schedule.advance(newest.robot_stamp_ns)
            if is_tick and lost and self._mode.runs_policy:
                self._note_lost(lost, newest.robot_stamp_ns)
        result: TickResult | None = None
        inference_s = 0.0
        if is_tick and newest is not None and self._mode.runs_policy:
            result, inference_s = self._run_policy(newest, host_ns)
        if self._mode.sends and (is_tick or self._current is None or self._mode is Mode.DAMPING):
            self._compute(result, robot_ns)
            self._move(robot_ns)
            if self._mode is Mode.DAMPING:
                self._compute(None, robot_ns)
        if self._mode.sends and (has_new or self._is_send_overdue(robot_ns)):
            self._send(is_tick, newest)
        if is_tick and newest is not None and self._mode is not Mode.READY:
            self._log_tick(newest, host_ns, result, inference_s, self._wall_s() - begin_s, lost)
        self.stats.departures(self._hal.departures())
        self._check_log(robot_ns)

    # Judging ---------------------------------------------------------------------------------------------------------

    def _take(self, states: Sequence[RobotState], robot_ns: int) -> bool:
        has_new = False
        limits = self._config.safety
        for state in states:
            self._states, is_usable, stop = safety.screen_state(self._states, state, robot_ns, limits)
            if stop is not None and self._mode is not Mode.READY:
                self.ask_stop(stop)
            if is_usable:
                has_new = True
                if self._mode is Mode.READY:
                    self._loads.add(state)
        if self._states.rejected:
            self._once(EventName.STATE_REJECTED, "a duplicated or back-dated state arrived; it was not used", {})
        return has_new

    def _watch(self, robot_ns: int) -> None:
        for problem in self._hal.problems():
            self.ask_stop(problem)
        limits = self._config.safety
        if self._mode is Mode.READY:
            self._watch_ready(robot_ns)
            return
        stop = safety.check_age(self._states, robot_ns, limits)
        if stop is None and self._mode.runs_policy and not self._stop:
            stop = safety.check_echo(self._states, self._active_since_ns or self._mode_since_ns, limits)
        if stop is not None:
            self.ask_stop(stop)
        age_s = (robot_ns - self._newest_stamp_ns()) / NS_PER_S
        if age_s > limits.state_age_warn_s:
            values = {"age_s": age_s, "bound_s": limits.state_age_warn_s}
            self._once(EventName.STATE_OLD, f"the newest state is {age_s * 1e3:.1f} ms old", values)
        slow = self._hal.slow_state
        if slow is not None:
            slow_stop = safety.check_slow_state(slow, limits)
            if slow_stop is not None:
                self.ask_stop(slow_stop)

    def _watch_ready(self, robot_ns: int) -> None:
        waited_s = (robot_ns - self._mode_since_ns) / NS_PER_S
        bound_s = self._config.handover.activation_timeout_s
        if waited_s > bound_s:
            self.ask_stop(
                Stop(StopReason.STATE_LOST, "before joint control", {"waited_s": waited_s, "bound_s": bound_s})
            )

    def _note_lost(self, lost: int, stamp_ns: int) -> None:
        self._lost_at_ns = [t for t in self._lost_at_ns if t > stamp_ns - NS_PER_S] + [stamp_ns] * min(lost, 1000)
        bound = self._config.safety.skipped_ticks
        values = {"in_last_second": float(len(self._lost_at_ns)), "bound": float(bound)}
        self._once(EventName.TICKS_SKIPPED, f"{lost} policy ticks were lost", values)
        if len(self._lost_at_ns) >= bound:
            self.ask_stop(Stop(StopReason.TICKS_SKIPPED, "", values))

    def _check_log(self, robot_ns: int) -> None:
        if robot_ns < self._next_log_check_ns:
            return
        self._next_log_check_ns = robot_ns + round(LOG_CHECK_PERIOD_S * NS_PER_S)
        health = self._sink.health()
        if health.problem:
            self._once(EventName.LOG_PROBLEM, health.problem, {})
            if self._config.log.stop_on_failure and not health.is_alive:
                self.ask_stop(Stop(StopReason.LOG_FAILED, health.problem))

    # Modes -----------------------------------------------------------------------------------------------------------

    def _move(self, robot_ns: int) -> None:
        """Move the mode machine as far as it goes now."""
        for _ in Mode:
            inputs = ModeInputs(
                in_mode_s=(robot_ns - self._mode_since_ns) / NS_PER_S,
                stop=self._stop,
                is_activation_asked=self._mode is Mode.READY and self._loads.is_full,
                is_active=self._hal.joint_control is JointControl.ACTIVE,
            )
            following = next_mode(self._mode, inputs, self._config.handover)
            if following is self._mode:
                break
            self._set_mode(following)
        reason = {Mode.ACTIVATING: StopReason.ACTIVATION_FAILED, Mode.STANDING: StopReason.HAND_BACK_FAILED}
        waited_s = (robot_ns - self._mode_since_ns) / NS_PER_S
        bound_s = self._config.handover.activation_timeout_s
        if self._mode in reason and waited_s > bound_s:
            self.ask_stop(Stop(reason[self._mode], "no answer", {"waited_s": waited_s, "bound_s": bound_s}))

    def _set_mode(self, mode: Mode) -> None:
        previous, self._mode = self._mode, mode
        self._mode_since_ns = self._hal.robot_now_ns()
        if mode is Mode.ACTIVATING:
            self._begin()
        elif mode is Mode.RAMPING_IN:
            self._active_since_ns = self._mode_since_ns
        elif mode is Mode.ACTIVE:
            self._active_since_ns = self._mode_since_ns
        elif mode is Mode.SOFT_STOP:
            self._fade_from = self._velocity_command
        elif mode is Mode.STANDING:
            self._hal.end_joint_control()
        elif mode is Mode.RELEASED:
            self._hal.release()
        self._event(EventName.MODE, f"{previous.value} → {mode.value}", {})

    def _begin(self) -> None:
        newest = self._states.newest
        if newest is None:
            raise RuntimeError("joint control cannot begin without a state")
        low, high = facts.POSITION_LOW_RAD, facts.POSITION_HIGH_RAD
        self._hold = hold_setpoint(np.clip(newest.position_rad, low, high), self._loads.mean_nm())
        self._current = self._hold
        self._requested_rad = self._hold.position_rad
        self._setpoints = replace(self._setpoints, sent_rad=self._hold.position_rad)
        command = self._next_command()
        self._hal.begin_joint_control(command)
        self._log_command(command, newest)

    # Computing -------------------------------------------------------------------------------------------------------

    def _run_policy(self, state: RobotState, host_ns: int) -> tuple[TickResult, float]:
        self._velocity_command = self._wanted_velocity(state, host_ns)
        begin_s = self._wall_s()
        self._tick_memory, result = tick(self._tick_memory, state, self._velocity_command, self._policy)
        return result, self._wall_s() - begin_s

    def _wanted_velocity(self, state: RobotState, host_ns: int) -> Array:
        if self._mode is Mode.SOFT_STOP:
            in_mode_s = (state.robot_stamp_ns - self._mode_since_ns) / NS_PER_S
            fade_s = self._config.handover.soft_stop_s
            share = max(0.0, 1.0 - max(0.0, in_mode_s) / fade_s) if fade_s > 0.0 else 0.0
            return self._fade_from * share
        if self._mode is not Mode.ACTIVE:
            return _ZERO
        active_s = max(0.0, (state.robot_stamp_ns - self._active_since_ns) / NS_PER_S)
        wanted = self._source.sample(active_s, host_ns)
        if wanted.is_finished:
            self.ask_stop(Stop(StopReason.COMPLETED))
        contract = self._policy.contract
        clipped = np.clip(wanted.command, contract.velocity_command_low, contract.velocity_command_high)
        if not np.array_equal(clipped, wanted.command):
            self._once(EventName.COMMAND_CLIPPED, "the velocity command was brought into the policy's range", {})
        return np.asarray(clipped, dtype=np.float64)

    def _compute(self, result: TickResult | None, robot_ns: int) -> None:
        """Set-points of this tick, within all limits, into ``_current``."""
        handover = self._config.handover
        if self._hold is None:
            raise RuntimeError("there is no held pose; joint control has not begun")
        if self._mode is Mode.DAMPING:
            newest = self._states.newest
            position = self._hold.position_rad if newest is None else newest.position_rad
            low, high = facts.POSITION_LOW_RAD, facts.POSITION_HIGH_RAD
            self._current = damping_setpoint(np.clip(position, low, high), handover.damping_kd_nm_s_per_rad)
            self._requested_rad = self._current.position_rad
            return
        asked = self._hold
        if result is not None:
            wanted = policy_setpoint(result.setpoint_rad, self._policy_gains)
            in_mode_s = (robot_ns - self._mode_since_ns) / NS_PER_S
            weight = 0.0
            if self._mode is Mode.RAMPING_IN:
                weight = hold_weight_in(in_mode_s / handover.ramp_in_s)
            elif self._mode is Mode.RAMPING_OUT:
                weight = hold_weight_out(in_mode_s / handover.ramp_out_s)
            asked = blend(self._hold, wanted, weight)
        elif self._mode.runs_policy and self._current is not None:
            return  # no tick is due; what was sent last goes on
        self._setpoints, limited, stop = safety.limit_setpoint(self._setpoints, asked.position_rad, self._config.safety)
        self._requested_rad = asked.position_rad
        bound_nm = self._config.safety.feedforward_nm
        self._current = replace(
            asked, position_rad=limited.position_rad, load_nm=np.clip(asked.load_nm, -bound_nm, bound_nm)
        )
        if stop is not None:
            self.ask_stop(stop)
        elif self._setpoints.cut_ticks:
            names = [n for n, cut in zip(facts.JOINT_NAMES, limited.cut, strict=True) if cut]
            self._once(EventName.SETPOINT_CUT, f"requested set-points were cut: {', '.join(names)}", {})

    # Sending and logging ---------------------------------------------------------------------------------------------

    def _is_send_overdue(self, robot_ns: int) -> bool:
        """Damping needs no state, so it is sent by the clock; anything else waits for a state."""
        return self._mode is Mode.DAMPING and robot_ns - self._last_send_ns >= facts.STATE_PERIOD_NS

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
        self._key = command.key
        self._last_send_ns = robot_ns
        return command

    def _send(self, is_tick: bool, state: RobotState | None) -> None:
        if not (is_tick or self._config.control.resend_on_state or self._mode is Mode.DAMPING):
            return
        command = self._next_command()
        self._hal.send(command)
        if is_tick and state is not None:
            self.stats.sent(command.key, state.host_stamp_ns)
        self._log_command(command, state)

    def _log_command(self, command: JointCommand, state: RobotState | None) -> None:
        self._sink.command(
            CommandRecord(
                command=command,
                requested_position_rad=self._requested_rad,
                host_stamp_ns=self._hal.host_now_ns(),
                robot_stamp_ns=self._last_send_ns,
                state_robot_stamp_ns=0 if state is None else state.robot_stamp_ns,
            )
        )

    def _log_tick(
        self,
        state: RobotState,
        host_ns: int,
        result: TickResult | None,
        inference_s: float,
        compute_s: float,
        lost: int,
    ) -> None:
        state_age_s = (host_ns - state.host_stamp_ns) / NS_PER_S
        self.stats.ticked(state.robot_stamp_ns, compute_s, state_age_s, lost if result is not None else 0)
        self._sink.tick(
            TickRecord(
                index=self._schedule.ticks,
                robot_stamp_ns=state.robot_stamp_ns,
                host_stamp_ns=host_ns,
                mode=self._mode.value,
                observation=_NO_ACTION if result is None else result.observation,
                action=_NO_ACTION if result is None else result.action,
                velocity_command=self._velocity_command,
                state_age_s=state_age_s,
                inference_s=inference_s,
                compute_s=compute_s,
                command_key=self._key,
                skipped=lost,
            )
        )

    def _newest_stamp_ns(self) -> int:
        newest = self._states.newest
        return self._mode_since_ns if newest is None else newest.robot_stamp_ns

    def _once(self, name: EventName, text: str, values: Mapping[str, float]) -> None:
        """An event whose repetitions would only flood the log; counters keep the score."""
        if name not in self._told:
            self._told.add(name)
            self._event(name, text, values)

    def _event(self, name: EventName, text: str, values: Mapping[str, float]) -> None:
        record = EventRecord(
            self._hal.host_now_ns(), self._hal.robot_now_ns(), name.severity, name.label, text, dict(values)
        )
        self._sink.event(record)
        self._on_event(record)


_NO_VELOCITY: Final = np.zeros(facts.N_JOINTS)
__all__ = ["ControlLoop", "LoopStatus", "Reaction"]
