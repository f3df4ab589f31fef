"""Explain a sim-to-real gap: the effect that causes it, where it lies, how far it shrinks, what to run next."""

from __future__ import annotations

from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, cast

import typer

from diagnosis import command

if TYPE_CHECKING:
    from diagnosis.verdict.diagnose import Diagnosis

FOLDER: Final = "compare"
"""In the diagnosis' folder."""


@wraps(command.explain_logs)
def diagnose(**asked: Any) -> None:
    """Explain a sim-to-real gap: where it lies, which effect causes it, how far it shrinks."""
    # The comparison never fails a diagnosis that is written.
    from spot_model.io.whole import check_new

    if asked.get("out") is not None:
        check_new(Path(asked["out"]) / FOLDER)
    result, out = cast("tuple[Diagnosis, Path]", command.explain_logs(**asked))
    typer.echo("comparing one log with the simulators …", err=True)
    typer.echo(f"compare    {compared(result, out)}")


def compared(result: Diagnosis, out: Path) -> str:
    """Write the comparison into the folder of a diagnosis; returns where its page is, or why there is none."""
    from compare.tracks import CompareError

    try:
        return str(set_beside(result, out / FOLDER))
    except CompareError as error:
        return f"not written: {error}"


def set_beside(result: Diagnosis, folder: Path) -> Path:
    """Write the comparison of the log that shows the gap best; returns its page.

    Raises:
        CompareError: Nothing was simulated, or the runs cannot be compared.
    """
    from compare.compare import PAGE_NAME, Named, compare_runs, write_comparison
    from compare.tracks import CompareError

    models = {name: {_key(r): r for r in runs} for name, runs in result.simulated.items() if runs}
    logs = [r for r in result.runs if all(_key(r) in runs for runs in models.values())]
    if "nominal" not in models or not logs:
        raise CompareError("no log was simulated")
    gap_s = dict.fromkeys((r.header.run_id for r in logs), 0.0)
    for stretch in result.verdict.timeline:
        if stretch.kind == "gap" and stretch.log in gap_s:
            gap_s[stretch.log] += stretch.end_s - stretch.start_s
    log = max(logs, key=lambda r: gap_s[r.header.run_id])
    simulated = [Named(f"{name} model", runs[_key(log)], is_simulated=True) for name, runs in models.items()]
    found = compare_runs([Named("robot", log), *simulated], result.verdict)
    return write_comparison(found, folder)[PAGE_NAME]


def _key(run: Any) -> tuple[str, int]:
    return run.header.command_sequence or "unnamed", run.header.repeat
