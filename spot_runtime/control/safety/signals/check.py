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
from spot_model.robot.stamps import NS_PER_S
from spot_model.robot.state import JointCommand, RobotState
from spot_runtime.control.safety.signals import answer, bounds, ground, imu, load, motion, still, weight
from spot_runtime.control.safety.signals.window import Window, length, window_of
from spot_runtime.stops import Stop, StopReason

_NO_COUNTS: Final = np.zeros(facts.N_JOINTS, dtype=np.int64)


class SignalMemory(NamedTuple):
    """What the checks remember."""

    states: tuple[RobotState, ...] = ()
    """Of the window that is not full yet."""
    commands: tuple[JointCommand, ...] = ()
    """The newest that changed what is asked, oldest first."""
    motion: motion.MotionMemory = motion.MotionMemory()
    ground: ground.GroundMemory = ground.GroundMemory()
    imu: imu.ImuMemory = imu.ImuMemory()
    weight: weight.WeightMemory = weight.WeightMemory()
    answer: answer.AnswerMemory = answer.AnswerMemory()
    still: still.Counts = still.NO_COUNTS
    load_windows: NDArray[np.int64] = _NO_COUNTS
    """In a row in which each joint's load disagreed. Shape (12,)."""
    restless_windows: int = 0
    """In a row in which a robot that should stand did not."""
    burdened_windows: int = 0
    """In a row in which the loads of a robot that stands did not carry its weight."""


def asked(memory: SignalMemory, command: JointCommand) -> SignalMemory:
    """Take note of a command that changes what is asked of the joints."""
    return memory._replace(commands=(*memory.commands, command)[-2 * bounds.SETPOINTS :])


def check_signals(
    memory: SignalMemory, states: Sequence[RobotState], *, is_standing: bool, is_driven: bool
) -> tuple[SignalMemory, tuple[Stop, ...]]:
    """Judge the states that may be used, oldest first.

    Args:
        memory: From the last call.
        states: Those that have arrived since.
        is_standing: The vendor's stand has the joints, so the robot must be at rest.
        is_driven: The joints do what the commands ask.

    Returns:
        The new memory, and a stop for each kind of thing that cannot be true.
    """
    stops: tuple[Stop, ...] = ()
    for state in states:
        window_states = (*memory.states, state)
        if (state.robot_stamp_ns - window_states[0].robot_stamp_ns) / NS_PER_S < bounds.WINDOW_S:
            memory = memory._replace(states=window_states)
            continue
        window = window_of(window_states)
        memory = memory._replace(states=(state,))
        if window is not None:
            memory = _after_window(memory, window, is_standing=is_standing, is_driven=is_driven)
            stops = (*stops, *_stops(memory))
    return memory, stops


def _after_window(memory: SignalMemory, window: Window, *, is_standing: bool, is_driven: bool) -> SignalMemory:
    load_windows, answered = _NO_COUNTS, answer.AnswerMemory()
    received = sum(command.key <= window.last.last_command_key for command in memory.commands)
    if is_driven and memory.commands:
        # A load may answer the newest command that the robot says it has, those before, and later ones.
        commands = memory.commands[max(0, received - bounds.SETPOINTS) :]
        load_windows = np.where(load.disagreeing(window, commands), memory.load_windows + 1, 0)
    if is_driven and received and window.last.load_nm.any():  # where all are zero, they are not reported
        answered = answer.after_window(memory.answer, window, memory.commands[received - 1])
    return SignalMemory(
        memory.states,
        memory.commands,
        motion.after_window(memory.motion, window),
        ground.after_window(memory.ground, window),
        imu.after_window(memory.imu, window),
        weight.after_window(memory.weight, window) if is_driven else weight.WeightMemory(),
        answered,
        still.still_windows(memory.still, window.first, window.last, motion.resting(window) & is_driven),
        load_windows,
        memory.restless_windows + 1 if is_standing and _is_restless(window) else 0,
        memory.burdened_windows + 1 if is_standing and weight.is_burden_wrong(window) else 0,
    )


def _is_restless(window: Window) -> bool:
    state = window.last
    return bool(
        length(state.linear_vel_of_body_in_odom_m_s) > bounds.REST_SPEED_M_S
        or length(window.turn_rad) > bounds.REST_TURN_RATE_RAD_S * window.duration_s
        or np.abs(window.travel_rad).max() > bounds.REST_JOINT_SPEED_RAD_S * window.duration_s
    )


def _stops(memory: SignalMemory) -> Iterator[Stop]:
    is_still = memory.still >= still.WINDOWS
    if is_still.any():
        needed, other = is_still & still.IS_NEEDED, is_still & ~still.IS_NEEDED
        if needed.any():
            yield Stop(StopReason.SIGNAL_FROZEN, _names(needed, still.NAMES))
        if other.any():
            yield Stop(StopReason.SIGNAL_DOUBTED, f"{_names(other, still.NAMES)} no longer change")
    slope = memory.motion.slope_windows >= bounds.SLOPE_WINDOWS
    if slope.any():
        yield _contradiction(f"velocity and position of {_names(slope, facts.JOINT_NAMES)}")
    if memory.motion.turn_windows >= bounds.TURN_WINDOWS:
        yield _contradiction("attitude and turn rate of the body")
    if memory.imu.tilt_error_rad > bounds.GRAVITY_ANGLE_RAD:
        values = {"angle_rad": memory.imu.tilt_error_rad, "bound_rad": bounds.GRAVITY_ANGLE_RAD}
        yield _contradiction("attitude and gravity", values)
    if memory.imu.angle_windows >= bounds.IMU_WINDOWS:
        yield _contradiction("attitude of the body and of its inertial unit")
    if memory.imu.turn_rate_windows >= bounds.IMU_WINDOWS:
        yield _contradiction("turn rate of the body and of its inertial unit")
    if memory.imu.unknown_windows >= bounds.IMU_WINDOWS:
        yield Stop(StopReason.SIGNAL_DOUBTED, "the inertial unit reports what is no number")
    if memory.imu.silent_windows >= bounds.IMU_SILENT_WINDOWS:
        yield Stop(StopReason.SIGNAL_DOUBTED, "the inertial unit no longer reports")
    if memory.ground.sliding_share > bounds.FOOT_SHARE:
        values = {"foot_speed_m_s": memory.ground.speed_m_s, "share": memory.ground.sliding_share}
        yield _contradiction("the body's velocity and feet that stand", values)
    if memory.ground.travel_m > bounds.TRAVEL_M:
        values = {"travel_m": memory.ground.travel_m, "bound_m": bounds.TRAVEL_M}
        feet_agree = memory.ground.sliding_s < 0.5 * memory.ground.touching_s
        reason = StopReason.SIGNAL_DOUBTED if feet_agree else StopReason.SIGNALS_CONTRADICT
        yield Stop(reason, "contacts do not change while the body travels", values)
    if memory.ground.has_touched and memory.ground.airborne_s > bounds.AIRBORNE_S:
        values = {"airborne_s": memory.ground.airborne_s, "bound_s": bounds.AIRBORNE_S}
        yield Stop(StopReason.SIGNAL_DOUBTED, "no foot touches the ground", values)
    loads = memory.load_windows >= bounds.LOAD_WINDOWS
    if loads.any():
        yield _contradiction(f"load and set-point of {_names(loads, facts.JOINT_NAMES)}")
    anothers = memory.answer.anothers_windows >= bounds.LOAD_WINDOWS
    if anothers.any():
        yield _contradiction(f"set-points of {_names(anothers, facts.LEG_NAMES)} and loads, which answer another leg's")
    wrong = memory.answer.wrong_windows >= bounds.LOAD_WINDOWS
    if wrong.any():
        names = _names(wrong, facts.JOINT_NAMES)
        yield Stop(StopReason.SIGNAL_DOUBTED, f"load of {names} does not answer what is asked")
    if memory.weight.is_wrong:
        values = {f"{leg}_share": float(memory.weight.legs_share[i]) for i, leg in enumerate(facts.LEG_NAMES)}
        yield Stop(StopReason.SIGNAL_DOUBTED, "loads do not carry the robot's weight", values)
    if memory.restless_windows >= bounds.REST_WINDOWS:
        yield _contradiction("a robot that stands, and its velocities")
    if memory.burdened_windows >= bounds.REST_WINDOWS:
        yield _contradiction("loads, legs and weight of a robot that stands")


def _contradiction(what: str, values: dict[str, float] | None = None) -> Stop:
    return Stop(StopReason.SIGNALS_CONTRADICT, what, values or {})


def _names(mask: NDArray[np.bool_], names: Sequence[str]) -> str:
    return ", ".join(compress(names, mask))
