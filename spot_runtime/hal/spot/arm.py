"""A Spot's arm, held stowed while the legs are controlled: its set-points are captured when joint control begins.

The gains are the vendor's published ones of position control: ``DEFAULT_K_Q_P`` and ``DEFAULT_K_QD_P`` in
``python/examples/joint_control/constants.py`` of Boston Dynamics' SDK, whose ``wiggle_arm.py`` holds joints in the same
way, by the measured position and the measured load as feed-forward torque.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from bosdyn.api import robot_state_pb2

from spot_model.robot.arm import (
    ARM_HIGH_RAD,
    ARM_JOINT_NAMES,
    ARM_KD_NM_S_PER_RAD,
    ARM_KP_NM_PER_RAD,
    ARM_LOW_RAD,
    STOWED_HIGH_RAD,
    STOWED_LOW_RAD,
)
from spot_model.robot.facts import STAND_KP_NM_PER_RAD
from spot_model.robot.state import Gains, RobotState
from spot_runtime.hal.errors import HalError
from spot_runtime.stops import Stop, StopReason

AWAY_RAD: Final = 0.3
"""A joint this far from its set-point is not held any more: the shoulder's servo gives 76 N·m there, or more."""
AWAY_STATES: Final = 5
"""So many states in a row, 15 ms."""
_LOADS: Final = 100
"""States whose mean load is the feed-forward torque, as of the legs."""
_ZEROS: Final = [0.0] * len(ARM_JOINT_NAMES)


def why_out(position_rad: Mapping[str, float]) -> str:
    """Which of these joints, by name, are not where those of a stowed arm are; empty if none, and without an arm."""
    bounds = zip(ARM_JOINT_NAMES, STOWED_LOW_RAD.tolist(), STOWED_HIGH_RAD.tolist(), strict=True)
    out = [
        f"{name} at {position_rad[name]:.2f} rad (allowed: {low:g} to {high:g})"
        for name, low, high in bounds
        if name in position_rad and not low <= position_rad[name] <= high
    ]
    return ", ".join(out)


def polled_arm_rad(message: robot_state_pb2.RobotState) -> dict[str, float]:
    """Positions of the arm's joints of a polled state, by our names; empty without an arm."""
    joints = {joint.name.replace(".", "_"): joint.position.value for joint in message.kinematic_state.joint_states}
    return {name: joints[name] for name in ARM_JOINT_NAMES if name in joints}


def refuse_arm_out(position_rad: Mapping[str, float]) -> None:
    """Raise HalError if these joints, by name, are those of an arm that is not stowed."""
    if out := why_out(position_rad):
        raise HalError(f"the robot's arm is not stowed: {out}; stow it, with its gripper closed, then start again")


class ArmCommand(NamedTuple):
    """What is asked of the arm's joints, in lists that are put behind the legs'; empty without an arm."""

    position_rad: list[float]
    load_nm: list[float]
    kp_nm_per_rad: list[float]
    kd_nm_s_per_rad: list[float]

    @property
    def velocity_rad_s(self) -> list[float]:
        """It rests."""
        return [0.0] * len(self.position_rad)


NO_ARM: Final = ArmCommand([], [], [], [])


class Arm:
    """The arm of one robot, as the stream shows it and as it is held. For the thread of the loop.

    Whether there is one is read from the first state. What is wrong goes to ``problems``.
    """

    def __init__(self, problems: deque[Stop]) -> None:
        self._problems = problems
        self.n_joints: int | None = None
        """As the first state has; None before it."""
        self._position_rad: Sequence[float] = ()
        self._loads_nm: deque[Sequence[float]] = deque(maxlen=_LOADS)
        self._held = NO_ARM
        self._legs: Gains | None = None
        self._command = NO_ARM
        self._share, self._away, self._is_stopped = 0.0, 0, False

    def refuse_out(self) -> None:
        """Raise HalError if the newest state shows an arm that is not stowed."""
        refuse_arm_out(dict(zip(ARM_JOINT_NAMES, self._position_rad, strict=False)))

    def watch(self, states: list[RobotState]) -> list[RobotState]:
        """Take note of states, and tell once of an arm that is lost or away. Returns the states."""
        for state in states:
            n_joints = len(state.arm_position_rad)
            self.n_joints = n_joints if self.n_joints is None else self.n_joints
            if n_joints != self.n_joints:
                self._stop(StopReason.ARM_LOST, f"{n_joints} of the arm's joints come, before it were {self.n_joints}")
            elif n_joints:
                self._position_rad = state.arm_position_rad
                self._loads_nm.append(state.arm_load_nm)
                self._look_whether_away()
        return states

    def take_hold(self) -> bool:
        """Capture the set-points: where the joints are, with the load that they carry, and the gripper closed.

        Returns:
            Whether joint control may begin; an arm that is not stowed is told of.
        """
        self._share, self._away, self._is_stopped, self._legs = 0.0, 0, False, None
        try:
            self.refuse_out()
        except HalError as error:
            self._stop(StopReason.ACTIVATION_FAILED, str(error))
            return False
        if self._position_rad:
            position_rad = np.clip(self._position_rad, ARM_LOW_RAD, ARM_HIGH_RAD)
            position_rad[-1] = ARM_HIGH_RAD[-1]
            self._held = ArmCommand(position_rad.tolist(), np.mean(self._loads_nm, axis=0).tolist(), [], [])
        return True

    def let_go(self) -> None:
        """The joints are not ours any more."""
        self._held = NO_ARM

    def command(self, legs: Gains) -> ArmCommand:
        """What is asked of the arm beside legs with these gains.

        It gets as stiff as they have been, against their stand's stiffness; where they are damped, it is.
        """
        held = self._held
        if not held.position_rad or legs is self._legs:
            return self._command if held.position_rad else NO_ARM
        self._legs, kd = legs, ARM_KD_NM_S_PER_RAD.tolist()
        if legs.kp_nm_per_rad.any():
            stiffness = float((legs.kp_nm_per_rad / STAND_KP_NM_PER_RAD).max())
            self._share = max(self._share, min(1.0, stiffness))
            self._command = held._replace(kp_nm_per_rad=(self._share * ARM_KP_NM_PER_RAD).tolist(), kd_nm_s_per_rad=kd)
        else:
            self._command = ArmCommand(held.position_rad, _ZEROS, _ZEROS, kd)
        return self._command

    def _look_whether_away(self) -> None:
        pairs = zip(ARM_JOINT_NAMES, self._position_rad, self._held.position_rad, strict=False)  # none is held before
        away = [
            f"{n} is at {at:.2f} rad, held at {held:.2f}" for n, at, held in pairs if not abs(at - held) <= AWAY_RAD
        ]
        self._away = self._away + 1 if away else 0
        if self._away >= AWAY_STATES:
            self._stop(StopReason.ARM_AWAY, f"{', '.join(away)}; allowed: within {AWAY_RAD:g} rad")

    def _stop(self, reason: StopReason, words: str) -> None:
        if not self._is_stopped:
            self._is_stopped = True
            self._problems.append(Stop(reason, words))
