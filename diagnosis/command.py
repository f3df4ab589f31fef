"""``spot-rl diagnose``."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer


def diagnose(
    logs: Annotated[list[Path], typer.Argument(help="Log files of one robot, or folders of them.")],
    nominal: Annotated[str, typer.Option("--nominal", help="The simulator's model: a file (YAML) or a built-in name.")],
    out: Annotated[Path, typer.Option("--out", help="Folder for verdict, report and corrected model.")],
    policy: Annotated[
        Path | None, typer.Option("--policy", help="The policy that ran; without it one in policies/ with its digest.")
    ] = None,
    add_effect: Annotated[
        list[str] | None, typer.Option("--add-effect", help="One more effect of the library, module:Class; may repeat.")
    ] = None,
    without: Annotated[
        list[str] | None, typer.Option("--without", help="Leave an effect out of the library; may repeat.")
    ] = None,
    synthesis: Annotated[
        bool, typer.Option("--synthesis", help="Also diagnose the nominal simulator with the effects put in.")
    ] = False,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of simulated sensors, permutations, resamples.")] = 0,
) -> None:
    """Explain a sim-to-real gap: where it lies, which effect causes it, how far it shrinks."""
    import numpy as np

    from diagnosis.diagnose import diagnose as run_diagnosis
    from diagnosis.extra_effect import chosen_library
    from diagnosis.output import write_all
    from diagnosis.read_logs import find_policy, read_all
    from diagnosis.terminal import twelve_lines
    from spot_model.model_file import load_model

    began_s = time.monotonic()

    def say(text: str) -> None:
        typer.echo(f"[{time.monotonic() - began_s:5.1f} s] {text}", err=True)

    library = chosen_library(add_effect or [], without or [])
    model = load_model(nominal)
    say("reading logs")
    runs, warnings = read_all(logs)
    for warning in warnings:
        say(f"note: {warning}")
    result = run_diagnosis(
        runs, model, find_policy(policy, runs), np.random.default_rng(seed), say,
        library=library, with_synthesis=synthesis, nominal_name=nominal,
    )  # fmt: skip
    left_out = tuple(dict.fromkeys(without or []))
    result = replace(result, verdict=result.verdict.model_copy(update={"without": left_out}))
    say("writing the report")
    paths = write_all(result, out)
    for line in twelve_lines(result.verdict, paths):
        typer.echo(line)
