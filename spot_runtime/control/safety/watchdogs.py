"""Everything that is watched while the loop runs, gathered into stops."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from spot_log.format.events import EventName
from spot_model.robot.state import RobotState
from spot_runtime.config import RunConfig
from spot_runtime.control.modes import Mode
from spot_runtime.control.recorder import Recorder
from spot_runtime.control.safety import safety
from spot_runtime.control.safety.command_loss import LossMemory, confirm
from spot_runtime.control.stops import Stop, StopReason
from spot_runtime.hal.base import Hal

NS_PER_S: Final = 1_000_000_000
LOG_CHECK_PERIOD_NS: Final = NS_PER_S // 2

_ANSWERS: Final = {
    Mode.READY: (StopReason.STATE_LOST, "before joint control"),
    Mode.ACTIVATING: (StopReason.ACTIVATION_FAILED, "no answer"),
    Mode.STANDING: (StopReason.HAND_BACK_FAILED, "no answer"),
}
"""Modes that must end within the activation time-out, and what it means when they do not."""


class Watchdogs:
    """Screens states and watches ages, echoes, lost ticks, the robot's slow state and the log."""

    def __init__(self, hal: Hal, config: RunConfig, recorder: Recorder) -> None:
        """Watch ``hal`` by the bounds of ``config``."""
        self._hal, self._config, self._recorder = hal, config, recorder
        self._limits = config.safety
        self._states = safety.StateMemory()
        self._losses = LossMemory()
        self._lost_at_ns: list[int] = []
        self._next_log_check_ns = 0

    @property
    def newest(self) -> RobotState | None:
        """The newest state that may be used."""
        return self._states.newest

    @property
    def missed_states(self) -> int:
        """States that never came, since the first."""
        return self._states.missed

    def screen(self, states: Sequence[RobotState], robot_ns: int) -> tuple[list[RobotState], list[Stop]]:
        """Judge the states that have arrived. Returns those that may be used, and the stops they cause."""
        usable, stops = [], []
        for state in states:
            self._states, is_usable, stop = safety.screen_state(self._states, state, robot_ns, self._limits)
            if is_usable:
                usable.append(state)
                self._losses = confirm(self._losses, state.last_command_key)
            if stop is not None:
                stops.append(stop)
        if self._states.rejected:
            self._recorder.once(EventName.STATE_REJECTED, "a duplicated or back-dated state arrived and was not used")
        if self._states.missed:
            self._recorder.once(EventName.STATES_MISSED, "a state did not arrive; from now on they are counted")
        if self._losses.share > self._limits.command_loss_share:
            values = {"share": self._losses.share, "bound": self._limits.command_loss_share}
            self._recorder.once(EventName.COMMANDS_LOST, f"about {self._losses.share:.0%} of commands are lost", values)
        return usable, stops

    def look(self, mode: Mode, robot_ns: int, *, mode_since_ns: int, control_since_ns: int) -> list[Stop]:
        """Look at everything that is not a state.

        Args:
            mode: The loop's mode.
            robot_ns: The robot's clock.
            mode_since_ns: When the mode began, robot clock.
            control_since_ns: When joint control began, robot clock; 0 before.
        """
        stops = [*self._hal.problems(), *self._waited_too_long(mode, robot_ns, mode_since_ns)]
        if mode is not Mode.READY:
            stops += self._ages(mode, robot_ns, control_since_ns)
        slow = self._hal.slow_state
        if slow is not None:
            stop = safety.check_slow_state(slow, self._hal.host_now_ns(), self._limits)
            stops += [] if stop is None else [stop]
        if robot_ns >= self._next_log_check_ns:
            self._next_log_check_ns = robot_ns + LOG_CHECK_PERIOD_NS
            self._look_at_clock()
            health = self._recorder.health()
            lost = [*health.unwritten.values(), *health.dropped.values()]
            is_recording = health.is_alive and not any(lost)
            if not is_recording and self._config.log.stop_on_failure:
                stops.append(Stop(StopReason.LOG_FAILED, health.problem))
        return stops

    def lost_ticks(self, lost: int, stamp_ns: int) -> Stop | None:
        """Take note of policy ticks that were lost just before the state with this stamp."""
        recent = [t for t in self._lost_at_ns if t > stamp_ns - NS_PER_S]
        bound = self._limits.skipped_ticks
        self._lost_at_ns = recent + [stamp_ns] * min(lost, bound)
        values = {"in_last_second": float(len(self._lost_at_ns)), "bound": float(bound)}
        self._recorder.once(EventName.TICKS_SKIPPED, f"{lost} policy ticks were lost", values)
        return Stop(StopReason.TICKS_SKIPPED, "", values) if len(self._lost_at_ns) >= bound else None

    def _ages(self, mode: Mode, robot_ns: int, control_since_ns: int) -> list[Stop]:
        newest = self._states.newest
        if newest is None:
            return []
        age_s = (robot_ns - newest.robot_stamp_ns) / NS_PER_S
        bound_s = self._limits.state_age_warn_s
        if age_s > bound_s:
            values = {"age_s": age_s, "bound_s": bound_s}
            self._recorder.once(EventName.STATE_OLD, f"the newest state is {age_s * 1e3:.1f} ms old", values)
        stop = safety.check_age(self._states, robot_ns, self._limits)
        if stop is None and mode.runs_policy:
            stop = safety.check_echo(self._states, control_since_ns, self._limits)
        return [] if stop is None else [stop]

    def _look_at_clock(self) -> None:
        late_s = self._hal.clock_age_s - self._config.robot.time_sync_period_s
        bound_s = self._limits.clock_unsynced_warn_s
        if late_s > bound_s:
            values = {"late_s": late_s, "bound_s": bound_s}
            text = f"no time sync has succeeded for {self._hal.clock_age_s:.1f} s; check the link"
            self._recorder.once(EventName.CLOCK_UNSYNCED, text, values)

    def _waited_too_long(self, mode: Mode, robot_ns: int, mode_since_ns: int) -> list[Stop]:
        answer = _ANSWERS.get(mode)
        waited_s = (robot_ns - mode_since_ns) / NS_PER_S
        bound_s = self._config.handover.activation_timeout_s
        if answer is None or waited_s <= bound_s:
            return []
        reason, detail = answer
        return [Stop(reason, detail, {"waited_s": waited_s, "bound_s": bound_s})]
