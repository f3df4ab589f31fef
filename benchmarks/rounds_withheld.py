"""How many experiments until the right name: designed ones, a fixed menu in fixed order, and a random one.

    python benchmarks/rounds_withheld.py robots --seed 31 --to 40 --out DIR [--catalogue judging] [--until 600]
    python benchmarks/rounds_withheld.py score DIR

``robots`` draws single faults as the withheld check does, records one short walk of each robot, diagnoses it, and lets
each strategy ask for up to two experiments more; a strategy ends when one cause stands, as ``spot-rl diagnose next
--run`` does. It can be interrupted, and goes on. ``score`` prints how often the verdict is what a perfect diagnosis
would say after none, one and two experiments, over robots whose fault moves the gap by twice its floor, and the robot
time that was used; then the same over those whose first log leaves a group of two or three causes.
"""

from __future__ import annotations

import json
import shutil
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from diagnosis.next.choose.candidates import Candidate, candidates
from diagnosis.next.choose.design import Design, Proposal, design
from diagnosis.next.choose.information import Told
from diagnosis.next.choose.robots import beliefs
from diagnosis.next.inputs import Inputs
from diagnosis.next.robot_run import WHOLE, Ran
from diagnosis.next.rounds import Lab, Limits, ask_robot
from diagnosis.next.session import diagnosed, found_in
from diagnosis.next.story import Found, Story
from diagnosis.verdict.posterior_file import Posterior
from spot_model.io.model_file import save_model
from spot_model.io.velocity_sequence import VelocitySequence
from spot_model.policy.policy import Policy, load_policy
from spot_model.robot import facts
from withheld.cases.draw import Case, draw, kind_of
from withheld.cases.source import CATALOGUES, source_of
from withheld.measuring.distances import TWIN_REPEATS, moved
from withheld.outcome import Outcome, Round
from withheld.plan import RecordingPlan
from withheld.realities.reality import ComposedReality, make
from withheld.scoring.scores import is_right
from withheld.scoring.sizes import Size, size_of
from withheld.scoring.statistics import Share
from withheld.simulator.simulation import RealityDivergedError
from withheld.verdict import read_verdict

POLICIES: Final = Path("policies")
ROUNDS: Final = 2
WALKS: Final = 1
"""Command sequences of the first logs, once each."""
IN_GROUP: Final = 0.05
"""A cause of this probability is in the group that the first logs leave."""
STRATEGIES: Final = ("designed", "menu", "random")
Choose = Callable[[Posterior, int, Sequence[str]], Design]


def strategies(policy: Policy, seed: int) -> dict[str, Choose]:
    """How the next experiment is chosen, by name."""
    menu = candidates(policy.contract, facts.JOINT_NAMES[:3])
    order = np.random.default_rng([seed, 7]).permutation(len(menu))
    return {
        "designed": lambda own, number, less: design(own, policy, number, excluded=less),
        "menu": _listed(iter(menu)),
        "random": _listed(iter([menu[i] for i in order])),
    }


def _listed(items: Iterator[Candidate]) -> Choose:
    def choose(own: Posterior, seed: int, excluded: Sequence[str]) -> Design:
        del seed, excluded
        odds, candidate = beliefs(own), next(items)
        told = Told(1.0, 1.0, np.zeros((len(odds), len(odds))))
        return Design(tuple(odds), np.array([*odds.values()]), (Proposal(candidate, candidate.motion(), told, ""),))

    return choose


def asked(first: Found, reality: ComposedReality, case: Case, given: Inputs, choose: Choose, folder: Path) -> Story:
    """The rounds of one strategy on one robot."""

    def run(chosen: Proposal, place: Path) -> Ran:
        logs, motion = place / "logs", chosen.motion
        seed = case.recording_seed + 101 + len(chosen.candidate.name)
        if isinstance(motion, VelocitySequence):
            reality.record(RecordingPlan(Path(given.policy or ""), (motion,), 1, seed), logs)
        else:
            reality.perform(motion, seed, logs)
        return Ran(next(logs.glob("*.mcap")), chosen.robot_s, WHOLE)

    lab = Lab(
        folder, choose, lambda *_: True, run, lambda logs, out: diagnosed(given, logs, out), found_in, lambda _: None
    )
    return ask_robot(Story(first), lab, Limits(1e9, ROUNDS), case.diagnosis_seed, lambda _: None)


@dataclass(frozen=True)
class Subject:
    """A robot with its first diagnosis."""

    case: Case
    reality: ComposedReality
    inputs: Inputs
    first: Found
    moved: float | None


def subject(given: Namespace, number: int, folder: Path) -> Subject | None:
    """Draw, record and diagnose a robot; or open what an earlier start made. None where its simulation breaks down."""
    case = draw(given.seed, number, source_of(given.catalogue), POLICIES)
    catalogue = CATALOGUES[given.catalogue]
    reality = make(case.requests, case.reality_seed, catalogue)
    path = POLICIES / f"{case.policy}.onnx"
    plan = RecordingPlan(path, case.sequences[:WALKS], 1, case.recording_seed)
    file = folder / "robot.json"
    if not file.exists():
        shutil.rmtree(folder, ignore_errors=True)
        twins = RecordingPlan(path, plan.sequences, TWIN_REPEATS, case.recording_seed + 1)
        policy = load_policy(path)
        try:
            made = reality.rehearse(plan)
            by = moved(made.walks(policy), make((), case.reality_seed, catalogue).rehearse(twins).walks(policy))
        except RealityDivergedError:
            return None
        made.write(folder / "logs")
        save_model(reality.nominal, folder / "nominal.yaml")
    logs = tuple(str(p) for p in sorted((folder / "logs").glob("*.mcap")))
    inputs = Inputs(logs=logs, nominal=str(folder / "nominal.yaml"), policy=str(path.absolute()))
    if not file.exists():
        first = diagnosed(inputs, (), folder / "first")
        file.write_text(json.dumps({"kind": case.requests[0].kind, "moved": by, "first": first.odds}, indent=1))
    kept = json.loads(file.read_text())
    return Subject(case, reality, inputs, found_in(folder / "first"), kept["moved"])


def played(own: Subject, choose: Choose, folder: Path) -> dict[str, Any]:
    """What came of one strategy."""
    shutil.rmtree(folder, ignore_errors=True)  # of an interrupted start
    folder.mkdir()
    story = asked(own.first, own.reality, own.case, own.inputs, choose, folder)
    if story.is_interrupted:
        raise KeyboardInterrupt
    found = [own.first.folder, *(Path(r.found) if r.found else own.first.folder for r in story.rounds)]
    spent = np.cumsum([0.0, *(r.robot_s for r in story.rounds)])
    rounds = tuple(
        Round(experiments=k, robot_s=float(s), verdict=read_verdict(f / "verdict.json"))
        for k, (f, s) in enumerate(zip(found, spent, strict=True))
    )
    outcome = Outcome(
        case=own.case,
        truth=own.reality.truth,
        rounds=rounds,
        moved=(own.moved,),
        seal="",
        verdict_sha256="",
        locked_in="none",
        seconds={},
    )
    return {
        "right": [is_right(outcome, k) for k in range(len(rounds))],
        "robot_s": [r.robot_s for r in rounds],
        "asked": [r.name for r in story.rounds],
        "odds": [own.first.odds, *(r.after for r in story.rounds)],
        "ending": story.ending,
    }


def robots(given: Namespace) -> None:
    """Make what is missing, a line a strategy."""
    late_s = time.monotonic() + given.until
    for number in (n for n in range(given.to) if kind_of(given.seed, n) == "single"):
        folder = given.out.absolute() / f"{given.seed}-{number:04d}"
        if time.monotonic() > late_s or all((folder / f"{name}.json").exists() for name in STRATEGIES):
            continue
        own = subject(given, number, folder)
        if own is None:
            print(f"{number}: its simulation broke down", flush=True)
            continue
        policy = load_policy(Path(own.inputs.policy or ""))
        for name, choose in strategies(policy, given.seed + number).items():
            file, began_s = folder / f"{name}.json", time.monotonic()
            if file.exists() or began_s > late_s:
                continue
            told = played(own, choose, folder / name)
            file.write_text(json.dumps(told, indent=1))
            kind = f"{own.case.requests[0].kind}, moved {own.moved or float('nan'):.1f}"
            seconds = time.monotonic() - began_s
            print(f"{number}: {kind}; {name}: {told['right']} {told['asked']}; {seconds:.0f} s", flush=True)


def score(given: Namespace) -> None:
    """Print shares with their 95 % intervals, and seconds; a strategy that ended keeps its last verdict."""
    rows = []
    for folder in sorted(path.parent for path in given.folder.glob("*/robot.json")):
        made = {
            n: json.loads((folder / f"{n}.json").read_text()) for n in STRATEGIES if (folder / f"{n}.json").exists()
        }
        rows.append((json.loads((folder / "robot.json").read_text()), made))
    print(f"{len(rows)} robots, {sum(size_of(r['moved']) is Size.LARGE for r, _ in rows)} moved by their fault")
    large = [(r, made) for r, made in rows if size_of(r["moved"]) is Size.LARGE]
    grouped = [(r, made) for r, made in large if sum(p >= IN_GROUP for p in r["first"].values()) in (2, 3)]
    for words, some in (
        ("whose fault moves the gap", large),
        ("and whose first log leaves two or three causes", grouped),
    ):
        print(f"robots {words}: {len(some)}")
        for name in STRATEGIES:
            own = [made[name] for _, made in some if name in made]
            for k in range(ROUNDS + 1 if own else 0):
                right = Share.of([bool(s["right"][min(k, len(s["right"]) - 1)]) for s in own])
                seconds = np.mean([s["robot_s"][min(k, len(s["robot_s"]) - 1)] for s in own])
                print(f"  {name}, after {k}: right {right}, {seconds:.0f} s of robot time")


def main() -> None:
    """Read the command line."""
    parser = ArgumentParser(description=__doc__)
    steps = parser.add_subparsers(required=True)
    one = steps.add_parser("robots")
    one.add_argument("--seed", type=int, required=True)
    one.add_argument("--to", type=int, required=True)
    one.add_argument("--out", type=Path, required=True)
    one.add_argument("--catalogue", choices=CATALOGUES, default="judging")
    one.add_argument("--until", type=float, default=1e9, help="begin no robot after so many seconds")
    one.set_defaults(step=robots)
    two = steps.add_parser("score")
    two.add_argument("folder", type=Path)
    two.set_defaults(step=score)
    given = parser.parse_args()
    given.step(given)


if __name__ == "__main__":
    main()
