"""A trot without a network: foot paths by the clock, inverse kinematics, and foot placement by the body's velocity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot_model.robot import facts
from spot_model.robot.leg_kinematics import foot_position_and_jacobian
from spot_model.robot.state import Gains

Array = NDArray[np.float64]

PAIR = np.array([0.0, 0.5, 0.5, 0.0])
"""Phase of each leg in a trot."""
SIDE = np.array([facts.side_sign(leg) for leg in facts.LEG_NAMES], dtype=np.float64)
END = np.array([facts.end_sign(leg) for leg in facts.LEG_NAMES], dtype=np.float64)
THIGH_M = float(np.hypot(facts.KN_FROM_HY_M[0], facts.KN_FROM_HY_M[2]))
THIGH_LEAN_RAD = float(np.arctan2(facts.KN_FROM_HY_M[0], -facts.KN_FROM_HY_M[2]))
SHANK_M = -facts.FOOT_FROM_KN_M[2]


@dataclass
class ScriptedGait:
    """Has the parts of a policy that a log needs: ``act``, ``setpoint_rad``, ``gains``; counts ticks by itself."""

    period_ticks: int = 18
    height_m: float = 0.48
    lift_m: float = 0.09
    kp_nm_per_rad: float = facts.POLICY_KP_NM_PER_RAD
    kd_nm_s_per_rad: float = facts.POLICY_KD_NM_S_PER_RAD
    tick: int = 0

    def act(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """One tick: observations (n, 48) to actions (n, 12)."""
        o = np.asarray(observation, dtype=np.float64)
        velocity, rate, gravity, command = o[:, 0:3], o[:, 3:6], o[:, 6:9], o[:, 9:12]
        moving = np.clip(10.0 * np.abs(command).sum(axis=1), 0.0, 1.0)[:, None]
        phase = (self.tick / self.period_ticks + PAIR) % 1.0
        self.tick += 1
        swing = np.clip((phase - 0.5) / 0.5, 0.0, 1.0)
        stance = np.clip(phase / 0.5, 0.0, 1.0)
        lift = self.lift_m * np.where(phase > 0.5, np.sin(np.pi * swing), 0.0) * moving
        # From +1 (touch-down) to −1 (lift-off), and back with zero velocity at both ends of the swing.
        sweep = np.where(phase <= 0.5, 1.0 - 2.0 * stance, -np.cos(np.pi * swing))
        half_s = 0.25 * self.period_ticks / facts.POLICY_RATE_HZ
        turn = 0.17 * command[:, 2:3] * SIDE
        sideways = 0.3 * command[:, 2:3] * END
        late = 0.5 * (sweep + 1.0)
        x = (command[:, 0:1] - turn) * half_s * sweep + 0.12 * (velocity[:, 0:1] - command[:, 0:1]) * late
        y = (command[:, 1:2] + sideways) * half_s * sweep + 0.12 * (velocity[:, 1:2] - command[:, 1:2]) * late
        setpoint = _inverse_kinematics(x, y, self.height_m - lift)
        standing = np.where((phase <= 0.5) | (moving < 0.5), 1.0, 0.0)
        share_n = facts.TOTAL_MASS_KG * 9.81 / standing.sum(axis=1, keepdims=True)
        # Push up against weight and lean, and along the command, with the feet that stand.
        up = share_n + 150.0 * (END * gravity[:, 0:1] + 0.15 * END * rate[:, 1:2])
        up = up + 150.0 * (SIDE * gravity[:, 1:2] - 0.1 * SIDE * rate[:, 0:1]) - 100.0 * velocity[:, 2:3]
        along = 60.0 * (command[:, 0:1] - velocity[:, 0:1]) - 20.0 * SIDE * (command[:, 2:3] - rate[:, 2:3])
        across = 60.0 * (command[:, 1:2] - velocity[:, 1:2]) + 0.0 * SIDE
        force = standing[..., None] * np.stack([along, across, up], axis=-1)
        position = o[:, 12:24] + facts.DEFAULT_POSITION_RAD
        _, jacobian = foot_position_and_jacobian(position)
        torque = -np.einsum("nlij,nli->nlj", jacobian, force).reshape(-1, facts.N_JOINTS)
        setpoint = setpoint + torque / self.kp_nm_per_rad
        return ((setpoint - facts.DEFAULT_POSITION_RAD) / facts.ACTION_SCALE_RAD).astype(np.float32)

    def setpoint_rad(self, action: NDArray[np.float32]) -> Array:
        """Set-points of an action, shape (..., 12)."""
        return np.asarray(facts.ACTION_SCALE_RAD * np.asarray(action, dtype=np.float64) + facts.DEFAULT_POSITION_RAD)

    def gains(self) -> Gains:
        """Servo gains."""
        return Gains(np.full(12, self.kp_nm_per_rad), np.full(12, self.kd_nm_s_per_rad))


def _inverse_kinematics(x: Array, y: Array, z: Array) -> Array:
    """Joints for feet at (x, y outward shift to the left, z down) from below each hip, each (n, 4); returns (n, 12)."""
    out = facts.HY_FROM_HX_M[1]
    side = out * SIDE + y
    plane = np.sqrt(np.maximum(z**2 + side**2 - out**2, 0.01))
    hx = np.arctan2(side, z) - np.arctan2(out * SIDE, plane)
    reach = np.clip(np.sqrt(x**2 + plane**2), 0.25, THIGH_M + SHANK_M - 0.01)
    bend = np.arccos(np.clip((THIGH_M**2 + SHANK_M**2 - reach**2) / (2 * THIGH_M * SHANK_M), -1.0, 1.0))
    knee = bend - np.pi - THIGH_LEAN_RAD
    at_hip = np.arccos(np.clip((THIGH_M**2 + reach**2 - SHANK_M**2) / (2 * THIGH_M * reach), -1.0, 1.0))
    hy = -np.arctan2(x, plane) + at_hip + THIGH_LEAN_RAD
    joints = np.stack([hx, hy, -np.abs(knee)], axis=-1).reshape(x.shape[0], 12)
    return np.clip(joints, facts.POSITION_LOW_RAD + 0.02, facts.POSITION_HIGH_RAD - 0.02)
