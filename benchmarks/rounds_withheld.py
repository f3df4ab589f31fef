"""How many experiments until the right name: designed ones, a fixed menu in fixed order, and a random one.

    python benchmarks/rounds_withheld.py robots --out DIR [--seed S] [--to 40] [--catalogue judging] [--workers 32]
    python benchmarks/rounds_withheld.py score DIR

``robots`` draws single faults as the withheld check does, by a seed of the operating system or a given one. Of each
robot whose fault moves the gap by twice its floor it records one short walk and diagnoses it; then each strategy asks
for up to two experiments more, and ends when one cause stands, as ``spot-rl diagnose next --run`` does. Every step is
written as it is made. After ``--until`` seconds it stops at once, and the same command goes on; what is large (logs,
reports) lies in ``--work``, and is made again where it is gone. ``score`` prints shares with their 95 % intervals.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from diagnosis.next.candidates import Candidate, candidates
from diagnosis.next.design import Design, Information, Proposal, design
from diagnosis.next.robots import beliefs
from diagnosis.next.rounds import SURE, WHOLE, Answer, Lab, Limits, RobotRun, Story, ask_robot, read_story
from diagnosis.next.session import diagnosed, found_in
from diagnosis.session import Inputs
from diagnosis.verdict.posterior_file import Posterior
from spot_model.errors import SpotRlError
from spot_model.io.model_file import save_model
from spot_model.io.velocity_sequence import VelocitySequence
from spot_model.io.whole import write_over
from spot_model.policy.built_in import FOLDER
from spot_model.policy.policy import Policy, load_policy
from spot_model.robot import facts
from trainer.simulate.engine import Engine, Place, Tell
from withheld.cases import WHOLE_RUN, Case, draw, kind_of
from withheld.measuring import TWIN_REPEATS, moved, record_runs, walk_of_run
from withheld.outcome import Outcome, read_verdict
from withheld.plan import RecordingPlan
from withheld.realities.reality import ComposedReality, make
from withheld.realities.source import CATALOGUES, source_of
from withheld.scoring.scores import LARGE, differences, is_right
from withheld.scoring.statistics import Estimate, Share, mean
from withheld.simulator.simulation import RealityDivergedError

POLICIES: Final = FOLDER
ROUNDS: Final = 2
WALKS: Final = 1
"""Command sequences of the first logs, once each."""
IN_GROUP: Final = 0.05
"""A cause of this probability is in the group that the first logs leave."""
FIRST: Final = "first"
STRATEGIES: Final = ("designed", "menu", "random")
Choose = Callable[[Posterior, int, Sequence[str], float], Design]


@dataclass(frozen=True)
class Setting:
    """What all robots have in common."""

    seed: int
    catalogue: str
    out: Path
    """For what is small."""
    work: Path
    """For logs and reports."""


@dataclass(frozen=True)
class Subject:
    """A robot, and where what is known of it goes."""

    case: Case
    reality: ComposedReality
    policy: Path
    out: Path
    work: Path

    @staticmethod
    def of(setting: Setting, number: int) -> Subject:
        """Draw it."""
        case = draw(setting.seed, number, source_of(setting.catalogue), POLICIES)
        reality = make(case.requests, case.reality_seed, CATALOGUES[setting.catalogue])
        policy = (POLICIES / f"{case.policy}.onnx").absolute()
        return Subject(case, reality, policy, setting.out / f"{number:04d}", setting.work / f"{number:04d}")

    @property
    def plan(self) -> RecordingPlan:
        """Of the first logs."""
        return RecordingPlan(self.policy, self.case.sequences[:WALKS], 1, self.case.recording_seed)

    def inputs(self) -> Inputs:
        """Of the first diagnosis; records its logs where they are gone."""
        place, part = self.work / "given", self.work / f"given-{os.getpid()}"
        if not place.exists():
            self.reality.record(self.plan, part)
            save_model(self.reality.nominal, part / "nominal.yaml")
            with suppress(OSError):  # another strategy was faster
                part.rename(place)
        logs = tuple(str(path) for path in sorted(place.glob("*.mcap")))
        return Inputs(logs=logs, nominal=str(place / "nominal.yaml"), policy=str(self.policy))


def opened(own: Subject, catalogue: str) -> dict[str, Any]:
    """Measure how far the fault moves the robot; diagnose its first log where that matters."""
    twin = make((), own.case.reality_seed, CATALOGUES[catalogue])
    twins = RecordingPlan(own.policy, own.plan.sequences, TWIN_REPEATS, own.case.recording_seed + 1)
    told: dict[str, Any] = {"kind": own.case.requests[0].kind, "names": list(own.reality.truth.faults[0].names)}
    try:
        policy = load_policy(own.policy)
        with TemporaryDirectory() as folder:
            runs, healthy = (
                [walk_of_run(run, policy) for run in record_runs(reality, plan, Path(folder) / name)]
                for name, reality, plan in (("with", own.reality, own.plan), ("without", twin, twins))
            )
        by = moved(runs, healthy)
        told["moved"] = None if by is None else round(by, 3)
        if by is not None and by >= LARGE:
            inputs, place = own.inputs(), own.work / FIRST
            shutil.rmtree(place, ignore_errors=True)
            told["first"] = diagnosed(inputs, (), place).odds
            kept = own.out / FIRST
            kept.mkdir(parents=True, exist_ok=True)
            for name in ("verdict.json", "posterior.json"):
                shutil.copy(place / name, kept / name)
    except (RealityDivergedError, SpotRlError) as error:
        told["problem"] = str(error)
    return told


def choosing(name: str, policy: Policy, case: Case, seed: int) -> Choose:
    """How the next experiment is chosen."""
    if name == "designed":
        return lambda own, number, less, left_s: design(own, policy, number, excluded=less, wanted=1, most_s=left_s)
    menu = candidates(policy.contract, facts.JOINT_NAMES[:3])
    order = np.random.default_rng([seed, 7]).permutation(len(menu)) if name == "random" else range(len(menu))
    return lambda own, number, *_: _alone(own, menu[order[number - case.diagnosis_seed]])


def _alone(own: Posterior, candidate: Candidate) -> Design:
    odds = beliefs(own)
    told = Information(1.0, 1.0, np.zeros((len(odds), len(odds))))
    proposal = Proposal(candidate, candidate.motion(), told, "", is_proved=True)
    return Design(tuple(odds), np.array([*odds.values()]), (proposal,))


def played(own: Subject, name: str, seed: int) -> Story:
    """The rounds of one strategy on one robot; a round that was interrupted is made again."""
    inputs, place, kept = own.inputs(), own.work / name, own.out / f"{name}.json"
    policy, first = load_policy(own.policy), found_in(own.out / FIRST)
    place.mkdir(exist_ok=True)

    def run(chosen: Proposal, folder: Path) -> RobotRun:
        logs, motion = folder / "logs", chosen.motion
        own_seed = own.case.recording_seed + 101 + len(chosen.candidate.name)
        try:
            if isinstance(motion, VelocitySequence):
                own.reality.record(RecordingPlan(own.policy, (motion,), 1, own_seed), logs)
            else:
                own.reality.perform(motion, own_seed, logs)
        except RealityDivergedError as error:
            return RobotRun(None, chosen.robot_s, str(error))
        return RobotRun(next(logs.glob("*.mcap")), chosen.robot_s, WHOLE)

    def told(story: Story) -> None:
        is_done = bool(story.ending)
        write_over(place / "story.json", story.to_json())
        write_over(kept, json.dumps({"is_done": is_done, **_told(own, first, story)}, indent=1))

    lab = Lab(
        place,
        choosing(name, policy, own.case, seed),
        lambda *_: True,
        run,
        lambda logs, out: diagnosed(inputs, logs, out),
        found_in,
        lambda _: None,
        told,
    )
    return ask_robot(read_story(place / "story.json", first), lab, Limits(1e9, ROUNDS), own.case.diagnosis_seed)


def _told(own: Subject, first: Answer, story: Story) -> dict[str, Any]:
    """What is scored of a story, round by round; the first row is of the first log alone."""
    rounds = [(0.0, read_verdict(first.folder / "verdict.json"))]
    for asked in story.rounds:
        before_s, before = rounds[-1]
        new = read_verdict(Path(asked.found) / "verdict.json") if asked.found else before
        rounds.append((before_s + asked.robot_s, new))
    size = json.loads((own.out / "robot.json").read_text())["moved"]
    odds = [first.odds, *(r.after for r in story.rounds)]
    rows = []
    for k, (robot_s, verdict) in enumerate(rounds):
        outcome = Outcome(
            case=own.case,
            truth=own.reality.truth,
            verdict=verdict,
            moved=(size,),
            seconds={},
        )
        is_so = bool(is_right(outcome))
        rows.append(
            {
                "right": is_so,
                "alone": is_so and all(len(d.names) == 1 for d in differences(verdict)),
                "robot_s": robot_s,
                "odds": odds[k],
                "asked": story.rounds[k - 1].name if k else "",
                "outcome": story.rounds[k - 1].outcome if k else "",
                "expected_bits": story.rounds[k - 1].expected_bits if k else 0.0,
                "status": verdict.status,
            }
        )
    return {"rows": rows, "ending": story.ending}


Task = tuple[int, str]
"""Number of a robot, and :data:`FIRST` or a strategy."""


def work(setting: Setting, task: Task, _: Tell) -> str:
    """One step of one robot; a line to print."""
    number, step = task
    began_s, own = time.monotonic(), Subject.of(setting, number)
    if step == FIRST:
        told = opened(own, setting.catalogue)
        own.out.mkdir(parents=True, exist_ok=True)
        write_over(own.out / "robot.json", json.dumps(told, indent=1))
        says = f"{told['kind']}, moved {told.get('moved')}, {told.get('problem') or told.get('first') or ''}"
    else:
        story = played(own, step, setting.seed + number)
        says = f"{[r.name for r in story.rounds]}, {story.ending}"
    return f"{number} {step}: {says}; {time.monotonic() - began_s:.0f} s"


def _next(setting: Setting, number: int, names: Sequence[str]) -> list[Task]:
    """What a robot lacks."""
    folder = setting.out / f"{number:04d}"
    if not (folder / "robot.json").exists():
        return [(number, FIRST)]
    if not (folder / FIRST / "posterior.json").exists():
        return []
    made = {n: json.loads((folder / f"{n}.json").read_text()) for n in names if (folder / f"{n}.json").exists()}
    return [(number, n) for n in names if not made.get(n, {}).get("is_done")]


def robots(given: Namespace) -> None:
    """Make what is missing, robot by robot, on all workers."""
    end_s = time.monotonic() + given.until
    out = given.out.absolute()
    out.mkdir(parents=True, exist_ok=True)
    head = out / "run.json"
    if not head.exists():
        seed = secrets.randbits(31) if given.seed is None else given.seed
        write_over(head, json.dumps({"seed": seed, "catalogue": given.catalogue}))
    run = json.loads(head.read_text())
    setting = Setting(run["seed"], run["catalogue"], out, (given.work or out / "work").absolute())
    print(f"seed {setting.seed}, {setting.catalogue} catalogue", flush=True)
    waiting: list[tuple[bool, Task]] = []

    def add(number: int) -> None:
        for task in _next(setting, number, given.strategies):
            heappush(waiting, (task[1] == FIRST, task))

    for number in (n for n in range(given.to) if kind_of(setting.seed, n) == "single"):
        add(number)
    place = Place(given.workers, is_apart=True)
    running: dict[Any, Task] = {}
    try:
        with Engine(work, setting, place) as engine:
            while waiting or running:
                while waiting and len(running) < engine.places:
                    task = heappop(waiting)[1]
                    running[engine.start(task)] = task
                for ticket in engine.finished(list(running), min(5.0, max(0.1, end_s - time.monotonic()))):
                    task = running.pop(ticket)
                    try:
                        print(engine.result(ticket), flush=True)
                    except Exception as error:  # noqa: BLE001 - one broken robot must not end the others
                        print(f"{task[0]} {task[1]} failed: {type(error).__name__}: {error}", flush=True)
                        continue
                    if task[1] == FIRST:
                        add(task[0])
                if time.monotonic() > end_s:
                    raise TimeoutError
    except TimeoutError:
        print(f"stopped after {given.until:.0f} s; {len(waiting) + len(running)} steps are left at least")


def score(given: Namespace) -> None:
    """Print what came of all robots before the first that is not finished; a strategy that ended keeps its last row."""
    run = json.loads((given.folder / "run.json").read_text())
    names = tuple(n for n in STRATEGIES if any(given.folder.glob(f"*/{n}.json")))
    rows: list[tuple[dict[str, Any], dict[str, list[dict[str, Any]]]]] = []
    n_robots, n_failed, end = 0, 0, given.to
    for number in (n for n in range(given.to) if kind_of(run["seed"], n) == "single"):
        folder = given.folder / f"{number:04d}"
        file = folder / "robot.json"
        robot = json.loads(file.read_text()) if file.exists() else {"first": None}
        made = {n: json.loads(p.read_text()) for n in names if (p := folder / f"{n}.json").exists()}
        if "first" in robot and not all(made.get(n, {}).get("is_done") for n in names):
            # Robots that need few experiments are finished first: those beyond would be no fair part.
            end = number
            break
        n_robots, n_failed = n_robots + 1, n_failed + ("problem" in robot)
        if "first" in robot:
            rows.append((robot, {n: story["rows"] for n, story in made.items()}))
    print(f"seed {run['seed']}, {run['catalogue']} catalogue: {n_robots} robots before case {end}; {n_failed} failed")
    grouped = [row for row in rows if sum(p >= IN_GROUP for p in row[0]["first"].values()) in (2, 3)]
    for words, some in (("whose fault moves the gap", rows), ("and whose first log leaves two or three", grouped)):
        print(f"robots {words}: {len(some)}")
        for name in names if some else ():
            _print_strategy(name, [(robot, made[name]) for robot, made in some])
        if some and {"designed", "menu"} <= set(names):
            pairs = [(made["designed"][-1]["robot_s"], made["menu"][-1]["robot_s"]) for _, made in some]
            ratio = Estimate.of(pairs, lambda v: float(v[:, 0].sum() / max(v[:, 1].sum(), 1e-9)))
            print(f"  robot time, designed over menu: {ratio}")


def _print_strategy(name: str, some: Sequence[tuple[dict[str, Any], list[dict[str, Any]]]]) -> None:
    for k in range(ROUNDS + 1):
        at = [(robot, rows[min(k, len(rows) - 1)]) for robot, rows in some]
        top = [
            (_is_truth(cause, robot), p >= SURE) for robot, row in at for cause, p in [next(iter(row["odds"].items()))]
        ]
        print(f"  {name}, after {k} experiments, {Estimate.of([row['robot_s'] for _, row in at], mean)} s:")
        print(f"    verdict right {Share.of([row['right'] for _, row in at])}")
        print(f"    verdict right, by one name {Share.of([row['alone'] for _, row in at])}")
        print(f"    likeliest cause right {Share.of([hit for hit, _ in top])}")
        print(f"    one cause stands {Share.of([s for _, s in top])}, rightly {Share.of([h for h, s in top if s])}")
    bits = [
        (after["expected_bits"], _bits(after["odds"], robot) - _bits(before["odds"], robot))
        for robot, rows in some
        for before, after in pairwise(rows)
    ]
    if bits and name == "designed":
        expected, gained = (Estimate.of([b[i] for b in bits], mean) for i in (0, 1))
        print(f"  {name}: bits expected {expected}, gained for the truth {gained}")


def _is_truth(cause: str, robot: dict[str, Any]) -> bool:
    return cause in {n.replace("_", " ") for n in robot["names"]}


def _bits(odds: dict[str, float], robot: dict[str, Any]) -> float:
    return float(np.log2(max(sum(p for cause, p in odds.items() if _is_truth(cause, robot)), 1e-3)))


def main() -> None:
    """Read the command line."""
    parser = ArgumentParser(description=__doc__)
    steps = parser.add_subparsers(required=True)
    one = steps.add_parser("robots")
    one.add_argument("--seed", type=int, help="By default one of the operating system's.")
    one.add_argument("--out", type=Path, required=True)
    one.add_argument("--work", type=Path, help="For logs and reports; by default OUT/work.")
    one.add_argument("--catalogue", choices=CATALOGUES, default="judging")
    one.add_argument("--strategies", nargs="+", choices=STRATEGIES, default=STRATEGIES)
    one.add_argument("--workers", type=int, default=1)
    one.add_argument("--until", type=float, default=1e9, help="Stop after so many seconds.")
    one.set_defaults(step=robots)
    two = steps.add_parser("score")
    two.add_argument("folder", type=Path)
    two.set_defaults(step=score)
    for part in (one, two):
        part.add_argument("--to", type=int, default=WHOLE_RUN, help="Numbers of cases are below this.")
    given = parser.parse_args()
    given.step(given)


if __name__ == "__main__":
    main()
