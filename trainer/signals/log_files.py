"""Logs from files and folders: each run once, and what cannot be read left out with a word."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from spot_log import Run, read_run
from spot_model.errors import BadInputError, SpotRlError
from spot_model.io.whole import finished

Tell = Callable[[float], None]


def log_files(paths: Sequence[Path]) -> list[Path]:
    """Log files, and those in folders, each once."""
    return list(dict.fromkeys(f for p in paths for f in (finished(p, "*.mcap") if p.is_dir() else [p])))


def read_each(
    paths: Sequence[Path], tell: Tell = lambda _: None, check: Callable[[Run], object] = lambda _: None
) -> tuple[list[Run], list[str]]:
    """Read logs; what cannot be read or used is left out, and said, a sentence each.

    Args:
        paths: Log files, or folders of them.
        tell: Gets the share of the files that are read, 0 to 1.
        check: Raises ``SpotRlError`` for a log that cannot be used.

    Raises:
        BadInputError: No log is left; the message says why for each file.
    """
    runs: list[Run] = []
    warnings = [f"folder {p} has no .mcap file" for p in paths if p.is_dir() and not finished(p, "*.mcap")]
    files = log_files(paths)
    for i, file in enumerate(files):
        tell(i / len(files))
        try:
            run = read_run(file)
            check(run)
        except (SpotRlError, OSError) as error:
            warnings.append(f"{file.name}: left out: {error}")
            continue
        warnings += [f"{file.name}: {text}" for text in run.damage]
        runs.append(run)
    runs = _each_once(runs, warnings)
    if not runs:
        told = "\n".join(f"  {w}" for w in warnings)
        raise BadInputError(f"no log can be used:\n{told}\ngive logs of 'spot-rl collect' or 'spot-rl run'")
    return runs, warnings


def _each_once(runs: Sequence[Run], warnings: list[str]) -> list[Run]:
    """Of several files of one run, such as a copy or the record of its last seconds, the longest."""
    kept: list[Run] = []
    for run in sorted(runs, key=lambda run: -len(run.states)):
        whole = next((other for other in kept if _holds(other, run)), None)
        if whole is None:
            kept.append(run)
        else:
            warnings.append(f"{run.path}: left out: its states are in {whole.path}, too")
    return [run for run in runs if any(run is one for one in kept)]


def _holds(whole: Run, part: Run) -> bool:
    """Whether a log has the first state of one that is no longer, by name of the run, stamp and joints."""
    a, b = whole.states, part.states
    if whole.header.run_id != part.header.run_id or not len(b):
        return False
    at = a.position_rad[a.robot_stamp_ns == b.robot_stamp_ns[0]]
    return len(at) > 0 and np.array_equal(at[0], b.position_rad[0], equal_nan=True)
