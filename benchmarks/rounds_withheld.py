"""How many experiments until the right name: designed ones, a fixed menu in fixed order, and a random one.

    python benchmarks/rounds_withheld.py robots --seed 31 --to 40 --out DIR [--until 600]
    python benchmarks/rounds_withheld.py score DIR

``robots`` draws single faults as the withheld check does, records two short walks of each robot, diagnoses them, and
lets each strategy ask for up to two experiments more; a strategy ends when one cause stands, as ``spot-rl diagnose next
--run`` does. It can be interrupted, and goes on. ``score`` prints how often the verdict is what a perfect diagnosis
would say after none, one and two experiments, and the robot time that was used.
"""

from __future__ import annotations

import json
import tempfile
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterator, Sequence
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
from withheld.cases.source import source_of
from withheld.measuring.distances import TWIN_REPEATS, moved
from withheld.outcome import Outcome, Round
from withheld.plan import RecordingPlan
from withheld.realities.judging.catalogue import CATALOGUE
from withheld.realities.reality import ComposedReality, make
from withheld.scoring.scores import is_right
from withheld.simulator.simulation import RealityDivergedError
from withheld.verdict import read_verdict

POLICIES: Final = Path("policies")
ROUNDS: Final = 2
WALKS: Final = 2
"""Command sequences of the first logs, once each."""
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


def robot(seed: int, number: int, out: Path) -> str:
    """One robot with all strategies; a line to print."""
    file = out / f"{seed}-{number:04d}.json"
    if file.exists():
        return f"{number}: there"
    began_s = time.monotonic()
    case = draw(seed, number, source_of("judging"), POLICIES)
    policy = load_policy(POLICIES / f"{case.policy}.onnx")
    reality = make(case.requests, case.reality_seed, CATALOGUE)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        plan = RecordingPlan(POLICIES / f"{case.policy}.onnx", case.sequences[:WALKS], 1, case.recording_seed)
        twins = RecordingPlan(plan.policy, plan.sequences, TWIN_REPEATS, case.recording_seed + 1)
        try:
            made = reality.rehearse(plan)
            by = moved(made.walks(policy), make((), case.reality_seed, CATALOGUE).rehearse(twins).walks(policy))
        except RealityDivergedError:
            return f"{number}: its simulation broke down"
        made.write(folder / "logs")
        save_model(reality.nominal, folder / "nominal.yaml")
        logs = tuple(str(p) for p in sorted((folder / "logs").glob("*.mcap")))
        given = Inputs(logs=logs, nominal=str(folder / "nominal.yaml"), policy=str(plan.policy.absolute()))
        first = diagnosed(given, (), folder / "first")
        kept: dict[str, Any] = {"kind": case.requests[0].kind, "moved": by, "first": first.odds, "strategies": {}}
        for strategy, choose in strategies(policy, seed + number).items():
            story = asked(first, reality, case, given, choose, folder / strategy)
            if story.is_interrupted:
                raise KeyboardInterrupt
            found = [first.folder, *(Path(r.found) if r.found else first.folder for r in story.rounds)]
            spent = np.cumsum([0.0, *(r.robot_s for r in story.rounds)])
            rounds = tuple(
                Round(experiments=k, robot_s=float(s), verdict=read_verdict(f / "verdict.json"))
                for k, (f, s) in enumerate(zip(found, spent, strict=True))
            )
            outcome = Outcome(
                case=case,
                truth=reality.truth,
                rounds=rounds,
                moved=(by,),
                seal="",
                verdict_sha256="",
                locked_in="none",
                seconds={},
            )
            kept["strategies"][strategy] = {
                "right": [is_right(outcome, k) for k in range(len(rounds))],
                "robot_s": [r.robot_s for r in rounds],
                "asked": [r.name for r in story.rounds],
                "odds": [first.odds, *(r.after for r in story.rounds)],
                "ending": story.ending,
            }
    file.write_text(json.dumps(kept, indent=1))
    told = "; ".join(f"{n}: {s['right']} {s['asked']}" for n, s in kept["strategies"].items())
    return f"{number}: {kept['kind']}, moved {by}; {told}; {time.monotonic() - began_s:.0f} s"


def robots(given: Namespace) -> None:
    """Make what is missing."""
    given.out.mkdir(parents=True, exist_ok=True)
    began_s = time.monotonic()
    for number in (n for n in range(given.to) if kind_of(given.seed, n) == "single"):
        if time.monotonic() - began_s < given.until:
            print(robot(given.seed, number, given.out), flush=True)


def score(given: Namespace) -> None:
    """Print shares and seconds; a strategy that ended keeps its last verdict."""
    rows = [json.loads(path.read_text()) for path in sorted(given.folder.glob("*.json"))]
    for strategy in ("designed", "menu", "random"):
        own = [r["strategies"][strategy] for r in rows if r["strategies"][strategy]["right"][0] is not None]
        told = []
        for k in range(ROUNDS + 1):
            right = sum(bool(s["right"][min(k, len(s["right"]) - 1)]) for s in own)
            seconds = np.mean([s["robot_s"][min(k, len(s["robot_s"]) - 1)] for s in own])
            told.append(f"after {k}: {right} of {len(own)} right, {seconds:.0f} s")
        print(f"{strategy}: {'; '.join(told)}")


def main() -> None:
    """Read the command line."""
    parser = ArgumentParser(description=__doc__)
    steps = parser.add_subparsers(required=True)
    one = steps.add_parser("robots")
    one.add_argument("--seed", type=int, required=True)
    one.add_argument("--to", type=int, required=True)
    one.add_argument("--out", type=Path, required=True)
    one.add_argument("--until", type=float, default=1e9, help="begin no robot after so many seconds")
    one.set_defaults(step=robots)
    two = steps.add_parser("score")
    two.add_argument("folder", type=Path)
    two.set_defaults(step=score)
    given = parser.parse_args()
    given.step(given)


if __name__ == "__main__":
    main()
