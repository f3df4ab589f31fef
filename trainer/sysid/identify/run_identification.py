"""One identification from logs to files, with progress: what the command does, for programs too."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from spot_model.errors import BadInputError
from spot_model.policy.policy import load_policy
from trainer.sysid.identify.identify import identify, prepare
from trainer.sysid.identify.progress import SearchProgress
from trainer.sysid.identify.report import summary, text_table, write_report
from trainer.sysid.identify.result import MODEL_NAME, ResultData, check_out_folder, write_result
from trainer.sysid.logs.read_logs import LogSet
from trainer.sysid.search.config import SysidConfig
from trainer.sysid.search.problem import Problem
from trainer.sysid.search.search import Generation
from trainer.sysid.simulation.engine import Engine, LocalEngine, RayEngine

CHECKPOINT_NAME = "search.jsonl"
REPORT_NAME = "report.html"


def run_identification(
    logs: LogSet,
    policy: Path,
    config: SysidConfig,
    out: Path,
    *,
    resume: bool = False,
    workers: int = 2,
    ray: bool = False,
    ray_address: str | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> ResultData:
    """Identify, and write result, model, noise, delays and report into ``out``.

    Raises:
        BadInputError: ``out`` holds an earlier result, or an unfinished search that ``resume`` does not ask for.
    """
    check_out_folder(out)
    checkpoint = out / CHECKPOINT_NAME
    if checkpoint.exists() and not resume:
        raise BadInputError(f"folder {out} holds an unfinished search; give --resume to go on, or another --out folder")
    if resume and not checkpoint.exists():
        raise BadInputError(f"folder {out} holds no unfinished search; leave --resume out to start one")
    out.mkdir(parents=True, exist_ok=True)
    preparation = prepare(logs, load_policy(policy), policy.read_bytes(), config)
    problem = preparation.problem
    progress = SearchProgress(config.search.generations)

    def show(generation: Generation) -> None:
        progress.update(generation.index + 1, min(problem.score(r) for r in generation.results))

    try:
        with _engine(problem, workers, ray=ray, ray_address=ray_address) as engine:
            found = identify(preparation, config, engine, checkpoint, show)
    finally:
        progress.stop()
    data = write_result(found, config, out)
    write_report(found, data, out / REPORT_NAME)
    say(text_table(data.parameters))
    say(summary(data))
    say(f"model {out / MODEL_NAME}  report {out / REPORT_NAME}")
    return data


def _engine(problem: Problem, workers: int, *, ray: bool, ray_address: str | None) -> Engine:
    if ray:
        return RayEngine(problem, ray_address)
    return LocalEngine(problem, min(workers, problem_size(problem)))


def problem_size(problem: Problem) -> int:
    """How many workers a problem can feed; more than this many would have nothing to do."""
    return max(1, 4 * len(problem.references))
