"""What one recording of the menu does for the numbers in doubt, beside a random one, on withheld robots.

    python benchmarks/next_withheld.py --seed S --robots N --out DIR [--catalogue judging] [--workers 2]

Of each robot with a single fault one walk is recorded and diagnosed. Of the menu the best recording, and one drawn from
the rest, are run on the robot itself, and each is diagnosed with the walk. Recordings that make the corrected model
fall are left out; the robots of the gate are not simulated. Robots are kept in DIR as they are done, and the same
command goes on. It prints half-widths of the numbers in doubt over what they were, and how often the truth is within.
"""

from __future__ import annotations

import json
import os
from argparse import ArgumentParser
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from many_robots import make_all

from diagnosis.decision_constants import ERROR_SCALES
from diagnosis.document import Verdict, load_verdict
from diagnosis.next.candidates import Motion
from diagnosis.next.doubts import Key, doubts_of
from diagnosis.next.files import opened
from diagnosis.next.menu import board_of, menu_of, weighed_one
from diagnosis.session import Inputs, Progress, run_session
from spot_model.errors import SpotRlError
from spot_model.io.model_file import save_model
from spot_model.io.velocity_sequence import VelocitySequence
from spot_model.io.whole import write_over
from spot_model.policy.built_in import FOLDER
from withheld.cases import Case, draw, kind_of
from withheld.outcome import Outcome, read_verdict
from withheld.plan import RecordingPlan, Truth
from withheld.realities.reality import ComposedReality, make
from withheld.realities.source import CATALOGUES, source_of
from withheld.scoring.scores import is_right
from withheld.simulator.simulation import RealityDivergedError

WAYS: Final = ("best", "random")


def robot(seed: int, number: int, catalogue: str, out: Path) -> str:
    """One robot, unless it is done; a line to print."""
    file = out / f"{number:04d}.json"
    if not file.exists():
        case = draw(seed, number, source_of(catalogue), FOLDER)
        reality = make(case.requests, case.reality_seed, CATALOGUES[catalogue])
        with TemporaryDirectory() as work:
            try:
                told = tried(case, reality, Path(work))
            except (RealityDivergedError, SpotRlError) as error:
                told = {"problem": str(error)}
        write_over(file, json.dumps({"fault": case.requests[0].kind, **told}, indent=1))
    told = json.loads(file.read_text())
    ways = ", ".join(f"{way} {told[way]['recording']}" for way in WAYS if way in told)
    return f"{number}, {told['fault']}: {told.get('problem') or ways or 'nothing is in doubt'}"


def tried(case: Case, reality: ComposedReality, work: Path) -> dict[str, Any]:
    """Walk, diagnose, weigh the menu; then for each way to choose one recording more, and all diagnosed again."""
    policy = (FOLDER / f"{case.policy}.onnx").absolute()
    save_model(reality.nominal, work / "nominal.yaml")

    def found_with(name: str, motions: Sequence[Motion]) -> Path:
        for number, motion in enumerate(motions):
            logs, own_seed = work / name / str(number), case.recording_seed + 101 * number
            if isinstance(motion, VelocitySequence):
                reality.record(RecordingPlan(policy, (motion,), 1, own_seed), logs)
            else:
                reality.perform(motion, own_seed, logs)
        inputs = Inputs(logs=(str(work / name),), nominal=str(work / "nominal.yaml"), policy=str(policy))
        with Progress() as bar:
            run_session(inputs, work / f"{name} found", bar, seed=case.diagnosis_seed)
        return work / f"{name} found"

    walk = case.sequences[0]
    _, found = opened(found_with("walk", [walk]))
    doubts = doubts_of(found.verdict, found.library)
    row: dict[str, Any] = {"before": _state(found.verdict, case, reality.truth, work / "walk found")}
    if not doubts:
        return row
    board = board_of(found, found.runs)
    weighed = [weighed_one(c, found, doubts, board, case.diagnosis_seed) for c in menu_of(found, doubts)]
    safe = sorted((r for r in weighed if not r.refused), key=lambda r: -r.gain)
    rest = safe[1:]
    other = rest[int(np.random.default_rng(case.diagnosis_seed).integers(len(rest)))]
    for way, chosen in zip(WAYS, (safe[0], other), strict=True):
        place = found_with(way, [walk, chosen.candidate.motion])
        row[way] = {
            "recording": chosen.candidate.name,
            "is_worth": chosen.is_worth,
            "expected": {"/".join(key): half for key, half in chosen.after.items()},
            **_state(load_verdict(place / "verdict.json"), case, reality.truth, place),
        }
    row["doubts"] = ["/".join(d.key) for d in doubts]
    return row


def _state(verdict: Verdict, case: Case, truth: Truth, place: Path) -> dict[str, Any]:
    """All numbers of a verdict, each with half-width, published spread and error, and whether the verdict is right."""
    said: dict[Key, tuple[float, float]] = {
        (n.effect, n.parameter, n.where): (n.value, max(n.high - n.value, n.value - n.low))
        for n in verdict.calibration.numbers
    }
    for d in verdict.differences:
        said |= {
            (d.name, name, ""): (p.value, max(p.high - p.value, p.value - p.low)) for name, p in d.parameters.items()
        }
    true = {name: value for fault in truth.faults for name, value in fault.parameters.items()}
    numbers = {}
    for (effect, parameter, where), (value, half) in said.items():
        spread = ERROR_SCALES[effect].scales.get(parameter) if effect in ERROR_SCALES else None
        known = true.get(f"{effect}.{parameter}") if not where else None
        error = None if known is None else abs(value - known)
        numbers[f"{effect}/{parameter}/{where}"] = {"half": half, "spread": spread, "error": error}
    outcome = Outcome(
        case=case,
        truth=truth,
        verdict=read_verdict(place / "verdict.json"),
        moved=(None,),
        seconds={},
    )
    return {"right": is_right(outcome), "numbers": numbers, "differences": [d.name for d in verdict.differences]}


def score(rows: Sequence[dict[str, Any]]) -> list[str]:
    """What came of all robots, in lines."""
    whole = [r for r in rows if "before" in r]
    asked = [r for r in whole if "best" in r]
    lines = [f"{len(rows)} robots, {len(rows) - len(whole)} failed; something is in doubt on {len(asked)}"]
    for way in ("before", *WAYS) if asked else ():
        pairs = [(r["before"]["numbers"][k], r[way]["numbers"].get(k), r, k) for r in asked for k in r["doubts"]]
        there = [(a, b, r, k) for a, b, r, k in pairs if b is not None]
        right = [r[way]["right"] for r in asked if r[way]["right"] is not None]
        lines.append(f"{way}: verdict right {sum(right)} of {len(right)}; {len(there)} of {len(pairs)} numbers stated")
        figures = {
            "half-width over that before": [b["half"] / a["half"] for a, b, _, _ in there],
            "as expected": [r[way]["expected"][k] / a["half"] for a, _, r, k in there] if way in WAYS else [],
            "half-width in published spreads": [b["half"] / b["spread"] for _, b, _, _ in there if b["spread"]],
            "error over half-width": [b["error"] / b["half"] for _, b, _, _ in there if b["error"] is not None],
        }
        lines += [
            f"  {name}, median {np.median(found):.2f} of {len(found)}" for name, found in figures.items() if found
        ]
    return lines


def main() -> None:
    """Read the command line."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--robots", type=int, default=40)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--catalogue", choices=CATALOGUES, default="judging")
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    numbers = [n for n in range(20 * given.robots) if kind_of(given.seed, n) == "single"][: given.robots]
    make_all(robot, [(given.seed, n, given.catalogue, given.out) for n in numbers], given.workers)
    print("\n".join(score([json.loads((given.out / f"{n:04d}.json").read_text()) for n in numbers])))


if __name__ == "__main__":
    main()
