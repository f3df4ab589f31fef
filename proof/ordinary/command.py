"""How often an ordinary run is stopped though its robot does not fall."""

from __future__ import annotations

import json
import tempfile
import time
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Final

import typer

from proof.ordinary.trial import Outcome, tried
from proof.result_file import ResultFile
from spot_model.console.options import AsJson
from spot_model.console.progress import Progress
from spot_model.policy.policy import load_policy

EXIT_FAILED: Final = 1
POLICIES: Final = [Path(f"policies/{name}.onnx") for name in ("walk", "baseline", "fast", "bound")]
_WRONG: Final = ("false stop", "fell unseen", "not begun")


def ordinary(
    out: Annotated[Path, typer.Option(help="File of the outcomes, a line each; an existing one is continued.")],
    as_json: AsJson = False,
    runs: Annotated[int, typer.Option(min=1, help="Runs of each policy, each on another robot.")] = 100,
    policy: Annotated[list[Path] | None, typer.Option(help="ONNX file with its contract; repeatable.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the robots and the commands.")] = 0,
    quiet_minutes: Annotated[
        float, typer.Option(min=0.2, max=60.0, help="Length of every fifth robot's runs, in which nothing happens.")
    ] = 10.0,
    minutes: Annotated[
        float, typer.Option(min=0.1, show_default=False, help="Start no robot after this many minutes.")
    ] = 1e6,
) -> None:
    """Walk randomly drawn robots (ground, pushes, payload, sensors, delays), or let them be; count false stops."""
    policies = policy or POLICIES
    for path in policies:
        load_policy(path)
    file = ResultFile(out, {"seed": seed})
    outcomes = [Outcome(**outcome) for outcome in file.earlier]
    done = {(outcome.number, outcome.policy): outcome for outcome in outcomes}
    left = [n for n in range(runs) if any((n, path.stem) not in done for path in policies)]
    total, began_s = runs * len(policies), time.monotonic()
    with Progress("runs", total, done=len(done)) as progress:
        for number in left:
            if time.monotonic() - began_s > 60.0 * minutes:
                break
            missing = [path for path in policies if (number, path.stem) not in done]
            with tempfile.TemporaryDirectory(prefix="spot-rl-ordinary-") as folder:
                for outcome in tried(number, seed, missing, Path(folder), 60.0 * quiet_minutes):
                    done[number, outcome.policy] = outcome
                    file.add(asdict(outcome))
                    is_told = outcome.verdict in _WRONG
                    text = f"{number} {outcome.policy} {outcome.command}: {outcome.verdict} {outcome.sentence}"
                    progress.update(len(done), text, is_told=is_told)
    _tell(done, policies, seed, as_json)
    raise typer.Exit(EXIT_FAILED if any(outcome.verdict in _WRONG for outcome in done.values()) else 0)


def _tell(done: dict[tuple[int, str], Outcome], policies: list[Path], seed: int, as_json: bool) -> None:
    counts = {
        path.stem: Counter(outcome.verdict for outcome in done.values() if outcome.policy == path.stem)
        for path in policies
    }
    if as_json:
        wrong = [asdict(outcome) for outcome in done.values() if outcome.verdict in _WRONG]
        typer.echo(json.dumps({"seed": seed, "runs": counts, "wrong": wrong}, ensure_ascii=False))
        return
    for name, count in counts.items():
        typer.echo(f"{name:<10} " + ", ".join(f"{n} {verdict}" for verdict, n in sorted(count.items())))
    for outcome in done.values():
        if outcome.verdict in _WRONG:
            typer.echo(f"{outcome.number} {outcome.policy}: {outcome.verdict}: {outcome.outcome}: {outcome.sentence}")
