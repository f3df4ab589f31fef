"""All checks of the robot's signals, window by window, as one pure function.

They run after the command of a tick has left: what they find is a stop a state later, and costs the command nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import compress
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot_model.robot import facts
from spot_model.robot.facts import NS_PER_S
from spot_model.robot.state import JointCommand, RobotState
from spot_runtime.control.safety.signals import answer, bounds, ground, legs, motion, still, wiring
from spot_runtime.control.safety.signals.answer import AnswerMemory, HoldMemory
from spot_runtime.control.safety.signals.ground import GroundMemory, WeightMemory
from spot_runtime.control.safety.signals.legs import ground_forces_n
from spot_runtime.control.safety.signals.motion import ImuMemory, MotionMemory
from spot_runtime.control.safety.signals.readers import Doubt, Signal
from spot_runtime.control.safety.signals.window import Window, length, window_of
from spot_runtime.control.safety.signals.wiring import WiringMemory
from spot_runtime.stops import Stop, StopReason

POSITION, VELOCITY, ATTITUDE, BODY_VELOCITY, TURN_RATE, LOAD, CONTACTS, INERTIAL_UNIT = Signal
_NO_COUNTS: Final = np.zeros(facts.N_JOINTS, dtype=np.int64)


class SignalMemory(NamedTuple):
    """What the checks remember."""

    states: tuple[RobotState, ...] = ()
    """States of the window that is not full yet."""
    commands: tuple[JointCommand, ...] = ()
    """The newest that changed what is asked, oldest first."""
    motion: MotionMemory = MotionMemory()
    ground: GroundMemory = GroundMemory()
    imu: ImuMemory = ImuMemory()
    weight: WeightMemory = WeightMemory()
    wiring: WiringMemory = WiringMemory()
    answer: AnswerMemory = AnswerMemory()
    hold: HoldMemory = HoldMemory()
    still: still.Counts = still.NO_COUNTS
    load_windows: NDArray[np.int64] = _NO_COUNTS
    """In a row in which each joint's load disagreed. Shape (12,)."""
    repeated_loads: NDArray[np.int64] = _NO_COUNTS
    """Windows in a row after which each joint's load was what it had been before. Shape (12,)."""
    has_loads: bool = False
    """Whether any load ever was other than zero; where none ever is, loads are not reported at all."""
    restless_windows: int = 0
    """In which a robot that should stand did not, less those since in which it did; 0 once it is at rest."""
    wrong_stances: int = 0
    """Windows in a row in which a robot could not stand as its joints and loads say."""
    explanations: tuple[str, ...] = ()
    """Single errors that would explain the last of them."""


class Situation(NamedTuple):
    """Who has the joints."""

    is_standing: bool = False
    """The vendor's stand, so the robot must be at rest."""
    is_held: bool = False
    """Joint control, which holds the pose of the stand ever more stiffly."""
    is_driven: bool = False
    """Joint control; the joints do what the commands ask."""


def asked(memory: SignalMemory, command: JointCommand) -> SignalMemory:
    """Take note of a command that changes what is asked of the joints."""
    return memory._replace(commands=(*memory.commands, command)[-2 * bounds.SETPOINTS :])


def check_signals(
    memory: SignalMemory, states: Sequence[RobotState], situation: Situation
) -> tuple[SignalMemory, tuple[Doubt, ...]]:
    """Judge the states that have arrived and may be used, oldest first.

    Returns:
        The new memory, and a doubt for each kind of thing that cannot be true.
    """
    doubts: tuple[Doubt, ...] = ()
    for state in states:
        window_states = (*memory.states, state)
        if (state.robot_stamp_ns - window_states[0].robot_stamp_ns) / NS_PER_S < bounds.WINDOW_S:
            memory = memory._replace(states=window_states)
            continue
        window = window_of(window_states)
        memory = memory._replace(states=(state,))
        if window is not None:
            memory = _after_window(memory, window, window_states, situation)
            doubts = (*doubts, *_doubts(memory))
    return memory, doubts


def _after_window(
    memory: SignalMemory, window: Window, states: Sequence[RobotState], situation: Situation
) -> SignalMemory:
    first, last = window.first, window.last
    has_loads = memory.has_loads or bool(last.load_nm.any())
    repeated = np.where(last.load_nm == first.load_nm, memory.repeated_loads + 1, 0)
    # A load that repeats itself says nothing about its joint; that of a resting joint may do so once by chance.
    lives = (repeated < bounds.REPEATED_LOADS) & has_loads
    is_measured = lives & ~answer.at_stop(last.position_rad)
    carried_n = None
    if lives.all():
        carried_n = ground_forces_n(last.position_rad, last.load_nm) @ window.odom_from_body[2]
    load_windows, answered, held, carrying = (
        _NO_COUNTS,
        AnswerMemory(),
        HoldMemory(),
        WeightMemory(),
    )
    received = sum(command.key <= last.last_command_key for command in memory.commands)
    if situation.is_driven and memory.commands:
        # A load may answer the newest command that the robot says it has, those before, and later ones.
        commands = memory.commands[max(0, received - bounds.SETPOINTS) :]
        load_windows = np.where(answer.disagreeing(window, commands) & is_measured, memory.load_windows + 1, 0)
    if received and has_loads:
        newest = memory.commands[received - 1]
        if situation.is_driven:
            answered = answer.after_window(memory.answer, window, newest, is_measured)
        elif situation.is_held:
            held = answer.after_hold_window(memory.hold, states, newest, is_measured)
    if situation.is_driven and carried_n is not None:
        carrying = ground.after_weight_window(memory.weight, window, carried_n)
    is_stance_wrong = situation.is_standing and legs.is_stance_wrong(window)
    resting = motion.resting(window) & situation.is_driven
    return SignalMemory(
        memory.states,
        memory.commands,
        motion.after_window(memory.motion, window),
        ground.after_window(memory.ground, window, carried_n),
        motion.after_imu_window(memory.imu, window),
        carrying,
        wiring.after_window(memory.wiring, window, carried_n) if any(situation) else WiringMemory(),
        answered,
        held,
        still.still_windows(memory.still, first, last, resting, has_loads=has_loads),
        load_windows,
        repeated,
        has_loads,
        max(0, memory.restless_windows + (1 if _is_restless(window) else -1)) if situation.is_standing else 0,
        memory.wrong_stances + 1 if is_stance_wrong else 0,
        wiring.explanations(window) if is_stance_wrong else (),
    )


def _is_restless(window: Window) -> bool:
    state = window.last
    return bool(
        length(state.linear_vel_of_body_in_odom_m_s) > bounds.REST_SPEED_M_S
        or length(window.turn_rad) > bounds.REST_TURN_RATE_RAD_S * window.duration_s
        or np.abs(window.travel_rad).max() > bounds.REST_JOINT_SPEED_RAD_S * window.duration_s
    )


def _doubts(memory: SignalMemory) -> Iterator[Doubt]:
    yield from _frozen(memory.still >= still.WINDOWS)
    slope = memory.motion.slope_windows >= bounds.SLOPE_WINDOWS
    if slope.any():
        yield _contradiction({POSITION, VELOCITY}, f"velocity and position of {_names(slope, facts.JOINT_NAMES)}")
    if memory.motion.turn_windows >= bounds.TURN_WINDOWS:
        yield _contradiction({ATTITUDE, TURN_RATE}, "attitude and turn rate of the body")
    yield from _about_inertial_unit(memory.imu)
    yield from _about_ground(memory.ground)
    yield from _about_loads(memory)
    if memory.wiring.windows >= bounds.MISREAD_WINDOWS:
        suspects = {POSITION, VELOCITY, BODY_VELOCITY, TURN_RATE}
        yield _contradiction(suspects, f"the body's motion and feet that stand, unless {memory.wiring.explained}")
    if memory.restless_windows >= bounds.RESTLESS_WINDOWS:
        suspects = {POSITION, VELOCITY, BODY_VELOCITY, TURN_RATE}
        yield _contradiction(suspects, "a robot that stands, and its velocities")


def _frozen(is_still: NDArray[np.bool_]) -> Iterator[Doubt]:
    frozen = list(compress(zip(still.SUSPECTS, still.NAMES, strict=True), is_still))
    for suspects in dict.fromkeys(suspects for suspects, _ in frozen):
        names = ", ".join(name for of, name in frozen if of == suspects)
        yield Doubt(suspects, Stop(StopReason.SIGNAL_FROZEN, names))


def _about_inertial_unit(memory: ImuMemory) -> Iterator[Doubt]:
    if memory.tilt_error_rad > bounds.GRAVITY_ANGLE_RAD:
        values = {"angle_rad": memory.tilt_error_rad, "bound_rad": bounds.GRAVITY_ANGLE_RAD}
        yield _contradiction({ATTITUDE, INERTIAL_UNIT}, "attitude and gravity", values)
    if memory.angle_windows >= bounds.IMU_WINDOWS:
        yield _contradiction({ATTITUDE, INERTIAL_UNIT}, "attitude of the body and of its inertial unit")
    if memory.turn_rate_windows >= bounds.IMU_WINDOWS:
        yield _contradiction({TURN_RATE, INERTIAL_UNIT}, "turn rate of the body and of its inertial unit")
    if memory.stamp_windows >= bounds.IMU_WINDOWS:
        values = {"apart_s": memory.stamp_error_s, "bound_s": bounds.IMU_STAMP_S}
        yield _contradiction({INERTIAL_UNIT}, "stamps of the inertial unit and of the joints", values)
    if memory.unknown_windows >= bounds.IMU_WINDOWS:
        yield _contradiction({INERTIAL_UNIT}, "the inertial unit reports what is no number")
    if memory.silent_windows >= bounds.IMU_SILENT_WINDOWS:
        yield _contradiction({INERTIAL_UNIT}, "the inertial unit no longer reports")


def _about_ground(memory: GroundMemory) -> Iterator[Doubt]:
    if memory.sliding_share > bounds.FOOT_SHARE:
        values = {"foot_speed_m_s": memory.speed_m_s, "share": memory.sliding_share}
        suspects = {POSITION, VELOCITY, BODY_VELOCITY, TURN_RATE, CONTACTS}
        yield _contradiction(suspects, "the body's velocity and feet that stand", values)
    if memory.unloaded_share > bounds.FOOT_SHARE:
        yield _contradiction({CONTACTS, LOAD}, "feet in contact and their loads", {"share": memory.unloaded_share})
    if memory.travel_m > bounds.TRAVEL_M:
        # While the body truly travels, some foot stands, whatever the contacts say.
        feet_agree = memory.slid_m <= bounds.FOOT_SPEED_SHARE * memory.travel_m
        values = {"travel_m": memory.travel_m, "bound_m": bounds.TRAVEL_M}
        suspects = {CONTACTS} if feet_agree else {CONTACTS, BODY_VELOCITY}
        yield _contradiction(suspects, "contacts do not change while the body travels", values)
    if memory.has_touched and memory.airborne_s > bounds.AIRBORNE_S:
        values = {"airborne_s": memory.airborne_s, "bound_s": bounds.AIRBORNE_S}
        yield _contradiction({CONTACTS}, "no foot touches the ground", values)


def _about_loads(memory: SignalMemory) -> Iterator[Doubt]:
    """A load that does not fit may be right, and the position wrong at which its joint is thought to be."""
    suspects = {LOAD, POSITION}
    loads = memory.load_windows >= bounds.LOAD_WINDOWS
    if loads.any():
        yield _contradiction(suspects, f"load and set-point of {_names(loads, facts.JOINT_NAMES)}")
    anothers = memory.answer.anothers_windows >= bounds.LOAD_WINDOWS
    if anothers.any():
        names = _names(anothers, facts.LEG_NAMES)
        yield _contradiction(suspects, f"set-points of {names} and loads, which answer another leg's")
    wrong = memory.answer.wrong_windows >= bounds.LOAD_WINDOWS
    if wrong.any():
        names = _names(wrong, facts.JOINT_NAMES)
        yield _contradiction(suspects, f"position of {names} and load, which does not answer what is asked")
    if memory.weight.is_wrong:
        values = {f"{leg}_share": float(memory.weight.legs_share[i]) for i, leg in enumerate(facts.LEG_NAMES)}
        yield _contradiction(suspects, "the robot's weight and the loads of its legs", values)
    if memory.hold.is_wrong.any():
        yield Doubt(frozenset(suspects), Stop(StopReason.POSITION_REFUSED, answer.hold_words(memory.hold)))
    if memory.wrong_stances >= bounds.REST_WINDOWS:
        explained = f", unless {' or '.join(memory.explanations)}" if memory.explanations else ""
        yield _contradiction(suspects, f"joints, loads and weight of a robot that stands{explained}")


def _contradiction(suspects: set[Signal], what: str, values: dict[str, float] | None = None) -> Doubt:
    return Doubt(frozenset(suspects), Stop(StopReason.SIGNALS_CONTRADICT, what, values or {}))


def _names(mask: NDArray[np.bool_], names: Sequence[str]) -> str:
    return ", ".join(compress(names, mask))
