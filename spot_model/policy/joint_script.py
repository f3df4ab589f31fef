"""A joint experiment in the place of a policy: what is asked of it are offsets of the set-points, not a velocity.

So hand-over, safety core, log and simulated closed loop are those of a policy. The set-points stay so near to the
measured pose that no servo asks for more than the experiment's torque at rest: a robot that is held fast is not forced.
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
from spot_model.robot.state import RobotState

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

    def followed_rad(self, position_rad: Array, offset_rad: Array) -> Array:
        """Set-points, shape (..., 12), for offsets and measured positions of the same shape."""
        wanted = self.motion.rest_rad + offset_rad
        return np.clip(wanted, position_rad - self.reach_rad, position_rad + self.reach_rad)

    def tick(self, memory: TickMemory, state: RobotState, velocity_command: Array) -> tuple[TickMemory, TickResult]:
        """The set-points for offsets of shape (12,); no network sees or does anything."""
        return memory, TickResult(_NO_NETWORK, _NO_NETWORK, self.followed_rad(state.position_rad, velocity_command))

    def observe_many(self, sensed: Sensed, velocity_command: Array, last_action: NDArray[Any]) -> Array:
        """Measured positions beside the offsets, shape (n, 24)."""
        del last_action
        return np.concatenate([sensed.position_rad, velocity_command], axis=-1)

    def act(self, observation: NDArray[Any]) -> NDArray[np.float32]:
        """Set-points less those at rest, shape (n, 12)."""
        position, offset = np.split(np.asarray(observation, dtype=np.float64), 2, axis=-1)
        return (self.followed_rad(position, offset) - self.motion.rest_rad).astype(np.float32)

    def setpoint_rad(self, action: NDArray[Any]) -> Array:
        """Those at rest and the action."""
        return np.asarray(self.motion.rest_rad + np.asarray(action, dtype=np.float64))


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
