"""Many closed-loop runs of a policy in one batch of simulations, one candidate for each group of simulations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from spot_model.effects.base import Effect
from spot_model.effects.command.command_delay import CommandDelay
from spot_model.plant.plant import Plant, PlantOptions, ServoCommand
from spot_model.policy.observation import N_OBSERVATION, build_observation, is_fallen, observed
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.leg_kinematics import foot_position_in_body_m
from spot_model.robot.mjcf import MjcfOptions
from spot_model.robot.rotation import rotate_wxyz
from trainer.sysid.distance.features import control_law_features

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StartState:
    """How a run begins: the robot at its first policy tick."""

    position_rad: Array
    """Shape (12,), canonical order."""
    velocity_rad_s: Array
    world_from_body_wxyz: Array
    linear_vel_of_body_in_world_m_s: Array
    angular_vel_of_body_in_world_rad_s: Array
    last_action: NDArray[np.float32]
    """Shape (12,), policy order."""


@dataclass(frozen=True)
class RolloutCase:
    """One simulated run: where it starts, what it is told, and the noise that its policy sees."""

    sequence: str
    start: StartState
    velocity_command: Array
    """One a policy tick, shape (n_ticks, 3)."""
    observation_noise: NDArray[np.float32] | None = None
    """Shape (n_ticks, N_OBSERVATION); None for none. The same for every candidate."""


@dataclass(frozen=True)
class RolloutOptions:
    """How to simulate."""

    timestep_s: float = 0.002
    foot_friction: float = 0.8
    contact_time_constant_s: float = 0.02
    """MuJoCo takes at least two time steps."""
    n_threads: int = 1


@dataclass(frozen=True)
class Rollouts:
    """What came out, for each candidate and case; ticks beyond a case's own length are NaN."""

    features: NDArray[np.float32]
    """Shape (n_candidates, n_cases, n_ticks, 36), N·m."""
    fallen_tick: NDArray[np.intp]
    """First tick after a fall, n_ticks where there is none. Shape (n_candidates, n_cases)."""
    torque_nm: NDArray[np.float32]
    """Applied torque at each tick, canonical order, shape (n_candidates, n_cases, n_ticks, 12)."""
    linear_vel_of_body_in_body_m_s: NDArray[np.float32]
    """Shape (n_candidates, n_cases, n_ticks, 3)."""


def roll_out(
    effects: Sequence[Effect], n_candidates: int, cases: Sequence[RolloutCase], policy: Policy, options: RolloutOptions
) -> Rollouts:
    """Simulate every case for every candidate; set-points are kept within the joint stops, as on the robot.

    A candidate's results do not depend, not in one bit, on the other candidates, their number or the threads: the
    network runs on one candidate at a time, in batches of equal size.

    Args:
        effects: Effects whose per-simulation values have shape (n_candidates · len(cases), 1), candidates outermost.
        n_candidates: Number of candidates.
        cases: What each candidate is put through.
        policy: The policy that ran on the robot.
        options: How to simulate.
    """
    n_cases, n_ticks = len(cases), max(len(c.velocity_command) for c in cases)
    n_sims = n_candidates * n_cases
    plant = _started_plant(effects, n_candidates, cases, options)
    commands = np.stack([_padded(c.velocity_command, n_ticks) for c in cases])
    noise = np.stack([_noise(c, n_ticks) for c in cases])
    order, gains = policy.policy_from_canonical, policy.gains()
    last_action = np.tile(np.stack([c.start.last_action for c in cases]), (n_candidates, 1))
    substeps = control_substeps(n_ticks, policy.contract.rate_hz, options.timestep_s)

    features = np.full((n_sims, n_ticks, 3 * facts.N_JOINTS), np.nan, dtype=np.float32)
    torque = np.full((n_sims, n_ticks, facts.N_JOINTS), np.nan, dtype=np.float32)
    velocity = np.full((n_sims, n_ticks, 3), np.nan, dtype=np.float32)
    fallen = np.full(n_sims, n_ticks, dtype=np.intp)
    for tick in range(n_ticks):
        position, joint_velocity = plant.joint_position_rad, plant.joint_velocity_rad_s
        observation = build_observation(
            world_from_body_wxyz=plant.world_from_body_wxyz,
            linear_vel_of_body_in_world_m_s=plant.linear_vel_of_body_in_world_m_s,
            angular_vel_of_body_in_world_rad_s=plant.angular_vel_of_body_in_world_rad_s,
            velocity_command=np.tile(commands[:, tick], (n_candidates, 1)),
            position_rad=position[:, order],
            velocity_rad_s=joint_velocity[:, order],
            last_action=last_action,
            default_position_rad=policy.default_position_rad,
        ).astype(np.float32)
        observation += np.tile(noise[:, tick], (n_candidates, 1))
        action = np.concatenate([_act(policy, block) for block in np.split(observation, n_candidates)])
        features[:, tick] = control_law_features(
            position_rad=observed(observation, "joint_position_offset_rad")[:, policy.canonical_from_policy]
            + default_pose_rad(policy),
            velocity_rad_s=observed(observation, "joint_velocity_rad_s")[:, policy.canonical_from_policy],
            action=action,
            contract=policy.contract,
        )
        velocity[:, tick] = observed(observation, "linear_vel_of_body_in_body_m_s")
        fallen = np.where(is_fallen(observation) & (fallen == n_ticks), tick, fallen)
        last_action = action
        plant.command(
            ServoCommand(
                position_rad=np.clip(policy.setpoint_rad(action), facts.POSITION_LOW_RAD, facts.POSITION_HIGH_RAD),
                kp_nm_per_rad=gains.kp_nm_per_rad,
                kd_nm_s_per_rad=gains.kd_nm_s_per_rad,
            )
        )
        plant.advance(int(substeps[tick]))
        torque[:, tick] = plant.applied_torque_nm
    features[plant.diverged] = np.nan
    for i, case in enumerate(cases):
        features.reshape(n_candidates, n_cases, n_ticks, -1)[:, i, len(case.velocity_command) :] = np.nan
    shape = (n_candidates, n_cases)
    return Rollouts(
        features=features.reshape(*shape, n_ticks, -1),
        fallen_tick=fallen.reshape(shape),
        torque_nm=torque.reshape(*shape, n_ticks, -1),
        linear_vel_of_body_in_body_m_s=velocity.reshape(*shape, n_ticks, -1),
    )


def control_substeps(n_ticks: int, rate_hz: float, timestep_s: float) -> NDArray[np.intp]:
    """Physics steps in each control period, on an absolute schedule: at 50 Hz, 3 ms steps come as 6, 7, 7 and so on."""
    ends = np.floor(np.arange(n_ticks + 1) / (rate_hz * timestep_s) + 1e-9)
    return np.diff(ends).astype(np.intp)


def in_whole_steps(effect: Effect, timestep_s: float) -> Effect:
    """A command delay brought to the nearest number of steps: the plant itself would always take the next one."""
    if not isinstance(effect, CommandDelay):
        return effect
    steps = np.round(np.asarray(effect.delay_s, dtype=np.float64) / timestep_s)
    delay_s = steps * timestep_s
    return replace(effect, delay_s=float(delay_s) if delay_s.ndim == 0 else delay_s)


def standing_height_m(start: StartState) -> float:
    """Height of the body's origin at which the lowest foot just touches level ground."""
    feet = rotate_wxyz(start.world_from_body_wxyz[None, :], foot_position_in_body_m(start.position_rad))
    return float(facts.FOOT_RADIUS_M - np.min(np.asarray(feet)[..., 2]))


def default_pose_rad(policy: Policy) -> Array:
    """The policy's default joint pose in canonical order, shape (12,)."""
    return np.asarray(policy.default_position_rad[policy.canonical_from_policy])


def _started_plant(
    effects: Sequence[Effect], n_candidates: int, cases: Sequence[RolloutCase], options: RolloutOptions
) -> Plant:
    mjcf = MjcfOptions(
        timestep_s=options.timestep_s,
        foot_friction=options.foot_friction,
        contact_solref=(options.contact_time_constant_s, 1.0),
        cone="elliptic",
        collision="feet",
    )
    plant = Plant(
        [in_whole_steps(e, options.timestep_s) for e in effects],
        n_candidates * len(cases),
        PlantOptions(mjcf=mjcf, n_threads=options.n_threads, on_divergence="flag"),
    )
    starts = [c.start for c in cases]

    def each(name: str) -> Array:
        return np.tile(np.stack([getattr(s, name) for s in starts]), (n_candidates, 1))

    height = np.tile([standing_height_m(s) for s in starts], n_candidates)
    attitude = each("world_from_body_wxyz")
    attitude /= np.linalg.norm(attitude, axis=1, keepdims=True)
    inverse = attitude * np.array([1.0, -1.0, -1.0, -1.0])
    plant.reset(
        position_of_body_in_world_m=np.stack([0.0 * height, 0.0 * height, height], axis=1),
        world_from_body_wxyz=attitude,
        joint_position_rad=each("position_rad"),
        linear_vel_of_body_in_world_m_s=each("linear_vel_of_body_in_world_m_s"),
        angular_vel_of_body_in_body_rad_s=np.asarray(rotate_wxyz(inverse, each("angular_vel_of_body_in_world_rad_s"))),
        joint_velocity_rad_s=each("velocity_rad_s"),
    )
    return plant


def _act(policy: Policy, observation: NDArray[np.float32]) -> NDArray[np.float32]:
    if policy.session.get_inputs()[0].shape[0] == 1:
        return np.concatenate([policy.act(row[None, :]) for row in observation])
    return policy.act(observation)


def _padded(command: Array, n_ticks: int) -> Array:
    return np.concatenate([command, np.repeat(command[-1:], n_ticks - len(command), axis=0)])


def _noise(case: RolloutCase, n_ticks: int) -> NDArray[np.float32]:
    noise = np.zeros((n_ticks, N_OBSERVATION), dtype=np.float32)
    if case.observation_noise is not None:
        noise[: len(case.observation_noise)] = case.observation_noise
    return noise
