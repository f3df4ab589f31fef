"""CMA-ES over the gains, scored by steady running on every robot and by random starts; in one or several processes."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from cmaes import CMA

from spot_model.policy.contract import sha256_hex
from spot_model.policy.policy import Policy, policy_from_bytes
from spot_model.robot.facts import Array
from trainer.evaluate.setting import Setting
from trainer.evaluate.trials import random_commands
from trainer.ppo.checkpoint_policy import policy_of_layers, read_layers
from trainer.refine.config import RefineConfig, RefinedRobotConfig, StartConfig, WeightConfig
from trainer.refine.gains import gains_in, gains_of
from trainer.simulate.engine import IN_THIS_PROCESS, Engine, Place, Tell
from trainer.simulate.generations import Generation, Generations
from trainer.simulate.walks import record_walks, walk_at

TRACKED_UP_TO_M_S = 5.0


@dataclass(frozen=True)
class Steady:
    """One robot model at all steady commands."""

    duty_spread: tuple[float, ...]
    """By forward speed, as far as it is tracked."""
    forward_error_m_s: float
    other_error: float
    top_speed_m_s: float
    """Reached at the highest commanded speed."""
    falls: int


@dataclass(frozen=True)
class Judgement:
    """All that is known of a candidate."""

    score: float
    """Lower is better; 0 where nothing falls short."""
    steady: tuple[Steady, ...]
    falls: tuple[int, ...]
    """Starts that ended in a fall, by start config."""


def judge_gains(policy: Policy, config: RefineConfig, seed: int) -> Judgement:
    """Run a policy on every robot and through the random starts."""
    steady = tuple(run_steadily(policy, robot, config) for robot in config.robots)
    falls = tuple(run_starts(policy, config.robots[0], start, seed + i) for i, start in enumerate(config.starts))
    score = sum(score_steady(s, config.weights) for s in steady)
    score += sum(c.weight * n / c.robots for c, n in zip(config.starts, falls, strict=True))
    return Judgement(score=float(score), steady=steady, falls=falls)


def run_steadily(policy: Policy, robot: RefinedRobotConfig, config: RefineConfig) -> Steady:
    """One robot a command, from rest, a ramp and some seconds at the command."""
    speeds = np.array(config.speeds_m_s)
    target = np.concatenate(
        [np.stack([speeds, 0 * speeds, 0 * speeds], axis=-1), np.array(config.others).reshape(-1, 3)]
    )
    setting = _setting(policy, robot)
    steady_s = config.ramp_s + config.settle_s
    recording = walk_at(policy, setting.plant(len(target)), target, config.ramp_s, steady_s + config.watch_s)
    span = recording.ticks(steady_s, steady_s + config.watch_s)
    error = np.nan_to_num(recording.tracking_error(span), nan=1.0)
    tracked = np.flatnonzero(speeds <= TRACKED_UP_TO_M_S)
    return Steady(
        duty_spread=tuple(recording.gait(span, int(i))["duty_spread"] for i in tracked),
        forward_error_m_s=float(error[tracked, 0].mean()) if len(tracked) else 0.0,
        other_error=float(error[len(speeds) :].mean()) if len(config.others) else 0.0,
        top_speed_m_s=float(recording.mean_velocity(span)[int(np.argmax(speeds)), 0]),
        falls=int((~recording.survived).sum()),
    )


def run_starts(policy: Policy, robot: RefinedRobotConfig, start: StartConfig, seed: int) -> int:
    """Falls of randomised starts whose command jumps once."""
    setting = replace(_setting(policy, robot), seed=seed)
    drawn = {"added_body_mass_kg": start.added_body_mass_kg, "foot_friction": start.foot_friction}
    ranges = setting.randomisation.model_copy(update=drawn)
    setting = replace(setting, randomisation=ranges)
    rng = np.random.default_rng(seed)
    plant = setting.random_plant(start.robots, rng, robot.robots())
    first, second = (random_commands(setting, start.robots, rng, top_m_s=start.top_m_s) for _ in range(2))
    jump = round(start.jump_s * policy.contract.rate_hz)
    recording = record_walks(
        policy, plant, lambda k: first if k < jump else second, 2 * jump, noise_sigma=setting.noise_sigma(), rng=rng
    )
    return int((~recording.survived).sum())


def score_steady(steady: Steady, weights: WeightConfig) -> float:
    """What the shortfalls of steady running cost."""
    excess = np.maximum(np.array(steady.duty_spread) - weights.duty_spread_allowed, 0.0)
    duty = weights.duty_spread * float(excess.mean() + excess.max()) if len(excess) else 0.0
    return (
        duty
        + weights.forward_error_per_m_s * steady.forward_error_m_s
        + weights.other_error * steady.other_error
        + weights.top_speed_per_m_s * max(weights.top_speed_wanted_m_s - steady.top_speed_m_s, 0.0)
        + weights.fall * steady.falls
    )


def in_words(judgements: Sequence[Judgement], config: RefineConfig) -> dict[str, Any]:
    """The figures of one policy judged with several seeds: steady running is the same in all, starts are counted."""
    steady = judgements[0].steady
    return {
        "score": round(float(np.mean([j.score for j in judgements])), 3),
        "duty_spread": [round(max(s.duty_spread, default=0.0), 3) for s in steady],
        "forward_error_m_s": [round(s.forward_error_m_s, 3) for s in steady],
        "top_speed_m_s": [round(s.top_speed_m_s, 2) for s in steady],
        "falls": [
            f"{sum(j.falls[i] for j in judgements)} of {start.robots * len(judgements)}"
            for i, start in enumerate(config.starts)
        ],
    }


def _setting(policy: Policy, robot: RefinedRobotConfig) -> Setting:
    return Setting(policy=policy, model=robot.robots()[0], mjcf=robot.mjcf(), n_threads=1)


SCHEMA: Final = "spot-rl/refine-search/2"
FRESH: Final = 1_000_000
"""First seed of the starts on which the outcome is compared with the policy it came from; no generation sees them."""
N_SEEDS: Final = 5


@dataclass(frozen=True)
class RefineProblem:
    """What is searched: a policy's file and what is asked of it."""

    policy: bytes
    config: RefineConfig

    def policy_with(self, values: Array) -> Policy:
        """The candidate with these gains; zeros give the policy itself."""
        contract = policy_from_bytes(self.policy, source="policy").contract
        layers = gains_in(read_layers(self.policy, "policy"), gains_of(contract.joint_names), values)
        return policy_of_layers(layers, contract, "refinement")

    def judge(self, values: Array, seed: int) -> Judgement:
        """How good the candidate is."""
        return judge_gains(self.policy_with(values), self.config, seed)


def search_gains(
    problem: RefineProblem,
    checkpoint: Path,
    *,
    place: Place = IN_THIS_PROCESS,
    tell: Callable[[Generation[float]], None] = lambda _: None,
) -> Array:
    """Search, or go on where the checkpoint ends; the outcome does not depend on where it was cut, or on ``place``.

    Returns:
        The mean of the last search distribution, in units of the gains' scales.

    Raises:
        BadInputError: The checkpoint is damaged or belongs to another search.
    """
    config = problem.config
    n = len(gains_of(policy_from_bytes(problem.policy, source="policy").contract.joint_names))
    optimiser = CMA(mean=np.zeros(n), sigma=config.sigma, seed=config.seed, population_size=config.population)
    searched = config.model_dump(mode="json", exclude={"generations"})
    with Engine(_judge, problem, place) as engine:
        Generations[float](
            path=checkpoint,
            head={"schema": SCHEMA, "policy": sha256_hex(problem.policy), "search": searched},
            evaluate=lambda index, points: [j.score for j in engine.map([(p, _seed(config, index)) for p in points])],
            score=float,
            to_data=float,
            from_data=float,
        ).run(optimiser, config.generations, tell)
    mean: Array = np.asarray(optimiser.mean, dtype=np.float64)
    return mean


def compare_candidates(
    problem: RefineProblem, values: Array, *, place: Place = IN_THIS_PROCESS
) -> tuple[list[Judgement], list[Judgement]]:
    """The policy and the candidate on starts that the search did not see, one judgement a seed."""
    both = [np.zeros_like(values)] * N_SEEDS + [values] * N_SEEDS
    with Engine(_judge, problem, place) as engine:
        judged = engine.map([(point, FRESH + 10 * (i % N_SEEDS)) for i, point in enumerate(both)])
    return judged[:N_SEEDS], judged[N_SEEDS:]


def _seed(config: RefineConfig, index: int) -> int:
    return config.seed * 10_000 + 10 * index


def _judge(problem: RefineProblem, job: tuple[Array, int], _: Tell) -> Judgement:
    if multiprocessing.parent_process() is not None:
        torch.set_num_threads(1)
    return problem.judge(*job)
