"""Where the joints are, by the servo law, while joint control takes hold of a robot that stands.

The set-point is the pose that the robot reports, and the feed-forward torque the load that carries it, so that nothing
beside that torque is asked. A servo that sees the joint elsewhere adds its stiffness times the difference, and the load
shows it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot_model.robot import facts
from spot_model.robot.state import Array, JointCommand, RobotState
from spot_runtime.control.safety.signals import bounds
from spot_runtime.control.safety.signals.load import torque_nm

_NO_COUNTS: Final = np.zeros(facts.N_JOINTS, dtype=np.int64)
_NO_JOINTS: Final = np.zeros(facts.N_JOINTS)
_ALIKE: Final = 1.0 / 3.0
"""An angle within this share of the error is taken for the true one."""


class HoldMemory(NamedTuple):
    """What the loads have shown since joint control began."""

    windows: NDArray[np.int64] = _NO_COUNTS
    """In a row in which a load lay beside what was asked. Shape (12,)."""
    said_rad: Array = _NO_JOINTS
    """Mean reported position of the last window. Shape (12,)."""
    answers_rad: Array = _NO_JOINTS
    """Position by the servo law. Shape (12,)."""

    @property
    def is_wrong(self) -> NDArray[np.bool_]:
        """Joints whose servo acts on another position than the reported one. Shape (12,)."""
        return self.windows >= bounds.HELD_WINDOWS


def after_window(
    memory: HoldMemory, states: Sequence[RobotState], command: JointCommand, is_measured: NDArray[np.bool_]
) -> HoldMemory:
    """The memory after one more window of states; arguments as in :func:`answer.after_window`."""
    position, velocity, load = (
        np.mean([getattr(state, name) for state in states], axis=0)
        for name in ("position_rad", "velocity_rad_s", "load_nm")
    )
    asked = torque_nm(command, position, velocity)
    unasked = load - asked
    is_beside = np.abs(unasked) > bounds.UNASKED_NM + bounds.UNASKED_SHARE * np.abs(asked)
    windows = np.where(is_measured & is_beside, memory.windows + 1, 0)
    return HoldMemory(windows, position, position - unasked / command.gains.kp_nm_per_rad)


def words(memory: HoldMemory) -> str:
    """Which joints are wrong, where their servos see them, and what single error that looks like."""
    wrong = np.flatnonzero(memory.is_wrong)
    said, answers = memory.said_rad, memory.answers_rad

    def looks_like(joint: int) -> str:
        angles_rad = {", as if mirrored": -said[joint]}
        for other in wrong[wrong != joint]:
            angles_rad[f", as if exchanged with {facts.JOINT_NAMES[other]}"] = said[other]
        alike = min(angles_rad, key=lambda name: abs(answers[joint] - angles_rad[name]))
        is_alike = abs(answers[joint] - angles_rad[alike]) < _ALIKE * abs(answers[joint] - said[joint])
        return alike if is_alike else ""

    return "; ".join(
        f"{facts.JOINT_NAMES[joint]} reports {said[joint]:+.2f} rad and answers as at about {answers[joint]:+.2f}"
        + looks_like(int(joint))
        for joint in wrong
    )
