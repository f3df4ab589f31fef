"""A collection: the runs that it needs, those that are whole already, and the making of the rest."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from spot_log import Run, read_run
from spot_log.format.events import FOLLOWING_MODE
from spot_model.errors import BadInputError, SpotRlError
from spot_model.io.velocity_sequence import VelocitySequence, load_sequence
from spot_model.io.whole import whole_file
from spot_model.policy.contract import METADATA_KEY, PolicyContract
from spot_model.policy.policy import Policy, load_policy
from spot_model.robot import facts


def write_gain_variant(policy: Path, path: Path, kp_nm_per_rad: float, kd_nm_s_per_rad: float) -> Path:
    """Write a copy of a policy file with other gains in its contract; a file that is there already is kept.

    Raises:
        PolicyError: ``policy`` is not valid.
    """
    # Only this needs the extra 'train'; a collection without other gains does not.
    import onnx

    contract = load_policy(policy).contract
    changed = contract.model_copy(
        update={
            "name": f"{contract.name}-kp{kp_nm_per_rad:g}-kd{kd_nm_s_per_rad:g}",
            "kp_nm_per_rad": (kp_nm_per_rad,) * facts.N_JOINTS,
            "kd_nm_s_per_rad": (kd_nm_s_per_rad,) * facts.N_JOINTS,
        }
    )
    if path.exists():
        return path
    model = onnx.load(policy)
    for entry in model.metadata_props:
        if entry.key == METADATA_KEY:
            entry.value = PolicyContract.model_validate(changed.model_dump(by_alias=True)).to_json()
    with whole_file(path) as part:
        onnx.save(model, part)
    return path


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
        """Plan all runs. Raises BadInputError: a sequence or the gains are not valid."""
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
    """``KP,KD`` as numbers. Raises BadInputError: they are not two numbers above 0."""
    try:
        kp, kd = (float(word) for word in text.split(","))
    except ValueError as error:
        raise BadInputError(f"--other-gains {text!r}; allowed: KP,KD, for instance 50,1.5") from error
    if not (0.0 < kp <= 1000.0 and 0.0 < kd <= 100.0):
        raise BadInputError(f"--other-gains {text!r}; allowed: KP above 0 up to 1000 N·m/rad, KD up to 100 N·m·s/rad")
    return kp, kd


def run_arguments(options: Mapping[str, object], labels: Sequence[str]) -> list[str]:
    """The arguments of ``spot-rl run`` that all runs share: flags with their values, None for those not given."""
    words = [str(word) for flag, value in options.items() if value is not None for word in (flag, value)]
    return words + [word for label in labels for word in ("--label", label)]
