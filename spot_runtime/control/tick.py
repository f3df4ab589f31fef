"""The policy's tick, and when it is due: 50 Hz of robot time, counted from acquisition stamps."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.state import Array, RobotState

_NO_ACTION: Final[NDArray[np.float32]] = np.zeros(facts.N_JOINTS, dtype=np.float32)
_NO_ACTION.flags.writeable = False


class TickSchedule(NamedTuple):
    """An absolute schedule over acquisition stamps: due instants lie a period apart, whatever the jitter.

    On the 3 ms stream a 20 ms period gives steps of 7, 7 and 6 messages: exactly 50 Hz on average.
    """

    period_ns: int
    next_due_robot_ns: int | None = None
    """None before the first state."""
    ticks: int = 0
    skipped: int = 0
    """Due instants that passed without a tick, since the start."""

    def advance(self, robot_stamp_ns: int) -> tuple[TickSchedule, bool, int]:
        """Look at one state's stamp.

        Returns:
            The new schedule, whether a tick is due on this state, and how many ticks were lost just before it.
        """
        if self.next_due_robot_ns is None:
            return TickSchedule(self.period_ns, robot_stamp_ns + self.period_ns, 1, 0), True, 0
        late_ns = robot_stamp_ns - self.next_due_robot_ns
        if late_ns < 0:
            return self, False, 0
        lost = late_ns // self.period_ns
        due = self.next_due_robot_ns + (lost + 1) * self.period_ns
        return TickSchedule(self.period_ns, due, self.ticks + 1, self.skipped + lost), True, lost


def schedule_for(rate_hz: float) -> TickSchedule:
    """A schedule for a policy's rate."""
    return TickSchedule(round(1e9 / rate_hz))


class TickMemory(NamedTuple):
    """What one tick leaves for the next."""

    last_action: NDArray[np.float32] = _NO_ACTION
    """The network's previous output, shape (12,), policy order."""
    window: NDArray[np.float32] | None = None
    """What the network saw, for one that sees several ticks; None before the first."""


class TickResult(NamedTuple):
    """What one tick gave."""

    observation: NDArray[np.float32]
    """As the network saw it: shape (48,), or as many times that as it sees ticks, the newest first."""
    action: NDArray[np.float32]
    """Shape (12,), policy order, unscaled."""
    setpoint_rad: Array
    """Shape (12,), canonical order."""


def tick(
    memory: TickMemory, state: RobotState, velocity_command: Array, policy: Policy
) -> tuple[TickMemory, TickResult]:
    """One step of the policy: the same input gives the same output, and nothing else changes.

    Args:
        memory: From the tick before.
        state: The snapshot that this tick sees.
        velocity_command: V_x, V_y (m/s), ω_z (rad/s), shape (3,).
        policy: The network with its contract.
    """
    seen = policy.observe(state, velocity_command, memory.last_action).astype(np.float32)
    observation = policy.window(seen, memory.window)
    action = policy.act(observation)
    return TickMemory(action, observation), TickResult(observation, action, policy.setpoint_rad(action))


def warm_up(policy: Policy, ticks: int = 20) -> None:
    """Tick on a robot that stands, for nothing: the first ticks load modules and fill caches, which takes 0.1 s."""
    level = np.array([1.0, 0.0, 0.0, 0.0])
    still, joints = np.zeros(3), np.zeros(facts.N_JOINTS)
    feet = np.ones(facts.N_LEGS, dtype=np.bool_)
    state = RobotState(0, 0, facts.DEFAULT_POSITION_RAD, joints, joints, still, level, still, still, feet, 0, 0)
    memory = TickMemory()
    for _ in range(ticks):
        memory, _ = tick(memory, state, still, policy)
