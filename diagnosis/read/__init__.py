"""Logs from files and folders, and the policy that made them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from diagnosis.read.prepare import prepared
from diagnosis.read.robot_file import SPOT, RobotFile
from diagnosis.read.signal_checks import plausible
from spot_log import Run
from spot_model.errors import BadInputError, SpotRlError
from spot_model.policy.built_in import built_in_files
from spot_model.policy.contract import PolicyContract
from spot_model.policy.policy import Policy, load_policy
from trainer.signals.log_files import Tell, read_each
from trainer.signals.policy_ticks import policy_ticks
from trainer.signals.recording import record


def read_logs(
    paths: Sequence[Path], robot: RobotFile = SPOT, tell: Tell = lambda _: None
) -> tuple[tuple[Run, ...], tuple[str, ...]]:
    """Read logs, set aside what cannot be right, complete the rest; and what was done, a sentence each.

    Args:
        paths: Log files, or folders of them.
        robot: That they are of.
        tell: Gets the share of the files that are read, 0 to 1.

    Raises:
        BadInputError: No log is left, most have the same fault, or they are not of this robot.
    """
    runs, warnings = read_all(paths, tell)
    runs, set_aside = plausible(runs, robot)
    runs, notes = prepared(runs, robot)
    return runs, (*warnings, *set_aside, *notes)


def read_all(paths: Sequence[Path], tell: Tell = lambda _: None) -> tuple[tuple[Run, ...], tuple[str, ...]]:
    """Read all logs; what cannot be read or says too little is left out, and said.

    Raises:
        BadInputError: None is left.
    """
    runs, warnings = read_each(paths, tell, record)
    commanded = [run for run in runs if len(run.commands) or len(policy_ticks(run))]
    if commanded:
        # One log that lacks a signal switches its channels off for all.
        idle = [run.path.name for run in runs if not any(run is one for one in commanded)]
        warnings += [f"{name}: left out: the robot got no command in it" for name in idle]
    return tuple(commanded or runs), tuple(warnings)


def find_policy_file(path: Path | None, runs: Sequence[Run]) -> Path | None:
    """The policy that was given, or that whose digest most logs name, built in or in ``policies/``; None if none.

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
        return path
    n_logs = Counter(run.header.policy_sha256 for run in runs)
    own: dict[Path, int] = {}
    for file in (*built_in_files(".onnx").values(), *sorted(Path("policies").glob("*.onnx"))):
        with suppress(SpotRlError):
            sha256 = load_policy(file).sha256
            own |= {file: n_logs[sha256]} if sha256 in wanted else {}
    return max(own, key=lambda file: own[file], default=None)


def find_policy(path: Path | None, runs: Sequence[Run]) -> Policy | None:
    """The policy of :func:`find_policy_file`."""
    file = find_policy_file(path, runs)
    return None if file is None else load_policy(file)


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
        return all(map(PolicyContract.from_json(contracts[0]).is_same_network, contracts))
    except ValueError:
        return False
