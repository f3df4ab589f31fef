"""A whole identification, from logs to files: what logs show directly, search, fit of torques, verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.io.progress import Progress
from spot_model.io.whole import check_new, whole_folder
from spot_model.policy.policy import Policy, load_policy
from spot_model.text import counted
from trainer.signals.recording import record
from trainer.simulate.engine import IN_THIS_PROCESS, Place
from trainer.simulate.generations import Generation
from trainer.simulate.rollout import RolloutOptions
from trainer.sysid.config import CONTACT_CHOICES_S, SysidConfig
from trainer.sysid.logs import LogSet
from trainer.sysid.measured import (
    DirectChange,
    MeasuredDelays,
    ObservationNoise,
    measure_delays,
    observation_noise,
    with_measured,
)
from trainer.sysid.page import report_page
from trainer.sysid.result import MODEL_NAME, OUTPUTS, REPORT_NAME, ResultData, write_result
from trainer.sysid.search import (
    CandidateResult,
    Candidates,
    Problem,
    SearchState,
    build_problem,
    candidates_engine,
    run_search,
)
from trainer.sysid.torque_fit import TorqueFit, fit_torque
from trainer.sysid.torque_model import TorqueModel, TorqueSamples, torque_samples
from trainer.sysid.verdict import CONFIDENCE, ParameterVerdict, judge, score_intervals

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Preparation:
    """What the logs say before anything is simulated, and the problem that remains."""

    logs: LogSet
    noise: ObservationNoise
    delays: MeasuredDelays
    changes: tuple[DirectChange, ...]
    samples: TorqueSamples | None
    problem: Problem
    final: Problem
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
    """Of the initial values, the search's mean, and the identified model; 1 is the floor where there are repeats."""


def prepare(logs: LogSet, policy: Policy, policy_bytes: bytes, config: SysidConfig, device: str = "cpu") -> Preparation:
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

    def posed(robots_per_sequence: int) -> Problem:
        return build_problem(
            space,
            policy_bytes,
            logs.compared,
            options,
            robots_per_sequence=robots_per_sequence,
            weights=config.sequence_weights,
            noise_sigma=policy.with_joints_in_policy_order(noise.sigma) if simulation.sensor_noise else None,
            seed=config.search.seed,
        )

    final = posed(simulation.final_robots_per_sequence)
    if simulation.contact_time_constant_s is None:
        start = space.initial if first is None else space.within_bounds(first.values)
        final, change = with_best_contact(final, start)
        changes = (*changes, change)
    problem = replace(posed(simulation.robots_per_sequence), options=final.options)
    return Preparation(logs, noise, delays, changes, samples, problem, final)


def with_best_contact(problem: Problem, values: Array) -> tuple[Problem, DirectChange]:
    """The same problem with the contact time constant whose score at ``values``, shape (n,), is best."""
    choices = []
    for choice_s in CONTACT_CHOICES_S:
        candidate = replace(problem, options=replace(problem.options, contact_time_constant_s=choice_s))
        choices.append((candidate.score(candidate.evaluate(values[None, :])[0]), choice_s, candidate))
    _, best_s, chosen = min(choices, key=lambda c: c[:2])
    scores = ", ".join(f"{value:.3g} at {1e3 * s:g} ms" for value, s, _ in choices)
    return chosen, DirectChange("contact time constant", best_s, "s", f"the best of {len(choices)} by score: {scores}")


def identify(
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
    verdicts = judge(TorqueModel(space), preparation.samples, fit, mean, intervals)
    chosen = space.within_bounds(np.array([v.value for v in verdicts]))
    names = ("initial", "search", "identified")
    final = preparation.final
    results = final.evaluate(np.stack([space.initial, mean, chosen]))
    scores = {name: final.score(result) for name, result in zip(names, results, strict=True)}
    return Identification(preparation, state, fit, verdicts, space.model_with(chosen), scores)


def summary(data: ResultData) -> str:
    """What was found, in two or three sentences."""
    found = [p for p in data.parameters if p.identified]
    unit = " (1 is the real-versus-real floor)" if data.score_is_over_floor else " (no floor: repeats are missing)"
    score = ", ".join(f"{name} {'diverged' if value is None else f'{value:.2f}'}" for name, value in data.score.items())
    are = "is" if len(found) == 1 else "are"
    return (
        f"{len(found)} of {counted(len(data.parameters), 'parameter')} {are} identified from "
        f"{counted(len(data.logs), 'log')} of {counted(len(data.sequences), 'command sequence')}. Score{unit}: {score}."
    )


def text_table(parameters: Sequence[ParameterVerdict]) -> str:
    """The parameters as lines for a terminal."""
    width = max(len(p.name) for p in parameters)
    lines = [
        f"{p.name:<{width}}  {p.value:9.4g} {p.unit:<6} [{p.low:.4g}, {p.high:.4g}]  {p.source}"
        + ("" if p.identified else f": {p.reason}")
        for p in parameters
    ]
    return "\n".join(lines)


CHECKPOINT_NAME = "search.jsonl"


def run_identification(
    logs: LogSet,
    policy: Path,
    config: SysidConfig,
    out: Path,
    *,
    resume: bool = False,
    place: Place = IN_THIS_PROCESS,
    say: Callable[[str], None] = lambda _: None,
) -> ResultData:
    """Identify, and write result, model, noise, delays and report into ``out``.

    Raises:
        BadInputError: ``out`` holds an earlier result, or an unfinished search that ``resume`` does not ask for.
    """
    check_new(*(out / name for name in OUTPUTS))
    checkpoint = out / CHECKPOINT_NAME
    if checkpoint.exists() and not resume:
        raise BadInputError(f"folder {out} holds an unfinished search; give --resume to go on, or another --out folder")
    if resume and not checkpoint.exists():
        raise BadInputError(f"folder {out} holds no unfinished search; leave --resume out to start one")
    out.mkdir(parents=True, exist_ok=True)
    say(f"measuring noise, delay, inertia and contact in {counted(len(logs.runs), 'log')} …")
    preparation = prepare(logs, load_policy(policy), policy.read_bytes(), config, place.device)
    problem = preparation.problem
    place = replace(place, workers=min(place.workers, useful_workers(problem)))
    with Progress("generations", config.search.generations) as progress, candidates_engine(problem, place) as engine:

        def show(generation: Generation[CandidateResult]) -> None:
            best = min(problem.score(result) for result in generation.results)
            progress.update(generation.index + 1, f"best score of the generation {best:.3f}")
            if generation.index + 1 == config.search.generations:
                say("fitting measured torques and scoring the result …")

        found = identify(preparation, config, engine, checkpoint, show)
    with whole_folder(out) as part:
        data = write_result(found, config, part)
        (part / REPORT_NAME).write_text(report_page(found, data), encoding="utf-8")
    say(text_table(data.parameters))
    say(summary(data))
    say(f"model {out / MODEL_NAME}  report {out / REPORT_NAME}")
    return data


def useful_workers(problem: Problem) -> int:
    """How many workers a problem can feed; more than this many would have nothing to do."""
    return max(1, 4 * len(problem.references))
