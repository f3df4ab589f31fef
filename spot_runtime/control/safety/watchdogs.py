"""Everything that is watched while the loop runs, gathered into stops: pure functions over a small memory.

A lost command shows as a key that the robot never echoed. Two commands that reach the robot within one state period
look as if the older one were lost, so one or two keys that are passed over say little; three in a row need losses.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from spot_log.format.events import EventName
from spot_log.write.sink import SinkHealth
from spot_model.robot.facts import NS_PER_S
from spot_model.robot.state import RobotState
from spot_runtime.config import RunConfig
from spot_runtime.control.modes import Mode
from spot_runtime.control.safety.battery import BatteryMemory, check_slow_state
from spot_runtime.control.safety.states import StateMemory, check_age, check_echo, screen_state
from spot_runtime.control.snapshot import Notes, Phase, Snapshot
from spot_runtime.safety_limits import SafetyLimits
from spot_runtime.stops import Stop, StopReason

WINDOW_KEYS: Final = 1500
"""Keys over which losses are counted: 4.5 s at a command a state."""

IN_A_ROW: Final = 3


_SHARES: Final = np.arange(0.0, 0.75, 1e-4)
_BURSTS: Final = _SHARES**3 * (1.0 - _SHARES)
"""Bursts a key at each share; they rise up to 0.75."""


class LossMemory(NamedTuple):
    """What counting remembers."""

    first_key: int = 0
    """Where the window began; 0 before any confirmation."""
    newest_key: int = 0
    bursts: int = 0
    """How often three or more keys in a row were passed over, in this window."""
    share: float = 0.0
    """Estimated share of commands that were lost, over the last window that is full."""


def confirm(memory: LossMemory, key: int) -> LossMemory:
    """Take the key that the newest state confirms; an older one is that of another run, and counting begins anew."""
    if memory.first_key == 0 or key < memory.newest_key:
        return LossMemory(first_key=key, newest_key=key)
    bursts = memory.bursts + (key - memory.newest_key > IN_A_ROW)
    if key - memory.first_key < WINDOW_KEYS:
        return LossMemory(memory.first_key, key, bursts, memory.share)
    return LossMemory(first_key=key, newest_key=key, share=loss_share(bursts, key - memory.first_key))


def loss_share(bursts: int, keys: int) -> float:
    """The share p at which so many losses of three or more in a row are expected: p³·(1 − p) = bursts / keys."""
    return float(np.interp(bursts / keys, _BURSTS, _SHARES))


LOG_CHECK_PERIOD_NS: Final = NS_PER_S // 2

_ANSWERS: Final = {
    Mode.READY: (StopReason.STATE_LOST, "before joint control"),
    Mode.ACTIVATING: (StopReason.ACTIVATION_FAILED, "no answer"),
    Mode.STANDING: (StopReason.HAND_BACK_FAILED, "no answer"),
}
"""Modes that must end within the activation time-out, and what it means when they do not."""


class WatchMemory(NamedTuple):
    """What watching remembers."""

    states: StateMemory = StateMemory()
    losses: LossMemory = LossMemory()
    lost_at_ns: tuple[int, ...] = ()
    """Stamps of the states before which a policy tick was lost, within the last second."""
    next_log_check_ns: int = 0
    battery: BatteryMemory = BatteryMemory()

    @property
    def newest(self) -> RobotState | None:
        """The newest state that may be used."""
        return self.states.newest


def screen(
    memory: WatchMemory, states: Sequence[RobotState], robot_ns: int, limits: SafetyLimits, notes: Notes
) -> tuple[WatchMemory, list[RobotState], tuple[Stop, ...]]:
    """Judge the states that have arrived. Returns those that may be used, and the stops they cause."""
    if not states:
        return memory, [], ()
    screened, losses = memory.states, memory.losses
    usable, stops = [], []
    for state in states:
        screened, is_usable, stop = screen_state(screened, state, robot_ns, limits)
        if is_usable:
            usable.append(state)
            losses = confirm(losses, state.last_command_key)
        if stop is not None:
            stops.append(stop)
    if screened.rejected:
        notes.once(EventName.STATE_REJECTED, "a duplicated or back-dated state arrived and was not used")
    if screened.missed:
        notes.once(EventName.STATES_MISSED, "a state did not arrive; from now on they are counted")
    if losses.share > limits.command_loss_share:
        values = {"share": losses.share, "bound": limits.command_loss_share}
        notes.once(EventName.COMMANDS_LOST, f"about {losses.share:.0%} of commands are lost", values)
    memory = WatchMemory(screened, losses, memory.lost_at_ns, memory.next_log_check_ns, memory.battery)
    return memory, usable, tuple(stops)


def look(
    memory: WatchMemory, now: Snapshot, phase: Phase, config: RunConfig, notes: Notes
) -> tuple[WatchMemory, tuple[Stop, ...]]:
    """Look at everything that is not a new state."""
    stops = (*now.problems, *_waited_too_long(memory, phase, now.robot_ns, config))
    if phase.mode is not Mode.READY:
        stops += _ages(memory, now, phase, config.safety, notes)
    if now.slow is not None:
        battery, stop = check_slow_state(memory.battery, now.slow, now.host_ns, config.safety)
        memory = memory._replace(battery=battery)
        stops += _some(stop)
    if now.log is not None:
        memory = memory._replace(next_log_check_ns=now.robot_ns + LOG_CHECK_PERIOD_NS)
        _look_at_clock(now.clock_age_s, config, notes)
        stops += _look_at_log(now.log, config, notes)
    return memory, stops


def lost_ticks(
    memory: WatchMemory, lost: int, stamp_ns: int, limits: SafetyLimits, notes: Notes
) -> tuple[WatchMemory, tuple[Stop, ...]]:
    """Take note of policy ticks that were lost just before the state with this stamp."""
    recent, bound = tuple(t for t in memory.lost_at_ns if t > stamp_ns - NS_PER_S), limits.skipped_ticks
    recent += (stamp_ns,) * min(lost, bound)
    values = {"in_last_second": float(len(recent)), "bound": float(bound)}
    notes.once(EventName.TICKS_SKIPPED, f"{lost} policy ticks were lost", values)
    stops = (Stop(StopReason.TICKS_SKIPPED, "", values),) if len(recent) >= bound else ()
    return memory._replace(lost_at_ns=recent), stops


def _ages(memory: WatchMemory, now: Snapshot, phase: Phase, limits: SafetyLimits, notes: Notes) -> tuple[Stop, ...]:
    newest, robot_ns = memory.newest, now.robot_ns
    if newest is None:
        return ()
    age_s, bound_s = (robot_ns - newest.robot_stamp_ns) / NS_PER_S, limits.state_age_warn_s
    if age_s > bound_s:
        values = {"age_s": age_s, "bound_s": bound_s}
        notes.once(EventName.STATE_OLD, f"the newest state is {age_s * 1e3:.1f} ms old", values)
    stop = check_age(memory.states, robot_ns, limits)
    if stop is None and phase.mode.runs_policy:
        stop = check_echo(memory.states, phase.control_since_ns, limits)
    return _some(stop)


def _look_at_clock(clock_age_s: float, config: RunConfig, notes: Notes) -> None:
    late_s, bound_s = clock_age_s - config.robot.time_sync_period_s, config.safety.clock_unsynced_warn_s
    if late_s > bound_s:
        values = {"late_s": late_s, "bound_s": bound_s}
        text = f"no time sync has succeeded for {clock_age_s:.1f} s; check the link"
        notes.once(EventName.CLOCK_UNSYNCED, text, values)


def _look_at_log(health: SinkHealth, config: RunConfig, notes: Notes) -> tuple[Stop, ...]:
    if health.problem:
        notes.once(EventName.LOG_PROBLEM, health.problem)
    is_recording = health.is_alive and not any([*health.unwritten.values(), *health.dropped.values()])
    if is_recording or not config.log.stop_on_failure:
        return ()
    return (Stop(StopReason.LOG_FAILED, health.problem),)


def _waited_too_long(memory: WatchMemory, phase: Phase, robot_ns: int, config: RunConfig) -> tuple[Stop, ...]:
    answer, bound_s = _ANSWERS.get(phase.mode), config.handover.activation_timeout_s
    waited_s = (robot_ns - phase.since_ns) / NS_PER_S
    has_answered = phase.mode is Mode.ACTIVATING and phase.held_since_ns > 0
    if answer is None or has_answered or waited_s <= bound_s:
        return ()
    reason, detail = answer
    if phase.mode is Mode.READY and memory.newest is not None:
        stale = check_age(memory.states, robot_ns, config.safety)
        if stale is not None:
            return (Stop(stale.reason, detail, stale.values),)
        reason, detail = StopReason.ACTIVATION_FAILED, "it did not come to rest"
    return (Stop(reason, detail, {"waited_s": waited_s, "bound_s": bound_s}),)


def _some(stop: Stop | None) -> tuple[Stop, ...]:
    return () if stop is None else (stop,)
