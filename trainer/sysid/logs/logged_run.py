"""One real run as the identification sees it: the stretch under the policy, in arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from spot_model.policy.observation import observed
from trainer.sysid.simulation.rollout import StartState

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]


@dataclass(frozen=True)
class Ticks:
    """Policy ticks in order; observation and action in the policy's joint order."""

    robot_stamp_ns: Stamps
    """Stamp of the state that the tick saw, shape (n,)."""
    observation: NDArray[np.float32]
    """Shape (n, 48)."""
    action: NDArray[np.float32]
    """Shape (n, 12)."""
    velocity_command: Array
    """Shape (n, 3)."""


@dataclass(frozen=True)
class Commands:
    """Commands in the order of their keys, canonical joint order."""

    key: NDArray[np.int64]
    """Shape (k,), rising."""
    robot_stamp_ns: Stamps
    """When each was handed to the stream, by the estimated robot clock; 0 where unknown. Shape (k,)."""
    state_robot_stamp_ns: Stamps
    """Stamp of the state that each answers; 0 for none. Shape (k,)."""
    position_rad: Array
    """Set-points as sent, shape (k, 12)."""
    kp_nm_per_rad: Array
    kd_nm_s_per_rad: Array


@dataclass(frozen=True)
class States:
    """Every state message of the stretch, canonical joint order."""

    robot_stamp_ns: Stamps
    """Shape (m,), rising."""
    position_rad: Array
    """Shape (m, 12)."""
    velocity_rad_s: Array
    load_nm: Array
    odom_from_body_wxyz: Array
    """Shape (m, 4)."""
    linear_vel_of_body_in_odom_m_s: Array
    """Shape (m, 3)."""
    angular_vel_of_body_in_odom_rad_s: Array
    last_command_key: NDArray[np.int64]
    """Shape (m,); 0 before the first command."""
    last_command_robot_stamp_ns: Stamps


@dataclass(frozen=True, eq=False)
class LoggedRun:
    """One run of one policy through one command sequence."""

    source: str
    """The file, for messages."""
    sequence: str
    repeat: int
    policy_sha256: str
    ticks: Ticks
    commands: Commands
    states: States
    notes: tuple[str, ...] = ()
    """What was cut or is missing, in words."""
    labels: Mapping[str, str] = field(default_factory=dict)
    has_policy_gains: bool = True
    """Whether it ran at the gains of the policy file that was given; otherwise only its torques are of use."""

    @property
    def duration_s(self) -> float:
        """From the first policy tick to the last."""
        stamps = self.ticks.robot_stamp_ns
        return float(stamps[-1] - stamps[0]) * 1e-9 if len(stamps) else 0.0

    def start(self) -> StartState:
        """The robot at the first policy tick."""
        stamp = self.ticks.robot_stamp_ns[0]
        index = min(int(np.searchsorted(self.states.robot_stamp_ns, stamp)), len(self.states.robot_stamp_ns) - 1)
        s = self.states
        return StartState(
            position_rad=s.position_rad[index],
            velocity_rad_s=s.velocity_rad_s[index],
            world_from_body_wxyz=s.odom_from_body_wxyz[index],
            linear_vel_of_body_in_world_m_s=s.linear_vel_of_body_in_odom_m_s[index],
            angular_vel_of_body_in_world_rad_s=s.angular_vel_of_body_in_odom_rad_s[index],
            last_action=observed(self.ticks.observation[0], "last_action"),
        )
