"""Run the sequences of a collection, each in its own process, and check the results."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from spot_model.errors import BadInputError
from spot_model.policy.policy import Policy, load_policy
from trainer.collect.plan import FoundRun, PlannedRun, find_runs, missing_runs, plan_runs, sequence_sources
from trainer.export.gain_variant import write_gain_variant

ROBOT_FAULT = "robot_fault"
STOPPING = {
    ROBOT_FAULT: "the robot reports a fault that a person must clear; after that, give the command again",
    "": "no run can begin, for the reason above; after that is mended, give the command again",
}
"""Outcomes of a run after which no other is tried, with what is then said; empty: it left no log."""
"""Outcome of a run that the robot refused for a fault, such as the fall before it."""
Starter = Callable[[list[str]], int]
"""Runs ``spot-rl`` with arguments and gives its exit code."""


@dataclass(frozen=True)
class Part:
    """The runs of one policy file."""

    policy_path: Path
    policy: Policy
    folder: Path
    plan: tuple[PlannedRun, ...]
    label: str


@dataclass(frozen=True)
class Collection:
    """All runs of a collection: those of the policy, and where asked for those at other gains."""

    parts: tuple[Part, ...]

    @staticmethod
    def prepare(*, policy: Path, folder: Path, sequences: str, repeats: int, other_gains: str | None) -> Collection:
        """Plan all runs.

        Raises:
            BadInputError: A sequence or the gains are not valid.
        """
        loaded = load_policy(policy)
        sources = sequence_sources(sequences)
        parts = [Part(policy, loaded, folder, plan_runs(sources, repeats, loaded), "policy")]
        folder.mkdir(parents=True, exist_ok=True)
        if other_gains is not None:
            kp, kd = parse_gains(other_gains)
            name = f"kp{kp:g}-kd{kd:g}"
            variant = write_gain_variant(policy, folder / name / f"{policy.stem}-{name}.onnx", kp, kd)
            loaded = load_policy(variant)
            parts.append(Part(variant, loaded, folder / name, plan_runs(sources[:1], repeats, loaded), name))
        return Collection(tuple(parts))

    @property
    def n_planned(self) -> int:
        """Number of runs."""
        return sum(len(part.plan) for part in self.parts)

    def record(
        self, shared: Sequence[str], start: Starter, *, attempts: int, say: Callable[[str], None]
    ) -> tuple[PlannedRun, ...]:
        """Make what is missing; returns what is missing still."""
        left: list[PlannedRun] = []
        is_stopped = False
        for part in self.parts:
            found = find_runs(part.folder, part.policy, part.plan)
            for run in found:
                if run.problem:
                    say(f"{run.path} does not count: {run.problem}")
            missing = missing_runs(part.plan, found)
            say(f"{part.label}: {len(part.plan) - len(missing)} of {len(part.plan)} runs are recorded already")
            for number, planned in enumerate(missing, start=1):
                if is_stopped:
                    left.append(planned)
                    continue
                say(f"{part.label}: run {number} of {len(missing)}: {planned.sequence.name}, repeat {planned.repeat}")
                outcome = _make(part, planned, shared, start, attempts, say)
                if outcome is not None:
                    left.append(planned)
                    is_stopped = outcome in STOPPING
                    if is_stopped:
                        say(STOPPING[outcome])
        return tuple(left)


def _make(
    part: Part, planned: PlannedRun, shared: Sequence[str], start: Starter, attempts: int, say: Callable[[str], None]
) -> str | None:
    """None once a whole run is there, else how the last attempt ended: empty if it left no log."""
    arguments = ["run", "--policy", str(part.policy_path), "--sequence", planned.source, "--log-dir", str(part.folder)]
    arguments += ["--repeat", str(planned.repeat), "--label", f"collection={part.label}", *shared]
    outcome = ""
    for attempt in range(1, attempts + 1):
        before = set(part.folder.glob("*.mcap"))
        code = start(arguments)
        fresh = [p for p in part.folder.glob("*.mcap") if p not in before]
        runs: tuple[FoundRun, ...] = find_runs(part.folder, part.policy, [planned]) if fresh else ()
        mine = [r for r in runs if r.path in fresh]
        if any(not r.problem for r in mine):
            return None
        outcome = mine[0].outcome if mine else ""
        why = mine[0].problem if mine else "it left no log"
        say(f"attempt {attempt} of {attempts} does not count: {why} (exit code {code})")
        if outcome == ROBOT_FAULT:
            break
    return outcome


def parse_gains(text: str) -> tuple[float, float]:
    """``KP,KD`` as numbers.

    Raises:
        BadInputError: They are no two numbers above 0.
    """
    try:
        kp, kd = (float(word) for word in text.split(","))
    except ValueError as error:
        raise BadInputError(f"--other-gains {text!r}; allowed: KP,KD, for instance 50,1.5") from error
    if not (0.0 < kp <= 1000.0 and 0.0 < kd <= 100.0):
        raise BadInputError(f"--other-gains {text!r}; allowed: KP above 0 up to 1000 N·m/rad, KD up to 100 N·m·s/rad")
    return kp, kd


def run_arguments(
    *,
    robot: str,
    config: Path | None,
    ca_file: Path | None,
    credentials_file: Path | None,
    labels: tuple[str, ...],
    lock_step: str | None,
) -> list[str]:
    """The arguments of ``spot-rl run`` that all runs share."""
    arguments = ["--robot", robot]
    for flag, value in (
        ("--config", config),
        ("--ca-file", ca_file),
        ("--credentials-file", credentials_file),
        ("--lock-step", lock_step),
    ):
        if value is not None:
            arguments += [flag, str(value)]
    for label in labels:
        arguments += ["--label", label]
    return arguments
