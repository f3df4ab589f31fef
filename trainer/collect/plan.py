"""The runs that a collection needs, and those that are already complete."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from spot_log import Run, read_run
from spot_log.format.events import FOLLOWING_MODE
from spot_model.errors import BadInputError, SpotRlError
from spot_model.io.velocity_sequence import VelocitySequence, load_sequence
from spot_model.policy.policy import Policy

PAPER_SEQUENCES: Final = ("forward", "six_directions", "random", "user")
"""The paper's four command sequences; what ``all`` stands for."""

USER_SEQUENCE: Final = Path(__file__).parent / "user_sequence.yaml"
"""One recorded example of user commands."""

SHORT_BY_S: Final = 0.5
"""A run may end this much before its sequence and still count as whole."""


@dataclass(frozen=True)
class PlannedRun:
    """One run to make."""

    sequence: VelocitySequence
    source: str
    """What ``spot-rl run --sequence`` takes for it."""
    repeat: int
    """From 1."""


@dataclass(frozen=True)
class FoundRun:
    """A log of this collection, and whether it counts."""

    path: Path
    sequence: str
    repeat: int
    problem: str = ""
    """Empty for a whole run; otherwise why it does not count."""
    outcome: str = ""
    """How the run ended, by its log."""


def sequence_sources(names: str) -> tuple[str, ...]:
    """What ``--sequences`` stands for: ``all``, or names and files with commas between."""
    wanted = PAPER_SEQUENCES if names == "all" else tuple(word.strip() for word in names.split(",") if word.strip())
    if not wanted:
        raise BadInputError(
            f"--sequences {names!r} names none; allowed: all, or names and YAML files with commas between"
        )
    return tuple(str(USER_SEQUENCE) if name == "user" else name for name in wanted)


def plan_runs(sources: Sequence[str], repeats: int, policy: Policy) -> tuple[PlannedRun, ...]:
    """All runs, sequence by sequence within a repeat, so that an interruption leaves whole repeats.

    Raises:
        BadInputError: A sequence is unknown or not valid, or two have the same name.
    """
    contract = policy.contract
    low, high = np.array(contract.velocity_command_low), np.array(contract.velocity_command_high)
    sequences = [load_sequence(source).clipped(low, high) for source in sources]
    names = [s.name for s in sequences]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise BadInputError(f"two sequences are called {', '.join(twice)}; rename one, so that their logs differ")
    return tuple(
        PlannedRun(sequence, source, repeat)
        for repeat in range(1, repeats + 1)
        for sequence, source in zip(sequences, sources, strict=True)
    )


def find_runs(folder: Path, policy: Policy, plan: Sequence[PlannedRun]) -> tuple[FoundRun, ...]:
    """Look at every log of the folder, and check those that belong to the plan."""
    sequences = {p.sequence.name: p.sequence for p in plan}
    found = []
    for path in sorted(folder.glob("*.mcap")):
        try:
            run = read_run(path)
        except (SpotRlError, OSError) as error:
            found.append(FoundRun(path, "", 0, f"cannot be read: {error}"))
            continue
        header = run.header
        sequence = sequences.get(header.command_sequence)
        problem = f"sequence {header.command_sequence!r} is not in this collection"
        if sequence is not None:
            problem = incomplete(run, sequence, policy)
        found.append(FoundRun(path, header.command_sequence, header.repeat, problem, run.outcome))
    return tuple(found)


def missing_runs(plan: Sequence[PlannedRun], found: Sequence[FoundRun]) -> tuple[PlannedRun, ...]:
    """What of the plan no whole run is there for."""
    there = {(f.sequence, f.repeat) for f in found if not f.problem}
    return tuple(p for p in plan if (p.sequence.name, p.repeat) not in there)


def incomplete(run: Run, sequence: VelocitySequence, policy: Policy) -> str:
    """Why a log does not count as a whole run of its sequence; empty if it does."""
    if run.header.policy_sha256 != policy.sha256:
        return f"it was made with another policy ({run.header.policy_name}, sha256 {run.header.policy_sha256[:12]}…)"
    if run.damage:
        return f"it is damaged: {run.damage[0]}"
    if run.outcome != "completed":
        return f"it ended with {run.outcome}"
    rate_hz = policy.contract.rate_hz
    active_s = float(np.sum(run.ticks.mode == FOLLOWING_MODE)) / rate_hz
    if active_s < sequence.duration_s - SHORT_BY_S:
        return f"its policy ran for {active_s:.1f} s of the sequence's {sequence.duration_s:g} s"
    dropped = sum(run.footer.dropped.values()) if run.footer is not None else 0
    if dropped:
        return f"{dropped} messages were lost on the way to the log"
    skipped = int(run.ticks.skipped.sum())
    if skipped > 0.01 * len(run.ticks):
        return f"{skipped} of {len(run.ticks)} policy ticks were skipped"
    return ""
