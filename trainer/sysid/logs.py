"""Read log files as runs: cut or leave out what is unsound, and report both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from spot_log import Run
from spot_log.format.tables import StateTable
from spot_model.errors import BadInputError
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_runtime.stops import Reaction, StopReason
from trainer.signals.log_files import read_each
from trainer.signals.policy_ticks import fall_stamp_ns, followed

MIN_TICKS: Final = 250
"""A run shorter than 5 s says too little."""
FALL_MARGIN_S: Final = 0.5
"""What comes so shortly before a fall is cut as well."""
SUDDEN_ENDS: Final = frozenset(r.label for r in StopReason if r.reaction in {Reaction.DAMP, Reaction.EXPIRE})
"""Outcomes of runs that ended in trouble: a robot that tilts too far is falling already."""
SAME_LENGTH: Final = 0.9
"""A run shorter than this share of the longest of its sequence is not compared with it."""
SAME_COMMAND: Final = 0.05
"""Mean difference of the velocity commands (m/s, rad/s) up to which two runs count as repeats."""


@dataclass(frozen=True)
class LogSet:
    """What was read."""

    runs: tuple[Run, ...]
    """Runs whose torques, noise and delays are used: the ticks of the policy, commands by key, states in order."""
    compared: tuple[Run, ...]
    """Those of them that are also compared as whole runs of their sequence."""
    warnings: tuple[str, ...]
    """A sentence each: what was cut, left out or is missing, and what that costs."""


def read_identification_logs(paths: Sequence[Path], policy: Policy) -> LogSet:
    """Read logs of one policy, from files or folders of files.

    Raises:
        BadInputError: Nothing usable is left; the message says why for each file.
    """
    read, warnings = read_each(paths, check=lambda run: run_from_log(run, policy))
    cut = [run_from_log(run, policy) for run in read]
    warnings += [f"{run.path.name}: {note}" for run, notes in cut for note in notes]
    runs = [run for run, _ in cut]
    compared, more = choose_compared(runs, policy)
    if not compared:
        raise BadInputError("no log was made at the policy's own gains:\n" + "\n".join(f"  {w}" for w in warnings))
    return LogSet(tuple(runs), compared, tuple(warnings + more))


def sequence_of_log(run: Run) -> str:
    """Name of a run's command sequence."""
    return run.header.command_sequence or "unnamed"


def run_from_log(run: Run, policy: Policy) -> tuple[Run, tuple[str, ...]]:
    """The stretch of a log in which the policy was active, up to a fall; and what was cut or is missing, in words.

    Raises:
        BadInputError: The log is of another robot or policy, or too short; the message says which.
    """
    header = run.header
    if header.joint_names != facts.JOINT_NAMES:
        raise BadInputError(f"the log's joints are {', '.join(header.joint_names)}; identification knows Spot's twelve")
    has_policy_gains = header.policy_sha256 == policy.sha256
    if not has_policy_gains and not policy.contract.is_same_network(header.policy_contract_json):
        theirs = f"{header.policy_name or 'without a name'} (sha256 {header.policy_sha256[:12] or 'none'}…)"
        raise BadInputError(
            f"it was made with policy {theirs}, not with {policy.contract.name} ({policy.sha256[:12]}…); give that "
            "policy's file or leave the log out"
        )
    ticks, notes = run.ticks, list[str]()
    if not has_policy_gains:
        notes.append(
            f"made at other gains ({header.policy_name}); its torques are used, but it is not compared as a run"
        )
    rows, fall_ns = followed(ticks), fall_stamp_ns(run)
    rate_hz = policy.contract.rate_hz
    if fall_ns is not None:
        upright = int(np.searchsorted(ticks.robot_stamp_ns[rows], fall_ns))
        notes.append(
            f"the robot fell after {upright / rate_hz:.1f} s of the sequence; used up to {FALL_MARGIN_S:g} s before"
        )
        rows = rows[: max(0, upright - round(FALL_MARGIN_S * rate_hz))]
    elif run.outcome in SUDDEN_ENDS:
        notes.append(f"the run ended with {run.outcome}; used up to {FALL_MARGIN_S:g} s before")
        rows = rows[: max(0, len(rows) - round(FALL_MARGIN_S * rate_hz))]
    if len(rows) < MIN_TICKS:
        raise BadInputError(
            f"it has {len(rows)} ticks of the policy ({len(rows) / rate_hz:.1f} s); at least "
            f"{MIN_TICKS} are needed" + (f" ({'; '.join(notes)})" if notes else "")
        )
    if run.outcome not in {"completed", *SUDDEN_ENDS} and fall_ns is None:
        notes.append(f"the run did not end as planned ({run.outcome}); used {len(rows)} ticks")
    lost = int(ticks.skipped[rows].sum())
    if lost:
        notes.append(f"{lost} of {len(rows)} ticks were skipped; the simulation has none such")
    begin_ns, end_ns = int(ticks.robot_stamp_ns[rows[0]]), int(ticks.robot_stamp_ns[rows[-1]])
    states = _states_between(run.states, begin_ns, end_ns)
    if not np.isfinite(states.load_nm).any():
        notes.append("it has no measured load; limits and friction are searched by distributions alone")
    cut = replace(
        run,
        ticks=ticks.rows(rows),
        commands=run.commands.rows(np.argsort(run.commands.key, kind="stable")),
        states=states,
    )
    return cut, tuple(notes)


def choose_compared(runs: Sequence[Run], policy: Policy) -> tuple[tuple[Run, ...], list[str]]:
    """Runs that can be compared as whole runs of their sequence, cut to one length, and a word on the others."""
    chosen: list[Run] = []
    warnings: list[str] = []
    candidates = [run for run in runs if run.header.policy_sha256 == policy.sha256]
    for name in sorted({sequence_of_log(run) for run in candidates}):
        group = [run for run in candidates if sequence_of_log(run) == name]
        longest = max(len(run.ticks.action) for run in group)
        whole = [run for run in group if len(run.ticks.action) >= SAME_LENGTH * longest]
        warnings.extend(
            f"{run.path}: {len(run.ticks.action)} of {longest} ticks of sequence {name}; its torques are used, "
            "but it is not compared as a run"
            for run in group
            if len(run.ticks.action) < SAME_LENGTH * longest
        )
        length = min(len(run.ticks.action) for run in whole)
        first = whole[0].ticks.velocity_command[:length]
        apart = [np.abs(run.ticks.velocity_command[:length] - first).mean() for run in whole]
        same = [run for run, off in zip(whole, apart, strict=True) if off <= SAME_COMMAND]
        if len(same) < len(whole):
            others = ", ".join(str(run.path) for run, off in zip(whole, apart, strict=True) if not off <= SAME_COMMAND)
            warnings.append(f"sequence {name}: {others} had other velocity commands than the first run; not compared")
        if len(same) == 1:
            warnings.append(
                f"sequence {name} has one run: how far two real runs differ is not known, nor an interval from its "
                "distributions; record at least two, better five repeats"
            )
        chosen.extend(replace(run, ticks=run.ticks.rows(slice(length))) for run in same)
    return tuple(chosen), warnings


def _states_between(states: StateTable, begin_ns: int, end_ns: int) -> StateTable:
    """States of an interval in the order of their stamps, each stamp once."""
    stamps, first = np.unique(states.robot_stamp_ns, return_index=True)
    return states.rows(first[(stamps >= begin_ns) & (stamps <= end_ns)])
