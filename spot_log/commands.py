"""Inspect, plot, convert and repair logs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from spot_model.errors import BadInputError
from spot_model.text import plain, plain_lines

app = typer.Typer(no_args_is_help=True, help=__doc__)

LogArgument = Annotated[Path, typer.Argument(help="A log: *.mcap, or *.mcap.active after a crash.", metavar="LOG")]


@app.command()
def info(
    file: LogArgument,
    everything: Annotated[
        bool,
        typer.Option(
            "--all", help="Also show time in each mode, loads by joint, a histogram of delays, and the header."
        ),
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of words.")] = False,
) -> None:
    """Summarise a log: gait, falls, rates, gaps, ages, delays, drops, temperatures, events."""
    from spot_log.page.summary import detail_lines, summary_lines
    from spot_log.read.reader import read_run
    from spot_log.tools.log_info import log_info

    told = log_info(read_run(file))
    if as_json:
        typer.echo(json.dumps(told.to_json(), ensure_ascii=False, indent=2))
    else:
        lines = detail_lines(told) if everything else [told.file, *summary_lines(told)]
        typer.echo(plain_lines("\n".join(lines)))


@app.command()
def export(
    file: LogArgument,
    out: Annotated[Path, typer.Option("--out", help="Folder for the tables, or the bag; nothing is overwritten.")],
    file_format: Annotated[str, typer.Option("--format", help="parquet, csv, or rosbag2.")] = "parquet",
    topics: Annotated[
        str | None,
        typer.Option("--topics", help="Comma-separated: state,imu,command,tick,slow_state,event. All by default."),
    ] = None,
) -> None:
    """Write a log as flat tables, one file a topic, for data frames and plotting programs; or as a ROS 2 bag."""
    from spot_log.read.reader import read_run
    from spot_log.tools.export import export_run, write_rosbag2

    if file_format == "rosbag2":
        typer.echo(write_rosbag2(read_run(file), out))
        return
    chosen = [topic.strip() for topic in topics.split(",") if topic.strip()] if topics else None
    run = read_run(file)
    for text in run.damage:
        typer.echo(plain(f"{file}: {text}"), err=True)
    for path in export_run(run, out, file_format, chosen):
        typer.echo(path)


@app.command()
def recover(
    file: LogArgument, out: Annotated[Path, typer.Option("--out", help="Name of the repaired log; never overwritten.")]
) -> None:
    """Repair a cut or damaged log, and report what is lost."""
    from spot_log.read.recover import recover_log

    recovery = recover_log(file, out)
    for text in recovery.damage or ("nothing was damaged",):
        typer.echo(plain(f"{file}: {text}"))
    kept = ", ".join(f"{count} of {topic}" for topic, count in recovery.kept.items() if count)
    typer.echo(f"{out}: {kept} kept")


@app.command("import")
def import_recording(
    mapping: Annotated[
        Path | None, typer.Argument(help="YAML file that maps arrays to signals, or the name of a built-in one.")
    ] = None,
    file: Annotated[
        Path | None,
        typer.Argument(help="The recording: .npz, .csv, .parquet, .h5, .hdf5, a ROS 2 bag, or a LeRobot data set."),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Name of the log to write; never overwritten.")] = None,
    suggestion: Annotated[
        Path | None, typer.Option("--suggest", help="Write a mapping for this recording instead, here or to --out.")
    ] = None,
    episode: Annotated[
        str | None, typer.Option(help="Of a LeRobot data set: a number, or all, for a log of each in the folder --out.")
    ] = None,
) -> None:
    """Convert another program's recording to a log, if it is what the mapping says."""
    from spot_log.importing import import_log, load_mapping
    from spot_log.importing.lerobot import chosen_episodes
    from spot_log.importing.suggest import suggest
    from spot_model.io.whole import write_new

    if suggestion is not None:
        text = suggest(suggestion)
        if out is not None:
            write_new(out, text)
        typer.echo(out or text.rstrip())
    elif mapping is None or file is None or out is None:
        raise BadInputError("give MAPPING, FILE and --out, or --suggest FILE for a mapping to start from")
    else:
        loaded = load_mapping(mapping)
        numbers = [loaded.episode] if episode is None else chosen_episodes(file, episode)
        if episode == "all":
            out.mkdir(parents=True, exist_ok=True)
        for n in numbers:
            told = {} if n is None else {"episode": n, "repeat": n}
            log = out if episode != "all" else out / f"episode_{n:06d}.mcap"
            imported = import_log(loaded.model_copy(update=told), file, log)
            typer.echo(f"{log}: {imported.rows} rows at {imported.rate_hz:.2f} Hz")
            for text in imported.doubts:
                typer.echo(plain(f"doubt: {text}"), err=True)
        typer.echo(f"not in the recording: {', '.join(imported.missing)}")


@app.command()
def report(
    file: LogArgument, out: Annotated[Path, typer.Option("--out", help="Name of the HTML page; never overwritten.")]
) -> None:
    """Draw a log: one HTML page that opens from disk, without a network."""
    from spot_log.page.page import write_page
    from spot_log.read.reader import read_run

    write_page(read_run(file), out)
    typer.echo(out)
