"""Many closed-loop runs of a policy in one batch of simulations, one candidate for each group of simulations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from spot_model.effects.base import Effect
from spot_model.effects.commands import CommandDelay
from spot_model.plant.closed_loop import ClosedLoop, StartState, put_at, schedule_by_rate
from spot_model.plant.plant import Plant, PlantOptions
from spot_model.policy.observation import is_fallen
from spot_model.policy.policy import Policy
from spot_model.robot.arrays import namespace_of, on_host
from spot_model.robot.facts import Array
from spot_model.robot.mjcf import MjcfOptions
from spot_model.robot.rotation import AnyArray
from trainer.signals.distances import features_of_observations
from trainer.simulate.recorded_loop import padded


@dataclass(frozen=True)
class RolloutCase:
    """One simulated run: where it starts and what it is told."""

    sequence: str
    start: StartState
    velocity_command: Array
    """One a policy tick, shape (n_ticks, 3)."""


@dataclass(frozen=True)
class RolloutOptions:
    """How to simulate."""

    timestep_s: float = 0.002
    foot_friction: float = 0.8
    contact_time_constant_s: float = 0.02
    """MuJoCo takes at least two time steps."""
    n_threads: int = 1
    device: str = "cpu"
    """Where the physics runs: "cpu" or a GPU."""


@dataclass(frozen=True)
class Rollouts:
    """What came out, for each candidate and case; ticks beyond a case's own length are NaN."""

    features: AnyArray
    """Shape (n_candidates, n_cases, n_ticks, 36), float32, N·m; a tensor if the physics ran on a GPU, as the others."""
    fallen_tick: NDArray[np.intp]
    """First tick after a fall, n_ticks where there is none. Shape (n_candidates, n_cases)."""
    torque_nm: AnyArray
    """Applied torque at each tick, canonical order, shape (n_candidates, n_cases, n_ticks, 12)."""


def roll_out(
    effects: Sequence[Effect], n_candidates: int, cases: Sequence[RolloutCase], policy: Policy, options: RolloutOptions
) -> Rollouts:
    """Simulate every case for every candidate; set-points are kept within the joint stops, as on the robot.

    On the cores a candidate's results do not depend, not in one bit, on the other candidates, their number or the
    threads: the network runs on one candidate at a time, in batches of equal size.

    Args:
        effects: Effects whose per-simulation values have shape (n_candidates · len(cases), 1), candidates outermost.
        n_candidates: Number of candidates.
        cases: What each candidate is put through.
        policy: The policy that ran on the robot.
        options: How to simulate.
    """
    n_cases, n_ticks = len(cases), max(len(c.velocity_command) for c in cases)
    plant, last_action = _started_plant(effects, n_candidates, cases, options)
    commands = np.stack([padded(c.velocity_command, n_ticks) for c in cases])
    told = np.tile(commands, (n_candidates, 1, 1))
    xp = namespace_of(plant.joint_position_rad)

    def act(seen: AnyArray) -> AnyArray:
        return np.concatenate([policy.act(block) for block in np.split(seen, n_candidates)])

    loop = ClosedLoop(plant, policy, see=lambda _, seen: xp.astype(seen, xp.float32), act=act if xp is np else None)
    schedule = schedule_by_rate(n_ticks, policy.contract.rate_hz, options.timestep_s)
    kept = [
        (tick.observation, tick.action, plant.applied_torque_nm)
        for tick in loop.run(lambda t: told[:, t], schedule, last_action)
    ]
    observation, action, torque = (xp.stack(list(column), axis=1) for column in zip(*kept, strict=True))
    features = features_of_observations(observation, action, policy)
    has_fallen = on_host(is_fallen(observation))
    fallen = np.where(has_fallen.any(axis=1), has_fallen.argmax(axis=1), n_ticks)
    features[plant.diverged] = np.nan
    by_case = features.reshape(n_candidates, n_cases, n_ticks, -1)
    for i, case in enumerate(cases):
        by_case[:, i, len(case.velocity_command) :] = np.nan
    shape = (n_candidates, n_cases, n_ticks, -1)
    return Rollouts(
        features=by_case, fallen_tick=fallen.reshape(shape[:2]), torque_nm=xp.astype(torque, xp.float32).reshape(shape)
    )


def in_whole_steps(effect: Effect, timestep_s: float) -> Effect:
    """A command delay brought to the nearest number of steps: the plant itself would always take the next one."""
    if not isinstance(effect, CommandDelay):
        return effect
    steps = np.round(np.asarray(effect.delay_s, dtype=np.float64) / timestep_s)
    delay_s = steps * timestep_s
    return replace(effect, delay_s=float(delay_s) if delay_s.ndim == 0 else delay_s)


def _started_plant(
    effects: Sequence[Effect], n_candidates: int, cases: Sequence[RolloutCase], options: RolloutOptions
) -> tuple[Plant, NDArray[np.float32]]:
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
        PlantOptions(mjcf=mjcf, device=options.device, n_threads=options.n_threads, on_divergence="flag"),
    )
    return plant, put_at(plant, [c.start for c in cases] * n_candidates)
