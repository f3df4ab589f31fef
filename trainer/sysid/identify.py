"""The whole identification: what logs show directly, the paper's search, the fit of torques, and the verdict."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy
from spot_model.robot.facts import Array
from trainer.signals.recording import record
from trainer.simulate.generations import Generation
from trainer.simulate.rollout import RolloutOptions
from trainer.sysid.config import CONTACT_CHOICES_S, SysidConfig
from trainer.sysid.logs import LogSet
from trainer.sysid.measured import (
    MeasuredData,
    MeasuredDelays,
    ObservationNoise,
    measure_delays,
    observation_noise,
    with_measured,
)
from trainer.sysid.search import CandidateResult, Candidates, SearchState, SysidProblem, build_problem, run_search
from trainer.sysid.torque_fit import TorqueFit, fit_torque
from trainer.sysid.torque_model import TorqueModel, TorqueSamples, torque_samples
from trainer.sysid.verdict import CONFIDENCE, ParameterVerdict, judge_parameters, score_intervals


@dataclass(frozen=True)
class Preparation:
    """What the logs say before anything is simulated, and the problem that remains."""

    logs: LogSet
    noise: ObservationNoise
    delays: MeasuredDelays
    changes: tuple[MeasuredData, ...]
    samples: TorqueSamples | None
    problem: SysidProblem
    final: SysidProblem
    """The same with more simulated robots, for the scores that are stated."""


@dataclass(frozen=True)
class Identification:
    """All that was found."""

    preparation: Preparation
    search: SearchState
    fit: TorqueFit | None
    verdicts: tuple[ParameterVerdict, ...]
    model: RobotModel
    """The identified model."""
    scores: dict[str, float]
    """Scores of the initial values, the search's mean, and the identified model; 1 is the floor where there are
    repeats.
    """


def prepare(logs: LogSet, policy: Policy, config: SysidConfig, device: str = "cpu") -> Preparation:
    """Read off what needs no search, and set up the search, whose candidates are simulated on ``device``."""
    space, simulation = config.space(), config.simulation
    recordings = [record(run) for run in logs.runs]
    noise, delays = observation_noise(recordings), measure_delays(logs.runs)
    with_load = [log for log in recordings if np.isfinite(log.load_nm).any()]
    samples = torque_samples(with_load) if with_load else None
    if samples is not None and not len(samples):
        samples = None
    first = None
    if samples is not None and simulation.measured_inertia:
        first = fit_torque(TorqueModel(space), samples, [space.initial], np.random.default_rng(config.search.seed))
    space, changes = with_measured(
        space, delays, first, use_delay=simulation.measured_delay, use_inertia=simulation.measured_inertia
    )
    options = RolloutOptions(
        simulation.timestep_s,
        simulation.foot_friction,
        simulation.contact_time_constant_s or CONTACT_CHOICES_S[-1],
        device=device,
    )

    def posed(robots_per_sequence: int) -> SysidProblem:
        return build_problem(
            space,
            policy.file_bytes,
            logs.compared,
            options,
            robots_per_sequence=robots_per_sequence,
            weights=config.sequence_weights,
            seed=config.search.seed,
        )

    final = posed(simulation.final_robots_per_sequence)
    if simulation.contact_time_constant_s is None:
        start = space.initial if first is None else space.within_bounds(first.values)
        final, change = with_best_contact(final, start)
        changes = (*changes, change)
    problem = replace(posed(simulation.robots_per_sequence), options=final.options)
    return Preparation(logs, noise, delays, changes, samples, problem, final)


def with_best_contact(problem: SysidProblem, values: Array) -> tuple[SysidProblem, MeasuredData]:
    """The same problem with the contact time constant whose score at ``values``, shape (n,), is best."""
    choices = []
    for choice_s in CONTACT_CHOICES_S:
        candidate = replace(problem, options=replace(problem.options, contact_time_constant_s=choice_s))
        choices.append((candidate.score(candidate.evaluate(values[None, :])[0]), choice_s, candidate))
    _, best_s, chosen = min(choices, key=lambda c: c[:2])
    scores = ", ".join(f"{value:.3g} at {1e3 * s:g} ms" for value, s, _ in choices)
    source = f"the best of {len(choices)} by score: {scores}"
    return chosen, MeasuredData(what="contact time constant", value=best_s, unit="s", source=source)


def search_and_fit(
    preparation: Preparation,
    config: SysidConfig,
    engine: Candidates,
    checkpoint: Path,
    on_generation: Callable[[Generation[CandidateResult]], None] = lambda _: None,
) -> Identification:
    """Search, fit, judge and score.

    Args:
        preparation: From :func:`prepare`.
        config: The configuration.
        engine: Where candidates are evaluated.
        checkpoint: File of the search's generations.
        on_generation: Called after each generation.
    """
    problem = preparation.problem
    space = problem.space
    state = run_search(problem, engine, config.search, checkpoint, on_generation)
    mean = space.values_of_unit(state.mean_unit)
    rng = np.random.default_rng(config.search.seed)
    intervals = score_intervals(problem, state.units(), state.results(), CONFIDENCE, rng)
    fit = None
    if preparation.samples is not None:
        fit = fit_torque(TorqueModel(space), preparation.samples, [mean, space.initial], rng)
    verdicts = judge_parameters(TorqueModel(space), preparation.samples, fit, mean, intervals)
    chosen = space.within_bounds(np.array([v.value for v in verdicts]))
    names = ("initial", "search", "identified")
    final = preparation.final
    results = final.evaluate(np.stack([space.initial, mean, chosen]))
    scores = {name: final.score(result) for name, result in zip(names, results, strict=True)}
    return Identification(preparation, state, fit, verdicts, space.model_with(chosen), scores)
