"""Test the diagnosis on robots with hidden faults."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from trainer.simulate.engine import EngineName, EngineOption, RayAddress, Workers

app = typer.Typer(no_args_is_help=True, help=__doc__)
case_app = typer.Typer(no_args_is_help=True, help="One case of a run.")
app.add_typer(case_app, name="case")


@app.command()
def run(
    out: Annotated[Path, typer.Option("--out", help="Folder of the run.")],
    cases: Annotated[int, typer.Option("--cases", min=1, max=100_000, help="Number of cases.")] = 800,
    seed: Annotated[
        int | None,
        typer.Option("--seed", min=0, help="Repeat a run, or run a part of one; by default the system draws a seed."),
    ] = None,
    only: Annotated[
        str, typer.Option("--only", help="A part, FIRST:END, such as 0:200; kept for --resume; `score` merges folders.")
    ] = "",
    kind: Annotated[
        list[str] | None, typer.Option("--kind", help="Run only cases of this kind; repeatable, in this order.")
    ] = None,
    workers: Workers = 2,
    resume: Annotated[bool, typer.Option("--resume", help="Continue an interrupted run or part.")] = False,
    reality: Annotated[
        str,
        typer.Option("--reality", help="judging, calibrating, or your own as module:Class."),
    ] = "judging",
    policies: Annotated[
        Path | None, typer.Option("--policies", help="Folder of policies (ONNX); the built-in ones by default.")
    ] = None,
    engine: EngineOption = EngineName.LOCAL,
    ray_address: RayAddress = None,
    until: Annotated[
        float, typer.Option("--until", min=1.0, show_default=False, help="Start no case after this many seconds.")
    ] = 1e9,
    timeout: Annotated[float, typer.Option("--timeout", min=10.0, help="Seconds for one diagnosis.")] = 900.0,
    quick: Annotated[bool, typer.Option("--quick", help="Short runs, for a quick test.")] = False,
    keep_logs: Annotated[bool, typer.Option("--keep-logs", help="Keep the logs given to the diagnosis.")] = False,
) -> None:
    """Draw cases, diagnose their logs in a process that does not know what is hidden, and score."""
    from spot_model.console.progress import Progress
    from spot_model.policy.built_in import FOLDER
    from trainer.simulate.engine import Engine, Place
    from withheld.blind.execution import Job, execute, run_cases
    from withheld.blind.run_folder import begin, go_on
    from withheld.cases import chosen
    from withheld.realities.source import source_of

    policies = policies or FOLDER
    source_of(reality)
    part = _part(only) if only else None
    if resume:
        head = go_on(out, policies, part)
    else:
        head = begin(out, seed, policies, reality=reality, cases=cases, part=part or (0, cases), is_quick=quick)
    typer.echo(f"revision {head.revision}, seed {head.seed}", err=True)
    job = Job(
        number=0,
        seed=head.seed,
        out=out.resolve(),
        policies=policies.resolve(),
        reality=head.reality,
        timeout_s=timeout,
        keep_logs=keep_logs,
        is_quick=head.is_quick,
    )
    # In the order of their numbers, whatever they cost: what is done when a run is stopped is then a fair part.
    numbers = chosen(head.seed, range(*head.part), kind or ())
    jobs = [replace(job, number=n) for n in numbers]
    done = sum(job.is_done for job in jobs)
    progress = Progress("cases", len(jobs), done=done)

    def tell(number: int, text: str) -> None:
        """One more; what failed is always told, and does not count."""
        nonlocal done
        has_failed = text.startswith("failed")
        done += not has_failed
        progress.update(done, f"case {number}: {text}", is_told=has_failed)

    is_ray = engine is EngineName.RAY
    place = Place(max(1, min(workers, len(jobs))), is_ray, ray_address, is_apart=not is_ray)
    try:
        with Engine(execute, None, place) as started:
            left = run_cases(jobs, started, until, tell)
    except KeyboardInterrupt:
        typer.echo(f"interrupted; go on with `spot-rl withheld run --resume --out {out}`", err=True)
        raise typer.Exit(130) from None
    finally:
        progress.stop()
    if left:
        typer.echo(f"{left} cases are left: `spot-rl withheld run --resume --out {out}`", err=True)
    if left < len(jobs):
        _score([out], out)


@app.command()
def score(
    folders: Annotated[list[Path], typer.Argument(help="Folders of one run, or of its parts.")],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for table and page; default: the first folder.")
    ] = None,
) -> None:
    """Score, and write table and page."""
    _score(folders, out or folders[0])


@app.command()
def table(
    folder: Annotated[Path, typer.Argument(help="Folder of a scored run.")],
    beside: Annotated[Path | None, typer.Option("--beside", help="Another run's scores.json.")] = None,
) -> None:
    """Print a scored run's table as Markdown, with its revision and seed."""
    from withheld.scoring.report import markdown

    for line in markdown(folder, beside):
        typer.echo(line)


@app.command()
def pack(
    folder: Annotated[Path, typer.Argument(help="Folder of a run.")],
    file: Annotated[Path, typer.Argument(help="File to write, .tar.gz.")],
    most_mib: Annotated[float, typer.Option("--most-mib", min=0.1, help="Largest size of the file, MiB.")] = 16.0,
) -> None:
    """Pack a run without its reports into one file that can be scored after unpacking."""
    from withheld.blind.run_folder import pack as write

    typer.echo(f"{write(folder, file, most_mib)} cases in {file}")


@case_app.command("open")
def open_case(
    file: Annotated[Path, typer.Argument(help="DIR/NUMBER, a case's folder, or its outcome.json.")],
) -> None:
    """Show one case: what was hidden, what was said, what it scores."""
    from withheld.scoring.reading import show_case

    for line in show_case(file):
        typer.echo(line)


def _score(folders: list[Path], out: Path) -> None:
    from withheld.scoring.report import write_scores

    for line in write_scores(folders, out):
        typer.echo(line)


def _part(only: str) -> tuple[int, int]:
    from spot_model.errors import BadInputError

    first, colon, end = only.partition(":")
    if not colon or not first.isdigit() or not end.isdigit() or not int(first) < int(end):
        raise BadInputError(f"--only {only!r}; allowed: FIRST:END with 0 <= FIRST < END")
    return int(first), int(end)
