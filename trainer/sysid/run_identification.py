"""One identification from logs to files, with progress: what the command does, for programs too."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from spot_model.console.progress import Progress
from spot_model.errors import BadInputError
from spot_model.io.whole import check_new, whole_folder
from spot_model.policy.policy import load_policy
from spot_model.text import counted
from trainer.simulate.engine import IN_THIS_PROCESS, Place
from trainer.simulate.generations import Generation
from trainer.sysid.config import SysidConfig
from trainer.sysid.identify import prepare, search_and_fit
from trainer.sysid.logs import LogSet
from trainer.sysid.page import identification_page, overlays_of
from trainer.sysid.result import MODEL_NAME, OUTPUTS, REPORT_NAME, ResultData, write_result
from trainer.sysid.search import CandidateResult, candidates_engine
from trainer.sysid.verdict import ParameterVerdict

CHECKPOINT_NAME = "search.jsonl"


def identification_summary(data: ResultData) -> str:
    """What was found, in two or three sentences."""
    found = [p for p in data.parameters if p.identified]
    unit = " (1: two real runs)" if data.score_is_over_floor else " (without repeats, it has no scale)"
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
    say(f"measuring noise, delay, inertia and contact in {counted(len(logs.runs), 'log')} …")
    preparation = prepare(logs, load_policy(policy), config, place.device)
    out.mkdir(parents=True, exist_ok=True)
    problem = preparation.problem
    # More would have nothing to do.
    place = replace(place, workers=min(place.workers, 4 * len(problem.references)))
    with Progress("generations", config.search.generations) as progress, candidates_engine(problem, place) as engine:

        def show(generation: Generation[CandidateResult]) -> None:
            best = min(problem.score(result) for result in generation.results)
            progress.update(generation.index + 1, f"best score of the generation {best:.3f}")
            if generation.index + 1 == config.search.generations:
                say("fitting measured torques and scoring the result …")

        found = search_and_fit(preparation, config, engine, checkpoint, show)
    with whole_folder(out) as part:
        data = write_result(found, config, part)
        (part / REPORT_NAME).write_text(identification_page(data, overlays_of(found)), encoding="utf-8")
    say(text_table(data.parameters))
    say(identification_summary(data))
    say(f"model {out / MODEL_NAME}  report {out / REPORT_NAME}")
    return data
