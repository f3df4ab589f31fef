"""Logs from files and folders, and the policy that made them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from spot_model.errors import BadInputError, SpotRlError
from spot_model.policy import Policy, load_policy
from spot_runtime.log import Run, read_run


def read_all(paths: Sequence[Path]) -> tuple[tuple[Run, ...], tuple[str, ...]]:
    """Read all logs; what cannot be read is left out, and said.

    Raises:
        BadInputError: None can be read.
    """
    runs: list[Run] = []
    warnings: list[str] = []
    for path in paths:
        files = sorted(path.rglob("*.mcap")) if path.is_dir() else [path]
        if not files:
            warnings.append(f"folder {path} has no .mcap file")
        for file in files:
            try:
                runs.append(read_run(file))
            except (SpotRlError, OSError) as error:  # noqa: PERF203
                warnings.append(f"{file}: left out: {error}")
    if not runs:
        raise BadInputError("no log can be read:\n" + "\n".join(f"  {w}" for w in warnings))
    return tuple(runs), tuple(warnings)


def find_policy(path: Path | None, runs: Sequence[Run], folder: Path = Path("policies")) -> Policy | None:
    """The policy that was given, or the one in ``folder`` whose digest the logs name; None if there is none.

    Raises:
        BadInputError: The given one is not valid.
    """
    if path is not None:
        return load_policy(path)
    wanted = {run.header.policy_sha256 for run in runs if run.header.policy_sha256}
    for file in sorted(folder.glob("*.onnx")) if folder.is_dir() else ():
        try:
            policy = load_policy(file)
        except SpotRlError:
            continue
        if policy.sha256 in wanted:
            return policy
    return None
