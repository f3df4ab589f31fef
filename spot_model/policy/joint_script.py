"""A joint experiment in the place of a policy: what is asked of it are offsets of the set-points, not a velocity.

So hand-over, safety core, log and simulated closed loop are those of a policy. The set-points stay so near to the
measured pose that no servo asks for more than the experiment's torque at rest: a robot that is held fast is not forced.
A body that leans goes back to the stand: where a leg is weak, the lifted foot comes down before the robot falls.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from spot_model.io.joint_experiment import JointExperiment
from spot_model.policy.contract import PolicyContract, StoredPair
from spot_model.policy.joint_motion import SPEED_RAD_S, JointMotion, motion_of
from spot_model.policy.observation import N_OBSERVATION, Sensed
from spot_model.policy.policy import Policy, TickMemory, TickResult
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.rotation import projected_gravity
from spot_model.robot.state import RobotState

LEAN_RAD: Final = (0.12, 0.20)
"""Of the body: up to the first the motion is whole, from the second on the robot stands; between, a share of it."""
_NO_NETWORK: Final[NDArray[np.float32]] = np.zeros(0, dtype=np.float32)


@dataclass(frozen=True)
class JointScript(Policy):
    """Follows the offsets that it is told, within the experiment's torque."""

    experiment: JointExperiment
    motion: JointMotion
    reach_rad: Array
    """Largest distance of a set-point from the measured position, shape (12,)."""

    @property
    def command_low(self) -> tuple[float, ...]:
        """Least offsets, rad."""
        return (-np.pi,) * facts.N_JOINTS

    @property
    def command_high(self) -> tuple[float, ...]:
        """Largest offsets, rad."""
        return (np.pi,) * facts.N_JOINTS

    @property
    def setpoint_speed_rad_s(self) -> float:
        """No set-point moves faster."""
        return SPEED_RAD_S

    def followed_rad(self, position_rad: Array, offset_rad: Array, up: Array | float = 1.0) -> Array:
        """Set-points, shape (..., 12), for offsets and measured positions of the same shape.

        Args:
            position_rad: Measured positions.
            offset_rad: From the set-points at rest.
            up: Cosine of the body's lean, shape (..., 1).
        """
        lean_rad = np.arccos(np.clip(up, -1.0, 1.0))
        wanted = self.motion.rest_rad + offset_rad * np.clip(
            (LEAN_RAD[1] - lean_rad) / (LEAN_RAD[1] - LEAN_RAD[0]), 0.0, 1.0
        )
        return np.asarray(np.clip(wanted, position_rad - self.reach_rad, position_rad + self.reach_rad))

    def tick(self, memory: TickMemory, state: RobotState, velocity_command: Array) -> tuple[TickMemory, TickResult]:
        """The set-points for offsets of shape (12,); no network sees or does anything."""
        followed = self.followed_rad(state.position_rad, velocity_command, _up(state.odom_from_body_wxyz))
        return memory, TickResult(_NO_NETWORK, _NO_NETWORK, followed)

    def observe_many(self, sensed: Sensed, velocity_command: Array, last_action: NDArray[Any]) -> Array:
        """Measured positions, offsets and the cosine of the lean, shape (n, 25)."""
        del last_action
        return np.concatenate([sensed.position_rad, velocity_command, _up(sensed.world_from_body_wxyz)], axis=-1)

    def act(self, observation: NDArray[Any]) -> NDArray[np.float32]:
        """Set-points less those at rest, shape (n, 12)."""
        n = facts.N_JOINTS
        position, offset, up = np.split(np.asarray(observation, dtype=np.float64), [n, 2 * n], axis=-1)
        return (self.followed_rad(position, offset, up) - self.motion.rest_rad).astype(np.float32)

    def setpoint_rad(self, action: NDArray[Any]) -> Array:
        """Those at rest and the action."""
        return np.asarray(self.motion.rest_rad + np.asarray(action, dtype=np.float64))


def _up(wxyz: Array) -> Array:
    """Cosine of the lean, shape (..., 1), of attitudes (..., 4)."""
    return -np.asarray(projected_gravity(wxyz))[..., 2:]


def joint_script(experiment: JointExperiment) -> JointScript:
    """The script of an experiment.

    Raises:
        BadInputError: Its motion leaves the joints' stops or is too fast.
    """
    n = facts.N_JOINTS
    kp, kd = (experiment.kp_nm_per_rad,) * n, (experiment.kd_nm_s_per_rad,) * n
    contract = PolicyContract(
        name=experiment.name,
        kp_nm_per_rad=kp,
        kd_nm_s_per_rad=kd,
        velocity_command_low=(0.0, 0.0, 0.0),
        velocity_command_high=(0.0, 0.0, 0.0),
        stored_pair=StoredPair(observation=(0.0,) * N_OBSERVATION, action=(0.0,) * n),
    )
    order, motion = np.arange(n, dtype=np.intp), motion_of(experiment)
    return JointScript(
        contract=contract,
        sha256="",
        session=None,
        policy_from_canonical=order,
        canonical_from_policy=order,
        default_position_rad=motion.rest_rad,
        experiment=experiment,
        motion=motion,
        reach_rad=np.full(n, experiment.torque_nm / experiment.kp_nm_per_rad),
    )
