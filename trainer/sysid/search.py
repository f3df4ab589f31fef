"""The paper's search: a problem that other processes can evaluate, and CMA-ES over its unit cube."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from cmaes import CMA

from spot_log import Run
from spot_model.policy.policy import Policy, policy_from_bytes
from spot_model.robot.facts import Array
from trainer.signals.distances import SequenceReference, features_of_observations, score_of_distances
from trainer.signals.policy_ticks import start_of
from trainer.simulate.engine import IN_THIS_PROCESS, Engine, Place, Tell
from trainer.simulate.generations import Generation, Generations
from trainer.simulate.rollout import RolloutCase, RolloutOptions, Rollouts, roll_out
from trainer.sysid.config import SearchConfig, SearchSpace
from trainer.sysid.logs import sequence_of_log


@dataclass(frozen=True)
class CandidateResult:
    """What one candidate's simulations gave."""

    distances: tuple[Array, ...]
    """For each sequence, shape (n_simulated, n_real, 2); NaN where a simulation diverged."""
    fallen_share: float
    """Share of its simulated runs that fell."""

    def to_data(self) -> dict[str, Any]:
        """Plain data for JSON; NaN becomes null."""
        lists = [[[[_or_null(x) for x in pair] for pair in row] for row in d.tolist()] for d in self.distances]
        return {"distances": lists, "fallen_share": self.fallen_share}

    @staticmethod
    def from_data(data: dict[str, Any]) -> CandidateResult:
        """The inverse of :meth:`to_data`, bit for bit."""
        return CandidateResult(tuple(np.array(d, dtype=np.float64) for d in data["distances"]), data["fallen_share"])


@dataclass(frozen=True)
class SysidProblem:
    """What is searched, what it is compared with, and how it is simulated."""

    space: SearchSpace
    policy_bytes: bytes
    cases: tuple[tuple[RolloutCase, ...], ...]
    """For each sequence, one case a simulated robot."""
    references: tuple[SequenceReference, ...]
    sequence_weights: tuple[float, ...]
    """For each sequence, sum 1."""
    options: RolloutOptions

    @cached_property
    def policy(self) -> Policy:
        """The policy that ran on the robot."""
        return policy_from_bytes(self.policy_bytes, source="policy")

    def __getstate__(self) -> dict[str, Any]:
        # An inference session cannot travel to another process; it is loaded anew there.
        return {key: value for key, value in self.__dict__.items() if key != "policy"}

    def digest(self) -> str:
        """SHA-256 of all that decides a result, hexadecimal."""
        h = hashlib.sha256(self.policy_bytes)
        h.update(repr((self.space.model.to_data(), self.space.parameters, self.sequence_weights)).encode())
        o = self.options
        h.update(repr((o.timestep_s, o.foot_friction, o.contact_time_constant_s)).encode())
        h.update(b"" if o.device == "cpu" else b"on a GPU")
        for cases, reference in zip(self.cases, self.references, strict=True):
            for case in cases:
                start = case.start
                for array in (start.position_rad, start.velocity_rad_s, start.world_from_body_wxyz):
                    h.update(np.ascontiguousarray(array).tobytes())
                h.update(np.ascontiguousarray(case.velocity_command).tobytes())
            for run in reference.real:
                h.update(np.ascontiguousarray(run.sorted_features).tobytes())
        return h.hexdigest()

    def simulate(self, values: Array) -> Rollouts:
        """Roll out candidates, shape (k, n_parameters); cases of all sequences in order."""
        flat = [case for cases in self.cases for case in cases]
        return roll_out(self.space.effects(values, len(flat)), len(values), flat, self.policy, self.options)

    def evaluate(self, values: Array) -> list[CandidateResult]:
        """Simulate and measure candidates, shape (k, n_parameters), physical values."""
        rollouts = self.simulate(values)
        by_sequence, first = [], 0
        for cases, reference in zip(self.cases, self.references, strict=True):
            runs = [
                reference.distances_of_many(rollouts.features[:, first + i, : len(case.velocity_command)])
                for i, case in enumerate(cases)
            ]
            by_sequence.append(np.stack(runs, axis=1))
            first += len(cases)
        fallen = (rollouts.fallen_tick < rollouts.features.shape[2]).mean(axis=1)
        return [CandidateResult(tuple(d[k] for d in by_sequence), float(share)) for k, share in enumerate(fallen)]

    def score(self, result: CandidateResult) -> float:
        """One number: 1 at the real-versus-real floor; infinite where a simulation diverged."""
        parts = zip(result.distances, self.references, self.sequence_weights, strict=True)
        total = sum(weight * float(score_of_distances(d, reference.scale)) for d, reference, weight in parts)
        return total if np.isfinite(total) else float("inf")


def _or_null(value: float) -> float | None:
    return value if np.isfinite(value) else None


def build_problem(
    space: SearchSpace,
    policy_bytes: bytes,
    runs: Sequence[Run],
    options: RolloutOptions,
    *,
    robots_per_sequence: int,
    weights: dict[str, float],
    seed: int = 0,
) -> SysidProblem:
    """Group runs by command sequence, in order of their names, and prepare all that an evaluation needs.

    Args:
        space: What is searched.
        policy_bytes: The policy's ONNX file.
        runs: Real runs, all of that policy.
        options: How to simulate.
        robots_per_sequence: Simulated robots a sequence; they start as its real runs did.
        weights: Weight of a sequence by name, 1 where absent.
        seed: Seed of the measures' random features.
    """
    policy = policy_from_bytes(policy_bytes, source="policy")
    names = sorted({sequence_of_log(run) for run in runs})
    cases, references = [], []
    for name in names:
        group = sorted((run for run in runs if sequence_of_log(run) == name), key=lambda run: run.header.repeat)
        features = [features_of_observations(r.ticks.observation, r.ticks.action, policy) for r in group]
        references.append(SequenceReference.build(name, features, seed))
        starts = [group[i % len(group)] for i in range(robots_per_sequence)]
        cases.append(tuple(RolloutCase(name, start_of(run), run.ticks.velocity_command) for run in starts))
    raw = np.array([weights.get(name, 1.0) for name in names])
    return SysidProblem(
        space=space,
        policy_bytes=policy_bytes,
        cases=tuple(cases),
        references=tuple(references),
        sequence_weights=tuple(float(w) for w in raw / raw.sum()),
        options=options,
    )


Candidates = Engine[SysidProblem, Array, list[CandidateResult]]

SCHEMA: Final = "spot-rl/sysid-search/2"
EDGE: Final = 1e-6
"""The search starts at least so far inside the unit cube, which the optimiser's bounds must contain."""


@dataclass(frozen=True)
class SearchState:
    """All that has been searched."""

    generations: tuple[Generation[CandidateResult], ...]
    mean_unit: Array
    """Mean of the search distribution, shape (n,)."""
    sigma: float
    """Its step size, as a share of the bounds."""

    def units(self) -> Array:
        """All points, shape (n_evaluations, n)."""
        return np.concatenate([g.points for g in self.generations])

    def results(self) -> list[CandidateResult]:
        """All results, in the order of :meth:`units`."""
        return [r for g in self.generations for r in g.results]


def candidates_engine(problem: SysidProblem, place: Place = IN_THIS_PROCESS) -> Candidates:
    """Where candidates of a problem are evaluated."""
    return Engine(_evaluate, problem, place)


def _evaluate(problem: SysidProblem, values: Array, _: Tell) -> list[CandidateResult]:
    return problem.evaluate(values)


def evaluate_candidates(engine: Candidates, values: Array) -> list[CandidateResult]:
    """Results of candidates, shape (k, n_parameters), in their order."""
    parts = np.array_split(values, engine.parts(len(values)))
    return [result for part in engine.map(parts) for result in part]


def run_search(
    problem: SysidProblem,
    engine: Candidates,
    config: SearchConfig,
    checkpoint: Path,
    on_generation: Callable[[Generation[CandidateResult]], None] = lambda _: None,
) -> SearchState:
    """Search, or go on where the checkpoint ends; the outcome is the same bit for bit.

    Raises:
        BadInputError: The checkpoint belongs to another search.
    """
    n = problem.space.n
    start = np.clip(problem.space.unit_of_values(problem.space.initial), EDGE, 1.0 - EDGE)
    bounds = np.tile([0.0, 1.0], (n, 1))
    optimiser = CMA(mean=start, sigma=config.sigma, bounds=bounds, seed=config.seed, population_size=config.population)
    search = Generations(
        path=checkpoint,
        head={"schema": SCHEMA, "problem": problem.digest(), "search": config.model_dump(exclude={"generations"})},
        evaluate=lambda _, unit: evaluate_candidates(engine, problem.space.values_of_unit(unit)),
        score=problem.score,
        to_data=CandidateResult.to_data,
        from_data=CandidateResult.from_data,
    )
    generations = search.run(optimiser, config.generations, on_generation)
    return SearchState(generations, np.clip(optimiser.mean, 0.0, 1.0), float(optimiser._sigma))
