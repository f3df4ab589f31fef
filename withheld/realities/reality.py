"""Robots from requests: small errors first, then the faults, each from a generator of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import Final

from spot_model.io.model_file import RobotModel
from spot_model.io.velocity_sequence import VelocitySequence
from spot_model.policy.policy import Policy, load_policy
from withheld.plan import Fault, FaultRequest, RecordingPlan, Truth, Walk
from withheld.realities.catalogue import CATALOGUE
from withheld.realities.fault_kind import Ask, Built, flags_of
from withheld.realities.logbook import LogSetting, tick_table, write_log
from withheld.realities.nominal import NOMINAL
from withheld.realities.records import RunArrays
from withheld.realities.robot import Robot
from withheld.realities.settings import Settings
from withheld.realities.simulation import RunRequest, simulate
from withheld.realities.small_errors import add_small_errors
from withheld.realities.streams import stream

EPOCH_NS: Final = 1_790_000_000_000_000_000
SIDE_BY_SIDE: Final = 16
"""Runs that are simulated together: all fifteen of a case of five repeats."""


@dataclass(frozen=True)
class ComposedReality:
    """A robot with faults of the catalogue."""

    seed: int
    truth: Truth
    built: tuple[Built, ...]
    settings: Settings = field(default_factory=Settings)

    @property
    def nominal(self) -> RobotModel:
        """The robot without faults and small errors."""
        return NOMINAL

    def robot(self) -> Robot:
        """A fresh robot: the same seed gives the same small errors, whatever the faults."""
        robot = Robot()
        add_small_errors(robot, stream(self.seed, "small errors"))
        for built in self.built:
            built.install(robot)
        return robot

    def record(self, plan: RecordingPlan, folder: Path) -> None:
        """Simulate and write ``repeats`` logs of each sequence; names are random, and follow from the plan's seed.

        Raises:
            PolicyError: The policy cannot be loaded.
            OSError: The folder cannot be written.
        """
        self.rehearse(plan).write(folder)

    def rehearse(self, plan: RecordingPlan) -> Made:
        """Simulate.

        Raises:
            PolicyError: The policy cannot be loaded.
        """
        policy = load_policy(plan.policy)
        robot = self.robot()
        jobs = [
            (repeat, number, sequence)
            for repeat in range(plan.repeats)
            for number, sequence in enumerate(plan.sequences)
        ]
        jobs.sort(key=lambda job: job[2].duration_s)
        runs: list[tuple[int, int, VelocitySequence, RunArrays]] = []
        for _, group in groupby(jobs, key=lambda job: job[2].duration_s):
            alike = list(group)
            for start in range(0, len(alike), SIDE_BY_SIDE):
                some = alike[start : start + SIDE_BY_SIDE]
                requests = [RunRequest(s, stream(plan.seed, "run", n, r)) for r, n, s in some]
                made = simulate(robot, policy, requests, self.settings)
                runs += [(r, n, s, run) for (r, n, s), run in zip(some, made, strict=True)]
        return Made(plan, policy, tuple(runs))


@dataclass(frozen=True)
class Made:
    """Runs that were simulated."""

    plan: RecordingPlan
    policy: Policy
    runs: tuple[tuple[int, int, VelocitySequence, RunArrays], ...]
    """Repeat, number of the sequence, sequence, and what came of it."""

    @property
    def walks(self) -> list[Walk]:
        """As their logs would have them, in the order of sequences and repeats."""
        ordered = sorted(self.runs, key=lambda made: (made[2].name, made[0]))
        return [(sequence.name, tick_table(run)) for _, _, sequence, run in ordered]

    def write(self, folder: Path) -> None:
        """Write a log of each.

        Raises:
            OSError: The folder cannot be written.
        """
        folder.mkdir(parents=True, exist_ok=True)
        plan = self.plan
        for repeat, number, sequence, run in self.runs:
            rng = stream(plan.seed, "log", number, repeat)
            setting = LogSetting(
                run_id=rng.bytes(16).hex(),
                sequence=sequence.name,
                repeat=repeat,
                started_host_ns=EPOCH_NS + int(rng.integers(0, 86_400_000_000_000)),
                skew_ns=int(rng.integers(-300_000_000_000, 300_000_000_000)),
                first_state_ns=int(rng.integers(500_000_000, 900_000_000)),
            )
            write_log(run, self.policy, setting, plan.missing, rng, folder / f"{rng.bytes(8).hex()}.mcap")


def make(requests: Sequence[FaultRequest], seed: int, settings: Settings | None = None) -> ComposedReality:
    """A reality with these faults; none for one that differs from the nominal model by small errors alone.

    Args:
        requests: What is wrong, and how much.
        seed: Draws the small errors, the joints, and the numbers of each fault, each by itself: leaving a request out
            changes nothing else.
        settings: How to simulate.

    Raises:
        ValueError: A kind is unknown, or cannot act at the place.
    """
    faults, built = [], []
    for number, request in enumerate(requests):
        if request.kind not in CATALOGUE:
            raise ValueError(f"fault {request.kind!r} is unknown; allowed: {', '.join(sorted(CATALOGUE))}")
        kind = CATALOGUE[request.kind]
        again = sum(r.kind == request.kind for r in requests[:number])
        joints = kind.choose_joints(request.place, stream(seed, "place", kind.name, again))
        made = kind.draw(Ask(stream(seed, "fault", kind.name, again), request.size, flags_of(joints)))
        built.append(made)
        faults.append(
            Fault(
                names=kind.names, joints=joints, parameters=dict(made.parameters), family=kind.family,
                size=request.size, kind=kind.name,
            )
        )  # fmt: skip
    return ComposedReality(seed, Truth(faults=tuple(faults)), tuple(built), settings or Settings())
