"""One step of control as a pure function: memory and a snapshot go in; memory, a command and records come out.

A step judges what has arrived, moves the mode machine, runs the policy where a tick is due, and makes a command.
Set-points change at ticks only; between them the same ones go out again with a new end time, so that a command lapses
soon after this process stops.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from spot_log.format.events import EventName
from spot_model.policy.policy import TickResult
from spot_model.robot import facts
from spot_model.robot.facts import NS_PER_S, Array
from spot_model.robot.state import JointCommand, RobotState
from spot_runtime.control.memory import Act, Drive, Memory, Plan, Step, Tick
from spot_runtime.control.modes import Mode, ModeInputs, next_mode
from spot_runtime.control.safety import watchdogs
from spot_runtime.control.safety.commands import check_command, limit_setpoint
from spot_runtime.control.safety.signals.check import Situation, asked, check_signals
from spot_runtime.control.safety.signals.readers import relied_on
from spot_runtime.control.set_point import (
    LoadAverage,
    Setpoint,
    asked_setpoint,
    hold_setpoint,
    taking_hold,
    within_stops,
)
from spot_runtime.control.snapshot import Notes, Phase, Snapshot
from spot_runtime.hal.base import JointControl
from spot_runtime.hal.errors import HalError
from spot_runtime.host.pauses import SHARE, Pause
from spot_runtime.safety_limits import SafetyLimits
from spot_runtime.stops import Reaction, Stop, StopReason, ending_after, unforeseen

LATE: Final = (StopReason.STATE_STALE, StopReason.STATE_LOST, StopReason.TICKS_SKIPPED)
"""What a process that did not run sees of a robot and a link that are well."""


def with_own_doing(stop: Stop, pause: Pause) -> Stop:
    """The stop, in words that tell of this process's own pause; where that explains all, a stop of its own.

    After a pause states come again, so it ends in damping, which needs a link, also where silence had been due.
    """
    age_s = stop.values.get("age_s", 0.0)
    # What has piled up in a pause is caught up with in no more time than that.
    is_just_over = pause.duration_s >= SHARE * age_s and pause.ago_s <= max(age_s, pause.duration_s)
    if stop.reason in LATE and pause.is_standstill and is_just_over:
        return Stop(StopReason.PROCESS_PAUSED, f"for {pause.duration_s:.3g} s", stop.values)
    if stop.reason not in LATE and pause.is_standstill:  # no command reached the robot meanwhile
        words = f"{pause.ago_s:.1f} s before, this process did not run for {pause.duration_s:.3g} s"
        return replace(stop, detail=f"{stop.detail}; {words}" if stop.detail else words)
    if stop.reason is StopReason.STATE_STALE:
        return replace(stop, detail=why_old(age_s, pause if is_just_over else pause._replace(duration_s=0.0)))
    return stop


def why_old(age_s: float, pause: Pause) -> str:
    """Whether this computer or what lies before it is why a state is so old; empty where that is not known."""
    waited_s = pause.cpu_wait_s
    if waited_s is not None and waited_s >= SHARE * max(age_s, pause.duration_s):
        return (
            f"this computer is too busy; a thread of this program had to wait {waited_s * 1e3:.1f} ms for a processor"
        )
    if pause.duration_s >= SHARE * age_s:
        busy = "though it had a processor: it, or what this computer runs on, was busy"
        return f"this program did not look for {pause.duration_s * 1e3:.1f} ms, {busy}"
    if waited_s is None:
        return ""
    return (
        "the robot or the link was late; this program looked in time, and none of its threads waited more than "
        f"{waited_s * 1e3:.1f} ms for a processor"
    )


_EVERY_MODE: Final = tuple(Mode)
_NO_VELOCITY: Final = np.zeros(facts.N_JOINTS)
_NO_VELOCITY.flags.writeable = False


def control_step(memory: Memory, now: Snapshot, plan: Plan) -> Step:
    """Judge, decide, and make a command.

    Raises:
        Exception: Whatever the policy or the source raises; :func:`after_failure` is the step to take then.
    """
    phase, handover, schedule, loads, ending, watch, drive, told, key, sent_ns, signals, _ = memory
    notes, limits = Notes(told, now.host_ns, now.robot_ns), plan.limits
    watch, usable, stops = watchdogs.screen(watch, now.states, now.robot_ns, limits, notes)
    found = _found(memory, plan, notes)
    watch, later_stops = watchdogs.look(watch, now, phase, plan.config, notes)
    newest = usable[-1] if usable else None
    is_tick, lost = False, 0
    if newest is not None:
        schedule, is_tick, lost = schedule.advance(newest.robot_stamp_ns)
        # Also where no policy ticks: a set-point held through a gap may be far from where the joints are by now.
        if lost and phase.mode.sends:
            watch, too_many = watchdogs.lost_ticks(watch, lost, newest.robot_stamp_ns, limits, notes)
            later_stops += too_many
    if phase.mode is Mode.READY:  # what the joints carry while the body moves is not what carries it
        loads = LoadAverage.over(handover.settle_s) if signals.restless_windows else loads.after(usable)
    # Whole tuples are made by position: on the hot path that takes a third of what replacing fields takes.
    memory = Memory(phase, handover, schedule, loads, ending, watch, drive, told, key, sent_ns, signals)
    all_stops = (*found, *stops, *later_stops)
    if all_stops and now.pause is not None:
        all_stops = tuple(with_own_doing(stop, now.pause) for stop in all_stops)
    memory, acts = _end_and_move(memory, all_stops, now, limits, notes)
    result, inference_s = None, 0.0
    if is_tick and newest is not None and memory.phase.mode.runs_policy:
        memory, result, inference_s = _run_policy(memory, newest, now, plan, notes)
    if (is_tick or memory.phase.mode is Mode.DAMPING) and memory.phase.mode.sends:
        memory, more = _aim(memory, result, now, plan, notes)
        acts += more
    command = None
    if _is_command_due(memory, now, plan, is_tick=is_tick, has_state=newest is not None, acts=acts):
        command = _command(memory, now, plan)
        key, sent_ns = command.key, now.robot_ns
    tick = None
    if is_tick and newest is not None and memory.phase.mode is not Mode.READY:
        tick = Tick(schedule.ticks, newest, lost, result, inference_s)
    phase, handover, ending, drive = memory.phase, memory.handover, memory.ending, memory.drive
    after = Memory(phase, handover, schedule, loads, ending, watch, drive, notes.told, key, sent_ns, signals)
    return Step(after, acts, tuple(notes.events), command, tuple(usable), tick)


def check_step(step: Step) -> Memory:
    """Judge the signals of the states that a step used, once its command has left. What is found counts as of the next.

    Returns:
        The step's memory with what was found.
    """
    memory = step.memory
    signals, mode, is_confirmed = memory.signals, memory.phase.mode, memory.phase.held_since_ns > 0
    if step.command is not None and (step.tick is not None or Act.BEGIN in step.acts):
        signals = asked(signals, step.command)
    situation = Situation(mode is Mode.READY, mode is Mode.ACTIVATING and is_confirmed, mode.runs_policy)
    signals, found = check_signals(signals, step.usable, situation)
    return memory._replace(signals=signals, found=found)


def stopped(memory: Memory, stop: Stop, now: Snapshot) -> Step:
    """The step that ends the run for this reason, unless a reaction as strong is already under way."""
    notes = Notes(memory.told, now.host_ns, now.robot_ns)
    memory, acts = _end(memory, stop, notes)
    return Step(memory, acts, tuple(notes.events))


def after_failure(memory: Memory, error: Exception, now: Snapshot) -> Step:
    """The step in place of one that failed: a defect ends in damping; one while damping, in silence."""
    stop = Stop(StopReason.LINK_LOST, str(error)) if isinstance(error, HalError) else unforeseen(error)
    notes = Notes(memory.told, now.host_ns, now.robot_ns)
    is_last_resort = memory.phase.mode in (Mode.READY, Mode.DAMPING, Mode.RELEASED)
    memory, acts = _end(memory, stop, notes)
    memory, more = _enter(memory, Mode.RELEASED if is_last_resort else Mode.DAMPING, now, notes)
    return Step(memory, acts + more, tuple(notes.events))


def _found(memory: Memory, plan: Plan, notes: Notes) -> tuple[Stop, ...]:
    """What stands against this policy, and what the checks of the signals found after the last step.

    A doubt about signals on which nothing relies is only told.
    """
    stops: tuple[Stop, ...] = () if plan.refusal is None else (plan.refusal,)
    if not memory.found:
        return stops
    relied = relied_on(plan.observation_fields, memory.phase.mode)
    for doubt in memory.found:
        if doubt.suspects & relied and plan.limits.signals == "stop":
            stops += (doubt.stop,)
        else:
            why = "the configuration only warns" if doubt.suspects & relied else "nothing in control relies on it"
            about = ", ".join(sorted(signal.value for signal in doubt.suspects))
            notes.once(EventName.SIGNAL_DOUBTED, f"{doubt.stop.sentence()}; {why}", doubt.stop.values, about=about)
    return stops


# Modes ---------------------------------------------------------------------------------------------------------------


def _end_and_move(
    memory: Memory, stops: tuple[Stop, ...], now: Snapshot, limits: SafetyLimits, notes: Notes
) -> tuple[Memory, tuple[Act, ...]]:
    """Take every stop, then move the mode machine as far as it goes now."""
    acts: tuple[Act, ...] = ()
    newest = memory.watch.newest
    phase = memory.phase
    if phase.mode is Mode.ACTIVATING and not phase.held_since_ns and now.joint_control is JointControl.ACTIVE:
        memory = memory._replace(phase=phase._replace(held_since_ns=now.robot_ns))
    # A link on which no state is fresh enough would end the run as soon as it has begun.
    is_fresh = newest is not None and now.robot_ns - newest.robot_stamp_ns < limits.state_age_damp_s * NS_PER_S
    for stop in stops:
        memory, more = _end(memory, stop, notes)
        acts += more
    for _ in _EVERY_MODE:
        phase = memory.phase
        inputs = ModeInputs(
            in_mode_s=(now.robot_ns - phase.since_ns) / NS_PER_S,
            reaction=None if memory.ending is None else memory.ending.reaction,
            is_activation_asked=memory.loads.is_full and is_fresh and not memory.watch.battery.is_unknown,
            held_s=(now.robot_ns - phase.held_since_ns) / NS_PER_S if phase.held_since_ns else 0.0,
        )
        following = next_mode(phase.mode, inputs, memory.handover)
        if following is phase.mode:
            break
        memory, more = _enter(memory, following, now, notes)
        acts += more
    return memory, acts


def _end(memory: Memory, stop: Stop, notes: Notes) -> tuple[Memory, tuple[Act, ...]]:
    ending = ending_after(memory.ending, stop)
    if ending is memory.ending:
        return memory, ()
    notes.event(stop.event_name, f"{stop.reason.label}: {stop.sentence()}", stop.values)
    # A hand-back that has begun keeps its pace: a ramp must not jump.
    is_hastened = memory.ending is None and stop.reason.is_urgent
    handover = memory.handover.hastened() if is_hastened else memory.handover
    is_pressed = memory.ending is not None and memory.ending.reaction is Reaction.ESTOP
    acts = (Act.ESTOP,) if ending.reaction is Reaction.ESTOP and not is_pressed else ()
    return memory._replace(ending=ending, handover=handover), acts


def _enter(memory: Memory, mode: Mode, now: Snapshot, notes: Notes) -> tuple[Memory, tuple[Act, ...]]:
    phase, drive, before = memory.phase, memory.drive, memory.phase.mode
    notes.event(EventName.MODE, f"{before.value} → {mode.value}")
    phase = phase._replace(mode=mode, since_ns=now.robot_ns)
    acts: tuple[Act, ...] = ()
    if mode is Mode.ACTIVATING:
        drive, acts = _held(memory), (Act.BEGIN,)
    elif mode is Mode.RAMPING_IN:
        phase = phase._replace(control_since_ns=now.robot_ns)
    elif mode is Mode.ACTIVE:
        phase = phase._replace(active_since_ns=now.robot_ns)
    elif mode is Mode.SOFT_STOP:
        drive = drive._replace(fade_from=drive.command)
    elif mode is Mode.STANDING:
        # A pose that is not held firmly yet may be another than the robot's, so it does not become firmer.
        hold = drive.current if before is Mode.ACTIVATING else drive.hold
        drive, acts = drive._replace(hold=hold, current=hold, command=np.zeros_like(drive.command)), (Act.END,)
    elif mode is Mode.RELEASED:
        acts = (Act.RELEASE,)
    return memory._replace(phase=phase, drive=drive), acts


def _held(memory: Memory) -> Drive:
    """Hold the pose and the load that are measured now."""
    newest = memory.watch.newest
    if newest is None:
        raise RuntimeError("joint control cannot begin without a state")
    hold = hold_setpoint(within_stops(newest.position_rad), memory.loads.mean_nm())
    limits = memory.drive.limits._replace(sent_rad=hold.position_rad)
    current = taking_hold(hold, 0.0)
    return memory.drive._replace(hold=hold, current=current, requested_rad=hold.position_rad, limits=limits)


# Set-points ----------------------------------------------------------------------------------------------------------


def _run_policy(
    memory: Memory, state: RobotState, now: Snapshot, plan: Plan, notes: Notes
) -> tuple[Memory, TickResult, float]:
    command, is_finished = _asked_of_policy(memory, state, now, plan, notes)
    if is_finished:
        memory, _ = _end(memory, Stop(StopReason.COMPLETED), notes)
    begin_s = plan.wall_s()
    after, result = plan.policy.tick(memory.drive.policy, state, command)
    inference_s = plan.wall_s() - begin_s
    drive = memory.drive
    drive = Drive(drive.hold, drive.current, drive.requested_rad, drive.limits, after, command, drive.fade_from)
    return memory._replace(drive=drive), result, inference_s


def _asked_of_policy(memory: Memory, state: RobotState, now: Snapshot, plan: Plan, notes: Notes) -> tuple[Array, bool]:
    """The command of this tick, and whether the source has nothing more to say."""
    phase, drive = memory.phase, memory.drive
    if phase.mode is Mode.SOFT_STOP:
        in_mode_s, fade_s = max(0.0, (state.robot_stamp_ns - phase.since_ns) / NS_PER_S), memory.handover.soft_stop_s
        share = max(0.0, 1.0 - in_mode_s / fade_s) if fade_s > 0.0 else 0.0
        return drive.fade_from * share, False
    if phase.mode is not Mode.ACTIVE:
        return plan.rest, False
    wanted = plan.wanted_at(max(0.0, (state.robot_stamp_ns - phase.active_since_ns) / NS_PER_S), now.host_ns)
    policy, command = plan.policy, wanted.command.tolist()
    low, high = policy.command_low, policy.command_high
    if not any(value < least or value > most for value, least, most in zip(command, low, high, strict=True)):
        return wanted.command, wanted.is_finished
    notes.once(EventName.COMMAND_CLIPPED, "the command was cut to the policy's range")
    return np.clip(command, low, high), wanted.is_finished


def _aim(
    memory: Memory, result: TickResult | None, now: Snapshot, plan: Plan, notes: Notes
) -> tuple[Memory, tuple[Act, ...]]:
    """Bring the set-point up to date, within all limits; a limit that ends the run turns it into damping."""
    memory, stop = _limited(memory, result, now, plan, notes)
    if stop is None:
        return memory, ()
    memory, acts = _end_and_move(memory, (stop,), now, plan.limits, notes)
    return _limited(memory, result, now, plan, notes)[0], acts


def _limited(
    memory: Memory, result: TickResult | None, now: Snapshot, plan: Plan, notes: Notes
) -> tuple[Memory, Stop | None]:
    phase, drive, limits = memory.phase, memory.drive, plan.limits
    hold, newest = drive.hold, memory.watch.newest
    if hold is None:
        raise RuntimeError("there is no held pose; joint control has not begun")
    asked = asked_setpoint(
        phase.mode,
        (now.robot_ns - _began_ns(phase, now)) / NS_PER_S,
        hold=hold,
        policy_rad=None if result is None else result.setpoint_rad,
        policy_gains=plan.policy_gains,
        measured_rad=hold.position_rad if newest is None else newest.position_rad,
        config=memory.handover,
    )
    if phase.mode is Mode.DAMPING:
        return memory._replace(drive=drive._replace(current=asked, requested_rad=asked.position_rad)), None
    after, limited, stop = limit_setpoint(drive.limits, asked.position_rad, asked.gains.kp_nm_per_rad, limits)
    if limited.is_cut:
        names = [name for name, is_cut in zip(facts.JOINT_NAMES, limited.cut, strict=True) if is_cut]
        notes.once(EventName.SETPOINT_CUT, f"requested set-points were cut: {', '.join(names)}")
    current = Setpoint(limited.position_rad, asked.load_nm, asked.gains)
    drive = Drive(hold, current, asked.position_rad, after, drive.policy, drive.command, drive.fade_from)
    return memory._replace(drive=drive), stop


def _began_ns(phase: Phase, now: Snapshot) -> int:
    """When the set-point of a mode began to change: taking hold waits until the robot has confirmed joint control."""
    return (phase.held_since_ns or now.robot_ns) if phase.mode is Mode.ACTIVATING else phase.since_ns


# Commands ------------------------------------------------------------------------------------------------------------


def _is_command_due(
    memory: Memory, now: Snapshot, plan: Plan, *, is_tick: bool, has_state: bool, acts: tuple[Act, ...]
) -> bool:
    mode = memory.phase.mode
    if not mode.sends:
        return False
    if mode is Mode.DAMPING:  # needs no state, so it is sent by the clock
        return has_state or now.robot_ns - memory.sent_ns >= facts.STATE_PERIOD_NS
    return Act.BEGIN in acts or (has_state and (is_tick or plan.config.control.resend_on_state))


def _command(memory: Memory, now: Snapshot, plan: Plan) -> JointCommand:
    current, robot_ns, limits = memory.drive.current, now.robot_ns, plan.limits
    if current is None:
        raise RuntimeError("there is no set-point to send")
    command = JointCommand(
        key=memory.key + 1,
        position_rad=current.position_rad,
        velocity_rad_s=_NO_VELOCITY,
        load_nm=_within_torque(current.load_nm, limits.feedforward_nm),
        gains=current.gains,
        end_robot_stamp_ns=robot_ns + round(plan.config.control.end_time_ahead_s * NS_PER_S),
    )
    wrong = check_command(command, memory.key, robot_ns)
    if wrong is not None:
        raise RuntimeError(f"a command was held back: {wrong}")
    return command


def _within_torque(load_nm: Array, bound_nm: float) -> Array:
    loads_nm = load_nm.tolist()
    if -bound_nm <= min(loads_nm) and max(loads_nm) <= bound_nm:
        return load_nm
    return np.minimum(np.maximum(load_nm, -bound_nm), bound_nm)
