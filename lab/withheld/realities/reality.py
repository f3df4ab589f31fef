"""Robots from requests: surroundings and ordinary errors first, then the faults, each from a generator of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Final

from spot_model.effects.commands import CommandDelay
from spot_model.effects.friction import Armature
from spot_model.io.model_file import RobotModel, paper_model
from spot_model.policy.policy import Policy, load_policy
from spot_model.robot import facts
from withheld.plan import Fault, FaultRequest, RecordingPlan, Truth
from withheld.realities.fault_kind import Ask, FaultKind, Flags, Parameters, flags_of
from withheld.simulator.draws import add_ordinary_errors, add_surroundings, draw_scale, draw_settings, stream
from withheld.simulator.link import mean_delay_s
from withheld.simulator.log import LogSetting, write_log
from withheld.simulator.parameters import LinkParameters, Settings
from withheld.simulator.recorder import RunArrays
from withheld.simulator.robot import Robot
from withheld.simulator.simulation import RunRequest, simulate

NOMINAL: Final = RobotModel(
    effects=(
        *(e for e in paper_model(facts.PAPER_IDENTIFIED).effects if not isinstance(e, CommandDelay)),
        Armature(joints=("hips",), inertia_kg_m2=facts.HIP_ARMATURE_KG_M2),
        Armature(joints=("knees",), inertia_kg_m2=facts.KNEE_ARMATURE_KG_M2),
        CommandDelay(delay_s=round(mean_delay_s(LinkParameters()), 4)),
    )
)


EPOCH_NS: Final = 1_790_000_000_000_000_000
SIDE_BY_SIDE: Final = 16
"""Runs that are simulated together: all fifteen of a case of five repeats."""


@dataclass(frozen=True)
class ComposedReality:
    """A robot with faults of the catalogue."""

    seed: int
    truth: Truth
    installs: tuple[Callable[[Robot], Parameters], ...]
    """Put each fault into a robot; all that it draws follows from the seed."""
    settings: Settings = field(default_factory=Settings)

    @property
    def nominal(self) -> RobotModel:
        """The robot without faults and ordinary errors."""
        return NOMINAL

    def robot(self) -> Robot:
        """A fresh robot: the same seed gives the same errors and surroundings, whatever the faults."""
        robot = Robot()
        add_surroundings(robot, stream(self.seed, "surroundings"))
        add_ordinary_errors(robot, stream(self.seed, "ordinary errors"), self.truth.error_scale)
        for install in self.installs:
            install(robot)
        return robot

    def record(self, plan: RecordingPlan, folder: Path) -> None:
        """Simulate and write ``repeats`` logs of each sequence; names are random, and follow from the plan's seed.

        Raises:
            PolicyError: The policy cannot be loaded.
            RealityDivergedError: The simulation broke down; nothing is written.
            OSError: The folder cannot be written.
        """
        policy, robot = load_policy(plan.policy), self.robot()
        runs = [(repeat, number) for repeat in range(plan.repeats) for number in range(len(plan.sequences))]
        # Those of one length run side by side.
        runs.sort(key=lambda run: plan.sequences[run[1]].duration_s)
        made: list[tuple[int, int, RunArrays]] = []
        for _, group in groupby(runs, key=lambda run: plan.sequences[run[1]].duration_s):
            alike = list(group)
            for start in range(0, len(alike), SIDE_BY_SIDE):
                some = alike[start : start + SIDE_BY_SIDE]
                requests = [RunRequest(plan.sequences[n], stream(plan.seed, "run", n, r)) for r, n in some]
                simulated = simulate(robot, policy, requests, self.settings)
                made += [(r, n, run) for (r, n), run in zip(some, simulated, strict=True)]
        for repeat, number, run in made:
            _write(run, policy, plan.sequences[number].name, plan, repeat, number, folder)


def _write(
    run: RunArrays, policy: Policy, sequence: str, plan: RecordingPlan, repeat: int, number: int, folder: Path
) -> None:
    """Write the log of a run, under a name that tells nothing.

    Args:
        run: What came of it.
        policy: That walked it.
        sequence: Name of its sequence.
        plan: What was asked for.
        repeat: Number of the run among those of its sequence.
        number: Of the sequence.
        folder: Of the logs.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rng = stream(plan.seed, "log", number, repeat)
    setting = LogSetting(
        run_id=rng.bytes(16).hex(),
        sequence=sequence,
        repeat=repeat,
        started_host_ns=EPOCH_NS + int(rng.integers(0, 86_400_000_000_000)),
        skew_ns=int(rng.integers(-300_000_000_000, 300_000_000_000)),
        first_state_ns=int(rng.integers(500_000_000, 900_000_000)),
        detail=plan.detail,
        echoes_last_run=bool(rng.random() < 0.5),
    )
    write_log(run, policy, setting, plan.missing, rng, folder / f"{rng.bytes(8).hex()}.mcap")


def make(
    requests: Sequence[FaultRequest],
    seed: int,
    catalogue: Mapping[str, FaultKind],
    settings: Settings | None = None,
    error_scale: float | None = None,
) -> ComposedReality:
    """A reality with these faults; none for one that differs from the nominal model by ordinary errors alone.

    Args:
        requests: What is wrong, and how much.
        seed: Draws errors, surroundings, joints, and the numbers of each fault, each by itself: leaving a request out
            changes nothing else.
        catalogue: Kinds by name.
        settings: How to simulate; drawn by default.
        error_scale: Of the ordinary errors; drawn by default.

    Raises:
        ValueError: A kind is unknown, or cannot act at the place.
    """
    faults: list[Fault] = []
    installs: list[Callable[[Robot], Parameters]] = []
    for number, request in enumerate(requests):
        if request.kind not in catalogue:
            raise ValueError(f"fault {request.kind!r} is unknown; allowed: {', '.join(sorted(catalogue))}")
        kind = catalogue[request.kind]
        again = sum(r.kind == request.kind for r in requests[:number])
        joints = kind.choose_joints(request.place, stream(seed, "place", kind.name, again))
        install = partial(_install, kind, seed, again, request.size, flags_of(joints))
        installs.append(install)
        faults.append(
            Fault(
                names=kind.names,
                joints=joints,
                parameters=install(Robot()),
                family=kind.family,
                size=request.size,
                kind=kind.name,
            )
        )
    scale = draw_scale(stream(seed, "error scale")) if error_scale is None else error_scale
    truth = Truth(faults=tuple(faults), error_scale=scale)
    return ComposedReality(seed, truth, tuple(installs), settings or draw_settings(stream(seed, "settings")))


def _install(kind: FaultKind, seed: int, again: int, size: float, joints: Flags, robot: Robot) -> Parameters:
    """Put a fault into a robot; ``again`` counts the faults of the same kind before it."""
    return kind.install(robot, Ask(stream(seed, "fault", kind.name, again), size, joints))
