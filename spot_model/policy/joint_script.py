"""A joint experiment in the place of a policy: what is asked of it are offsets of the set-points, not a velocity.

So hand-over, safety core, log and simulated closed loop are those of a policy. The set-points stay so near to the
measured pose that no servo asks for more than the experiment's torque at rest: a robot that is held fast is not forced.
A body that leans goes back to the stand: where a leg is weak, the lifted foot comes down before the robot falls.

The motion begins and ends in the default pose, at rest. Feet move by inverse kinematics, so the body shifts over feet
that stay where they are. Servos are soft: each set-point lies beyond the pose by what carries the robot's nominal
weight, −Jᵀf/kp with f the load on the foot, so that the body neither sags nor leans on fewer feet.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from spot_model.errors import BadInputError
from spot_model.io.joint_experiment import LIFT_S, JointExperiment, Squat, Standing
from spot_model.policy.contract import PolicyContract, StoredPair
from spot_model.policy.observation import N_OBSERVATION, Sensed
from spot_model.policy.policy import Policy, TickMemory, TickResult
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.leg_kinematics import foot_position_and_jacobian, foot_position_in_body_m, joints_of_feet
from spot_model.robot.rotation import projected_gravity
from spot_model.robot.state import RobotState

TABLE_HZ: Final = 100.0
FADE_S: Final = 1.5
"""Time in which a motion grows from nothing, and in which it fades at its end, s."""
BODY_M_S2: Final = 4.0
"""The body is not accelerated more: feet neither leave the ground nor slip where its friction is 0.5."""
MARGIN_RAD: Final = 0.05
"""Set-points keep this distance from the joint stops."""
SPEED_RAD_S: Final = 6.0
"""No set-point moves faster; a quarter of what a knee can do."""
LEAN_M: Final = (0.09, 0.06)
"""How far the body moves away from a leg before that is lifted, x and y: its weight comes near the middle of the other
feet's triangle."""
LIFTED_M: Final = 0.08
GRAVITY_M_S2: Final = 9.81
AIR: Final = 1e-3
"""Share of relief from which a foot counts as one that is about to leave the ground."""


@dataclass(frozen=True)
class JointMotion:
    """Set-points of one experiment."""

    rest_rad: Array
    """Set-points that carry the robot in the default pose, shape (12,), canonical order."""
    offset_rad: Array
    """From ``rest_rad``, at :data:`TABLE_HZ`, shape (n, 12); zero at both ends."""

    @property
    def duration_s(self) -> float:
        """From rest to rest."""
        return (len(self.offset_rad) - 1) / TABLE_HZ

    def at(self, time_s: float) -> Array:
        """Offset of the set-points from ``rest_rad``, shape (12,), rad; zero before the start and after the end."""
        place = min(max(time_s, 0.0), self.duration_s) * TABLE_HZ
        row = min(int(place), len(self.offset_rad) - 2)
        share = place - row
        return np.asarray((1.0 - share) * self.offset_rad[row] + share * self.offset_rad[row + 1])

    def sampled(self, rate_hz: float) -> Array:
        """Offsets at a fixed rate, shape (duration · rate, 12)."""
        return np.array([self.at(i / rate_hz) for i in range(round(self.duration_s * rate_hz))])


def motion_of(experiment: JointExperiment) -> JointMotion:
    """The motion of an experiment.

    Raises:
        BadInputError: A foot cannot reach its place, or a set-point comes too near to a stop or moves too fast; the
            message names joint, value and bound.
    """
    time_s = np.arange(round(experiment.duration_s * TABLE_HZ) + 1) / TABLE_HZ
    try:
        body_m, pose, air = _poses(experiment, time_s)
    except ValueError as error:
        raise BadInputError(f"joint experiment {experiment.name}: {error}") from error
    setpoint = pose + carried_nm(pose, air) / experiment.kp_nm_per_rad
    _check(experiment.name, setpoint)
    _check_body(experiment.name, body_m)
    return JointMotion(setpoint[0], setpoint - setpoint[0])


def _poses(experiment: JointExperiment, time_s: Array) -> tuple[Array, Array, Array]:
    """Poses at n instants: the body's place (n, 3), m; joints (n, 12); how far each foot is relieved, 0 to 1 (n, 4)."""
    grown = _plateau(time_s, 0.0, experiment.duration_s, FADE_S)
    body, air = np.zeros((len(time_s), 3)), np.zeros((len(time_s), facts.N_LEGS))
    if isinstance(experiment, Standing):
        phase = 2.0 * np.pi * experiment.frequency_hz * time_s
        body[:, 0] = experiment.shift_x_m * np.sin(phase) * grown
        body[:, 1] = experiment.shift_y_m * np.cos(phase) * grown
        return body, _with_body_at(body, air), air
    if isinstance(experiment, Squat):
        phase = 2.0 * np.pi * experiment.frequency_hz * time_s
        body[:, 2] = -0.5 * experiment.depth_m * (1.0 - np.cos(phase)) * grown
        return body, _with_body_at(body, air), air
    joint, end_s, first_s = facts.JOINT_NAMES.index(experiment.joint), experiment.duration_s, 0.0
    if experiment.is_leg_lifted:
        leg = facts.LEG_NAMES[joint // 3]
        first_s, shift_s = LIFT_S, LIFT_S / 2.0
        lean = _plateau(time_s, 0.0, end_s, shift_s)
        body[:, 0] = -facts.end_sign(leg) * LEAN_M[0] * lean
        body[:, 1] = -facts.side_sign(leg) * LEAN_M[1] * lean
        air[:, joint // 3] = _plateau(time_s, shift_s, end_s - shift_s, LIFT_S - shift_s)
    pose = _with_body_at(body, air)
    swings_s = end_s - 2.0 * first_s
    since_s = np.clip(time_s - first_s, 0.0, swings_s)
    rise = (experiment.end_hz - experiment.start_hz) / swings_s
    phase = 2.0 * np.pi * (experiment.start_hz + 0.5 * rise * since_s) * since_s
    grown = _plateau(time_s, first_s, end_s - first_s, min(FADE_S, 0.25 * swings_s))
    pose[:, joint] += experiment.amplitude_rad * np.sin(phase) * grown
    return body, pose, air


def _with_body_at(body_m: Array, air: Array) -> Array:
    """Poses with the body moved by ``body_m``, shape (n, 3), and feet lifted by a share of :data:`LIFTED_M`, (n, 4)."""
    feet = np.asarray(foot_position_in_body_m(facts.DEFAULT_POSITION_RAD)) - body_m[:, None, :]
    feet[..., 2] += LIFTED_M * air
    return joints_of_feet(feet, facts.DEFAULT_POSITION_RAD)


def carried_nm(pose_rad: Array, air: Array) -> Array:
    """Joint torques that carry the nominal weight, shape (n, 12), of poses, (n, 12), and relieved feet, (n, 4), 0 to 1.

    The loads of the feet balance weight and moments about the body's centre; of all that do, the smallest. Where a foot
    is relieved, loads go over from those on four feet to those on the others.
    """
    feet, jacobian = (np.asarray(a) for a in foot_position_and_jacobian(pose_rad))
    balance = np.stack([np.ones_like(feet[..., 0]), feet[..., 0], feet[..., 1]], axis=-2)
    weight = np.array([facts.TOTAL_MASS_KG * GRAVITY_M_S2, 0.0, 0.0])
    on_all = np.linalg.pinv(balance) @ weight
    on_rest = np.linalg.pinv(balance * (air < AIR)[:, None, :]) @ weight
    gone = air.max(axis=1, keepdims=True)
    load_n = (1.0 - gone) * on_all + gone * on_rest
    return np.asarray(-jacobian[..., 2, :] * load_n[..., None]).reshape(pose_rad.shape)


def _plateau(time_s: Array, first_s: float, last_s: float, fade_s: float) -> Array:
    """0 before ``first_s`` and after ``last_s``, 1 between, with smooth fades of ``fade_s`` inside."""
    share = np.clip(np.minimum(time_s - first_s, last_s - time_s) / fade_s, 0.0, 1.0)
    return np.asarray(share * share * share * (10.0 - 15.0 * share + 6.0 * share * share))


def _check(name: str, position: Array) -> None:
    low, high = facts.POSITION_LOW_RAD + MARGIN_RAD, facts.POSITION_HIGH_RAD - MARGIN_RAD
    beyond = np.maximum(low - position, position - high).max(axis=0)
    worst = int(beyond.argmax())
    if beyond[worst] > 0.0:
        raise BadInputError(
            f"joint experiment {name}: a set-point of {facts.JOINT_NAMES[worst]} lies {beyond[worst]:.3f} rad outside "
            f"{low[worst]:.3f} to {high[worst]:.3f} rad; ask for less"
        )
    speed = np.abs(np.diff(position, axis=0)).max(axis=0) * TABLE_HZ
    worst = int(speed.argmax())
    if speed[worst] > SPEED_RAD_S:
        raise BadInputError(
            f"joint experiment {name}: the set-point of {facts.JOINT_NAMES[worst]} moves at {speed[worst]:.1f} rad/s; "
            f"allowed: up to {SPEED_RAD_S:g} rad/s; ask for a smaller amplitude or a lower frequency"
        )


def _check_body(name: str, body_m: Array) -> None:
    most = float(np.linalg.norm(np.diff(body_m, n=2, axis=0), axis=1).max()) * TABLE_HZ**2
    if most > BODY_M_S2:
        raise BadInputError(
            f"joint experiment {name}: the body would be accelerated by {most:.1f} m/s²; allowed: up to {BODY_M_S2:g} "
            "m/s²; ask for a smaller motion or a lower frequency"
        )


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
    """The script of an experiment. Raises BadInputError: its motion leaves the joints' stops or is too fast."""
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
