"""Logs from files and folders, and the policy that made them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from diagnosis.read.policy_ticks import policy_ticks
from diagnosis.read.recording import record
from spot_log import Run, read_run
from spot_model.errors import BadInputError, SpotRlError
from spot_model.io.whole import finished
from spot_model.policy.contract import PolicyContract
from spot_model.policy.policy import Policy, load_policy


def read_all(
    paths: Sequence[Path], tell: Callable[[float], None] = lambda _: None
) -> tuple[tuple[Run, ...], tuple[str, ...]]:
    """Read all logs; what cannot be read or says too little is left out, and said.

    Raises:
        BadInputError: None is left.
    """
    runs: list[Run] = []
    warnings = [f"folder {p} has no .mcap file" for p in paths if p.is_dir() and not finished(p, "*.mcap")]
    files = [f for p in paths for f in (finished(p, "*.mcap") if p.is_dir() else [p])]
    for i, file in enumerate(files):
        tell(i / len(files))
        try:
            run = read_run(file)
            record(run)
        except (SpotRlError, OSError) as error:
            warnings.append(f"{file.name}: left out: {error}")
            continue
        warnings += [f"{file.name}: {text}" for text in run.damage]
        runs.append(run)
    runs = _each_once(runs, warnings)
    if not runs:
        told = "\n".join(f"  {w}" for w in warnings)
        raise BadInputError(f"no log can be diagnosed:\n{told}\ngive logs of 'spot-rl collect' or 'spot-rl run'")
    is_commanded = [bool(len(run.commands) or len(policy_ticks(run))) for run in runs]
    if any(is_commanded):
        # One log that lacks a signal switches its channels off for all.
        idle = [run.path.name for run, is_it in zip(runs, is_commanded, strict=True) if not is_it]
        warnings += [f"{name}: left out: the robot got no command in it" for name in idle]
        runs = [run for run, is_it in zip(runs, is_commanded, strict=True) if is_it]
    return tuple(runs), tuple(warnings)


def _each_once(runs: Sequence[Run], warnings: list[str]) -> list[Run]:
    """Of several files of one run, such as its log and the record of its last seconds, the longest."""
    kept: list[Run] = []
    for run in sorted(runs, key=lambda run: -len(run.states)):
        whole = next((other for other in kept if _holds(other, run)), None)
        if whole is None:
            kept.append(run)
        else:
            warnings.append(f"{run.path}: left out: its states are in {whole.path}, which is longer")
    return [run for run in runs if any(run is one for one in kept)]


def _holds(whole: Run, part: Run) -> bool:
    """Whether a log has the first state of a shorter one, by name of the run, stamp and joints."""
    a, b = whole.states, part.states
    row = int(np.searchsorted(a.robot_stamp_ns, b.robot_stamp_ns[0]))
    return (
        whole.header.run_id == part.header.run_id
        and len(b) < len(a)
        and row < len(a)
        and a.robot_stamp_ns[row] == b.robot_stamp_ns[0]
        and np.array_equal(a.position_rad[row], b.position_rad[0], equal_nan=True)
    )


def find_policy(path: Path | None, runs: Sequence[Run], folder: Path = Path("policies")) -> Policy | None:
    """The policy that was given, or the one in ``folder`` whose digest most logs name; None if there is none.

    Logs of one network at several gains go together; see :func:`apart_by_gains`.

    Raises:
        BadInputError: The given one is not valid or not the logs', or the logs are of several networks.
    """
    wanted = {run.header.policy_sha256: run for run in runs if run.header.policy_sha256}
    if len(wanted) > 1 and not _are_one_network([run.header.policy_contract_json for run in wanted.values()]):
        told = "; ".join(f"{run.path.name}: {run.header.policy_name or sha[:8]}" for sha, run in sorted(wanted.items()))
        raise BadInputError(f"logs of {len(wanted)} policies: {told}; diagnose logs of one policy at a time")
    if path is not None:
        given = load_policy(path)
        if wanted and given.sha256 not in wanted:
            sha, run = next(iter(wanted.items()))
            raise BadInputError(
                f"--policy {path} has SHA-256 {given.sha256[:12]}…; log {run.path.name} was made by "
                f"{run.header.policy_name or 'a policy'} with {sha[:12]}…; give that policy's file, or leave --policy "
                "out: then nothing is simulated"
            )
        return given
    n_logs = Counter(run.header.policy_sha256 for run in runs)
    own = [p for p in _policies_in(folder).values() if p.sha256 in wanted]
    return max(own, key=lambda p: n_logs[p.sha256], default=None)


def apart_by_gains(runs: Sequence[Run], policy: Policy) -> tuple[tuple[Run, ...], tuple[str, ...]]:
    """Logs at gains other than the policy's under sequence names of their own; and what that means, a sentence each.

    Their commands are the same, their motion is not: residuals use them, closed loops compare the others.
    """
    out, notes = [], []
    for run in runs:
        if run.header.policy_sha256 not in ("", policy.sha256):
            name = run.header.policy_name or "another policy"
            notes.append(
                f"{run.path.name}: made at other gains ({name}); its loads are used, its motion is not compared"
            )
            own = f"{run.header.command_sequence}, {name}"
            run = replace(run, header=replace(run.header, command_sequence=own))  # noqa: PLW2901
        out.append(run)
    return tuple(out), tuple(notes)


def _are_one_network(contracts: Sequence[str]) -> bool:
    try:
        first = PolicyContract.from_json(contracts[0])
    except ValueError:
        return False
    return all(first.is_same_network(text) for text in contracts)


def find_policy_file(path: Path | None, policy: Policy, folder: Path = Path("policies")) -> Path:
    """The file of a policy that :func:`find_policy` found."""
    return path or next(file for file, found in _policies_in(folder).items() if found.sha256 == policy.sha256)


def _policies_in(folder: Path) -> dict[Path, Policy]:
    found: dict[Path, Policy] = {}
    for file in sorted(folder.glob("*.onnx")) if folder.is_dir() else ():
        with suppress(SpotRlError):
            found[file] = load_policy(file)
    return found
