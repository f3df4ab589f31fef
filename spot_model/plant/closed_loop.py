"""A policy in closed loop with simulated robots: sense, observe, act, command, step. The caller records.

One loop serves identification, evaluation and simulated logs. They differ in what is sensed, in what of it the policy
sees, in the commands' way to the servos, and in what is kept of each tick.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from array_api_compat import device
from numpy.typing import NDArray

from spot_model.plant.command_path import CommandPath, PlantPath
from spot_model.plant.plant import Plant
from spot_model.policy.observation import Sensed
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.arrays import like, namespace_of, on_host
from spot_model.robot.facts import Array
from spot_model.robot.leg_kinematics import foot_position_in_body_m
from spot_model.robot.rotation import AnyArray, conjugate_wxyz, multiply_wxyz, rotate_inverse_wxyz, rotate_wxyz

CommandAt = Callable[[int], Array]
"""What is asked of all robots at a policy tick: velocities, shape (n, 3); offsets of a joint script, shape (n, 12)."""
Observed = AnyArray


@dataclass(frozen=True)
class LoopTick:
    """One policy tick, handed out after the robots have moved."""

    index: int
    velocity_command: Array
    """Shape (n, 3), or (n, 12) of a joint script."""
    observation: Observed
    """What the policy saw, shape (n, 48), policy order; an array of the plant's library."""
    action: AnyArray
    """Shape (n, 12), policy order."""


def true_state(plant: Plant) -> Sensed:
    """What perfect sensors would report."""
    attitude, turn = plant.world_from_body_wxyz, plant.outside.odom_from_ground_wxyz()
    velocities = plant.linear_vel_of_body_in_world_m_s, plant.angular_vel_of_body_in_world_rad_s
    if turn is not None:
        attitude = multiply_wxyz(turn, attitude)
        velocities = rotate_wxyz(turn, velocities[0]), rotate_wxyz(turn, velocities[1])
    return Sensed(plant.joint_position_rad, plant.joint_velocity_rad_s, attitude, *velocities)


@dataclass(frozen=True)
class ClosedLoop:
    """What stays the same over a run.

    Args:
        plant: Robots, already in their initial state.
        policy: Joint order, default pose and gains are its contract's.
        path: How set-points reach the servos; the plant's own channel if None.
        sense: Called at every state message with its number within the tick; None where the policy does not run means
            that nothing was asked for. The truth by default.
        see: What the policy sees of an observation, shape (n, 48), at a tick: noise, a type.
        act: The network on all robots, from what it sees: shape (n, 48), or 48 a tick of the policy's history.
        before_tick: Called with the tick's number: pushes and the like.
        after_step: Called after every physics step.
    """

    plant: Plant
    policy: Policy
    path: CommandPath | None = None
    sense: Callable[[int], Sensed | None] | None = None
    see: Callable[[int, Observed], Observed] | None = None
    act: Callable[[Observed], AnyArray] | None = None
    before_tick: Callable[[int], None] | None = None
    after_step: Callable[[], None] | None = None

    def run(
        self, command_at: CommandAt, schedule: Iterable[Sequence[int]], last_action: NDArray[np.float32] | None = None
    ) -> Iterator[LoopTick]:
        """Run the schedule; each tick comes after its last physics step.

        Args:
            command_at: What is asked, by tick.
            schedule: When robots are sensed and the policy runs; it may be endless.
            last_action: The networks' outputs before the first tick, shape (n, 12), policy order; zeros if None.
        """
        policy = self.plant.policy_here(self.policy)
        path = self.path or PlantPath(self.plant, policy.gains())
        act = self.act or policy.act
        n, position = self.plant.n_sims, self.plant.joint_position_rad
        xp = namespace_of(position)
        zeros = np.zeros((n, facts.N_JOINTS)) if last_action is None else last_action
        action = xp.asarray(zeros, dtype=xp.float32, device=device(position))
        window: Observed | None = None
        for index, messages in enumerate(schedule):
            if self.before_tick is not None:
                self.before_tick(index)
            asked = command_at(index)
            command = np.broadcast_to(asked, (n, asked.shape[-1]))
            told = like(position, command)
            observation: Observed = np.empty(0)
            for message, n_steps in enumerate(messages):
                sensed = true_state(self.plant) if self.sense is None else self.sense(message)
                if message == 0 and sensed is not None:
                    observation = policy.observe_many(sensed, told, action)
                    observation = observation if self.see is None else self.see(index, observation)
                    window = policy.window(observation, window)
                    action = act(window)
                    path.send(index + 1, policy.setpoint_rad(action))
                if self.after_step is None:
                    path.advance(n_steps)
                    continue
                for _ in range(n_steps):
                    path.advance(1)
                    self.after_step()
            yield LoopTick(index, command, observation, action)


def schedule_by_rate(n_ticks: int, rate_hz: float, timestep_s: float) -> list[tuple[int]]:
    """One message a tick, on an absolute schedule: at 50 Hz, 3 ms steps come as 6, 7, 7 and so on."""
    ends = np.floor(np.arange(n_ticks + 1) / (rate_hz * timestep_s) + 1e-9)
    return [(int(steps),) for steps in np.diff(ends)]


def schedule_by_messages(
    n_ticks: int, steps_per_message: int, period_s: float = 1.0 / facts.POLICY_RATE_HZ
) -> list[tuple[int, ...]]:
    """Every message of the 3 ms state stream: under a 50 Hz policy 7, 7 and 6 of them a tick."""
    ends = np.ceil(np.arange(n_ticks + 1) * (period_s / (facts.STATE_PERIOD_NS * 1e-9)) - 1e-6).astype(int)
    return [(steps_per_message,) * int(states) for states in np.diff(ends)]


SETTLED_M: Final = 1e-6
"""The lowest foot starts so far in the ground: exactly on it, a GPU's rounding would decide whether it touches."""


@dataclass(frozen=True)
class StartState:
    """One robot at its first policy tick."""

    position_rad: Array
    """Shape (12,), canonical order."""
    velocity_rad_s: Array
    world_from_body_wxyz: Array
    linear_vel_of_body_in_world_m_s: Array
    angular_vel_of_body_in_world_rad_s: Array
    last_action: NDArray[np.float32]
    """Shape (12,), policy order."""


def standing_height_m(start: StartState) -> float:
    """Height of the body's origin at which the lowest foot just touches level ground."""
    feet = rotate_wxyz(start.world_from_body_wxyz[None, :], foot_position_in_body_m(start.position_rad))
    return float(facts.FOOT_RADIUS_M - np.min(np.asarray(feet)[..., 2]))


def _from_odom(start: StartState, odom_from_ground_wxyz: Array) -> StartState:
    attitude = multiply_wxyz(conjugate_wxyz(odom_from_ground_wxyz), start.world_from_body_wxyz)
    names = ("linear_vel_of_body_in_world_m_s", "angular_vel_of_body_in_world_rad_s")
    velocities = {name: rotate_inverse_wxyz(odom_from_ground_wxyz, getattr(start, name)) for name in names}
    return replace(start, world_from_body_wxyz=attitude, **velocities)


def put_at(plant: Plant, starts: Sequence[StartState]) -> NDArray[np.float32]:
    """Put each simulation into its start, as odom has it, on the ground; return the last actions, shape (n_sims, 12).

    Raises:
        ValueError: There is not one start a simulation.
    """
    if (turns := plant.outside.odom_from_ground_wxyz()) is not None:
        starts = [_from_odom(start, turn) for start, turn in zip(starts, on_host(turns), strict=True)]

    def each(name: str) -> Array:
        return np.stack([getattr(start, name) for start in starts])

    height = np.array([standing_height_m(start) - SETTLED_M for start in starts])
    attitude = each("world_from_body_wxyz")
    attitude /= np.linalg.norm(attitude, axis=1, keepdims=True)
    plant.reset(
        position_of_body_in_world_m=np.stack([0.0 * height, 0.0 * height, height], axis=1),
        world_from_body_wxyz=attitude,
        joint_position_rad=each("position_rad"),
        linear_vel_of_body_in_world_m_s=each("linear_vel_of_body_in_world_m_s"),
        angular_vel_of_body_in_body_rad_s=np.asarray(
            rotate_inverse_wxyz(attitude, each("angular_vel_of_body_in_world_rad_s"))
        ),
        joint_velocity_rad_s=each("velocity_rad_s"),
    )
    return each("last_action").astype(np.float32)
