"""Fits the numbers of ``decision_constants.py`` to simulated robots whose faults are known.

    python benchmarks/calibrate_diagnosis.py robots --seed 20261 --to 240 --out FOLDER [--workers 2] [--until 3600]
    python benchmarks/calibrate_diagnosis.py fit FOLDER

``robots`` draws cases as the withheld check does, but of its calibrating catalogue, and keeps what each diagnosis
compared: it can be interrupted, and goes on. A robot whose fault moves it is diagnosed twice, the second time by a
library without its effects, and S of the delivered model is measured on new sequences. ``fit`` prints, with how many
robots they rest on: the distance that faultless robots keep from models with their ordinary errors, and what their
signals leave; the logistic regressions of "the effect is there" on evidence and distance, and of "something unknown
matters" on the distance and what signals predict of the residuals that are left; the regression of how far a fault
moves a robot on how far it moves its model; and S where the right effect was named, as stated and as measured.
"""

from __future__ import annotations

import json
import tempfile
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any, Final

import numpy as np
from sklearn.linear_model import LogisticRegression

from diagnosis.closed_loop.engine import LocalEngine
from diagnosis.closed_loop.trials import Bench
from diagnosis.decision_constants import LARGEST_ERRORS, LEFT_SHARE, ORDINARY_EXCESS, USUAL_LEFT
from diagnosis.library.base import LibraryEffect
from diagnosis.library.registry import LIBRARY
from diagnosis.read.prepare import prepared
from diagnosis.read.robot_file import SPOT
from diagnosis.selection.scoring import null_of
from diagnosis.verdict.causes import ERRORS, Causes, decide
from diagnosis.verdict.diagnose import diagnose
from diagnosis.verdict.explain import explain
from diagnosis.verdict.left_over import excess, only_alike
from diagnosis.verdict.posterior import ordinary_gap, runs_apart
from spot_log import read_run
from spot_log.read.run import Run
from spot_model.errors import SpotRlError
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy, load_policy
from withheld.cases.draw import Case, chosen, draw
from withheld.cases.sequences import ordinary_sequences
from withheld.cases.source import Source, source_of
from withheld.measuring.distances import SHRINK_REPEATS, TWIN_REPEATS, make_runs, moved, true_shrink
from withheld.plan import Reality, RecordingPlan
from withheld.scoring.sizes import LARGE, SMALL
from withheld.simulator.simulation import RealityDivergedError

KINDS: Final = ("faultless", "single", "double", "outside")
POLICIES: Final = Path("policies")


def robot(seed: int, number: int, out: Path) -> str:
    """Simulate and diagnose one robot, and write what was compared; returns a line to print."""
    file = out / f"{seed}-{number:04d}.json"
    if file.exists():
        return f"{number}: there"
    began_s = time.monotonic()
    source = source_of("calibrating")
    case = draw(seed, number, source, POLICIES)
    policy = load_policy(POLICIES / f"{case.policy}.onnx")
    try:
        reality, runs, by = recorded(case, source, policy)
    except RealityDivergedError:
        return f"{number}: its simulation broke down"
    faults = [{"names": fault.names, "moved": m} for fault, m in zip(reality.truth.faults, by, strict=True)]
    hidden = {name for fault in reality.truth.faults for name in fault.names}
    whole = {name: entry for name, entry in LIBRARY.items() if name not in case.without}
    kept: dict[str, Any] = {
        "number": number,
        "kind": case.kind,
        "n_runs": len(runs),
        "error_scale": reality.truth.error_scale,
        "faults": faults,
    }
    whole_rng = np.random.default_rng(case.diagnosis_seed)
    whole_found = diagnose(runs, reality.nominal, policy, whole_rng, lambda _: None, library=whole)
    kept |= compared(whole_found.causes) | {"status": whole_found.verdict.status, "policy": case.policy}
    if any(m is not None and m >= LARGE for m in by):
        shrink = whole_found.verdict.shrink
        kept["named"] = [effect.name for effect in whole_found.verdict.effects]
        kept["stated_s"] = None if shrink is None else shrink.s
        kept["true_s"] = new_shrink(case, reality, whole_found.corrected, policy)
        if hidden:
            less = {name: entry for name, entry in whole.items() if name not in hidden}
            kept["without"] = diagnosed(runs, reality.nominal, policy, less, case.diagnosis_seed)
    file.write_text(json.dumps(kept))
    return f"{number}: {case.kind}, {time.monotonic() - began_s:.0f} s"


def recorded(case: Case, source: Source, policy: Policy) -> tuple[Reality, list[Run], list[float | None]]:
    """A case's robot, its logs as a diagnosis reads them, and how far each fault moves it, in floors.

    Raises:
        RealityDivergedError: Its simulation broke down.
    """
    path = POLICIES / f"{case.policy}.onnx"

    def plan(repeats: int, recording_seed: int) -> RecordingPlan:
        return RecordingPlan(path, case.sequences, repeats, recording_seed, frozenset(case.missing), case.detail)

    with tempfile.TemporaryDirectory() as folder:
        logs = Path(folder) / "logs"
        logs.mkdir()
        reality = source.make(case.requests, case.reality_seed)
        made = make_runs(reality, plan(case.repeats, case.recording_seed), logs)
        made.write(logs)
        walks, by = made.walks(policy), []
        for i in range(len(case.requests)):
            twin = source.make(case.requests[:i] + case.requests[i + 1 :], case.reality_seed)
            healthy = make_runs(twin, plan(TWIN_REPEATS, case.recording_seed + 1 + i), Path(folder) / str(i))
            by.append(moved(walks, healthy.walks(policy)))
        runs, _ = prepared([read_run(path) for path in sorted(logs.glob("*.mcap"))], SPOT)
    return reality, list(runs), by


def diagnosed(
    runs: Sequence[Run], nominal: RobotModel, policy: Policy, library: Mapping[str, LibraryEffect], seed: int
) -> dict[str, Any]:
    """What a diagnosis with this library compares."""
    found = explain(runs, nominal, policy, library, lambda _: None)
    bench = Bench.of(runs, policy, LocalEngine(policy))
    return compared(decide(found, nominal, bench, library, np.random.default_rng(seed)))


def compared(causes: Causes) -> dict[str, Any]:
    """The numbers on which the probabilities of a diagnosis rest."""
    belief, first = causes.belief, causes.first
    gains = dict(zip(first.effects, first.selection.gains, strict=True))
    return {
        "distance": causes.distances.get(ERRORS),
        "scatter_nm": causes.scatter_nm,
        "model_scatter": causes.model_scatter,
        "errors": causes.errors,
        "best": causes.left,
        "beyond": first.remainder().beyond(USUAL_LEFT),
        "excess": excess(first.board, null_of(first.board)),
        "left": excess(first.board, first.selection.best or null_of(first.board)),
        "alike": only_alike(first.board, first.selection.best or null_of(first.board)),
        "causes": dict(belief.effects),
        "odd": causes.odd,
        "found": [
            {"name": n, "nats": gains[n], "nearer": belief.nearer.get(n), "moved": causes.moved.get(n), "p": p}
            for n, p in belief.there.items()
            if n in gains
        ],
        "none": belief.none,
        "unknown": belief.unknown,
    }


def new_shrink(case: Case, reality: Reality, delivered: RobotModel, policy: Policy) -> float | None:
    """S of a delivered model on sequences that the diagnosis did not see."""
    new = ordinary_sequences(
        policy.contract, np.random.default_rng([case.recording_seed, 2]), case.sequences[0].duration_s
    )
    plan = RecordingPlan(POLICIES / f"{case.policy}.onnx", new, SHRINK_REPEATS, case.recording_seed + 9)
    with tempfile.TemporaryDirectory() as folder:
        try:
            reality.record(plan, Path(folder))
            later = [read_run(path) for path in sorted(Path(folder).glob("*.mcap"))]
            return true_shrink(later, reality.nominal, delivered, policy, case.recording_seed)
        except (SpotRlError, ValueError):
            return None


def robots(given: Namespace) -> None:
    """Make what is missing."""
    given.out.mkdir(parents=True, exist_ok=True)
    numbers = chosen(given.seed, range(given.first, given.to), given.kind or KINDS)
    began_s = time.monotonic()
    with ProcessPoolExecutor(given.workers) as pool:
        late_s = began_s + given.until
        waiting = [pool.submit(_unless_late, late_s, given.seed, n, given.out) for n in numbers]
        for k, done in enumerate(as_completed(waiting), 1):
            left_s = (time.monotonic() - began_s) / k * (len(waiting) - k)
            print(f"{done.result()} ({k} of {len(waiting)}, {left_s / 60:.0f} min left)", flush=True)


def _unless_late(until_s: float, seed: int, number: int, out: Path) -> str:
    return robot(seed, number, out) if time.monotonic() < until_s else f"{number}: left for another time"


def fit(given: Namespace) -> None:
    """Print the numbers."""
    rows = [json.loads(path.read_text()) for path in sorted(given.folder.glob("*.json"))]
    clean = [r for r in rows if not r["faults"] and r["distance"] is not None]
    distance, scatter_nm = (np.array([r[name] for r in clean]) for name in ("distance", "scatter_nm"))
    errors = np.minimum([r["errors"] for r in clean], LARGEST_ERRORS)
    apart = np.array([runs_apart(r["model_scatter"]) for r in clean])
    left_nm = scatter_nm * np.sqrt(np.maximum(distance**2 - apart**2, 0.0)) / errors
    most_nm = float(np.quantile(left_nm, 0.95))
    slope = 1.7 / np.std(np.log(distance / np.hypot(apart, most_nm * errors / scatter_nm)))
    quantiles = np.quantile(left_nm, [0.5, 0.95, 1.0]).round(2)
    print(f"ORDINARY_LEFT_NM: {len(clean)} faultless robots, 50, 95, 100 %: {quantiles}")
    print(f"GAP_SLOPE: {slope:.1f}")
    for channel in ORDINARY_EXCESS:
        own = [r["excess"][channel] for r in clean if channel in r["excess"]]
        print(f"ORDINARY_EXCESS: {channel}: {np.median(own):.2f}, {np.std(own):.2f}; {len(own)} robots" if own else "")
    found, right, moves = [], [], []
    for row in rows:
        by_name = {name: f["moved"] for f in row["faults"] for name in f["names"]}
        for effect in row["found"]:
            if effect["nearer"] is None or not np.isfinite(effect["nearer"]):
                continue
            found.append((np.log(max(effect["nats"], 1e-9)), effect["nearer"]))
            right.append(effect["name"] in by_name)
            robots = by_name.get(effect["name"])
            if robots is not None and np.isfinite(effect["moved"]) and row["n_runs"] > 3:
                moves.append((np.log1p(max(effect["moved"], -0.5)), np.log1p(max(robots, -0.5))))
    if len(moves) < 3 or len(set(right)) < 2:
        raise SystemExit(f"{len(rows)} robots are too few for the regressions; make more of them")
    x, y = np.array(found), np.array(right)
    for name, columns in (("THERE", [0, 1]), ("THERE_BY_RESIDUALS", [0])):
        model = LogisticRegression(C=10.0).fit(x[:, columns], y)
        numbers = (*model.intercept_.round(2), *model.coef_[0].round(2))
        print(f"{name}: {numbers}; {len(y)} effects, {y.sum()} there; right for {model.score(x[:, columns], y):.0%}")
    x, y = unknowns(rows)
    model = LogisticRegression(C=10.0).fit(x, y)
    print(f"UNKNOWN: {(*model.intercept_.round(2), *model.coef_[0].round(2))}; {len(y)} diagnoses, {y.sum()} without")
    u, v = np.array(moves).T
    slope, offset = np.polyfit(u, v, 1)
    print(f"MOVED: {offset:.2f}, {slope:.2f}, {np.std(v - offset - slope * u):.2f}; {len(u)} effects that were there")
    shrinks = [(row["stated_s"], row["true_s"]) for row in rows if row.get("named") and is_named(row)]
    s = np.array([pair for pair in shrinks if None not in pair], dtype=np.float64).reshape(-1, 2)
    if len(s):
        print(f"S: {np.median(s[:, 0]):.2f} stated, {np.median(s[:, 1]):.2f} measured in the median of {len(s)} robots")


def is_named(row: Mapping[str, Any]) -> bool:
    """Whether every large fault's effect was named, and nothing that is not there."""
    faults = [set(f["names"]) for f in row["faults"]]
    large = [set(f["names"]) for f in row["faults"] if f["moved"] is not None and f["moved"] >= LARGE]
    named = set(row["named"])
    return all(named & fault for fault in large) and all(any(name in fault for fault in faults) for name in named)


def unknowns(rows: list[dict[str, Any]]) -> tuple[np.ndarray, np.ndarray]:
    """Distance and nats that are left, and whether a large fault's effects were not in the library.

    Robots whose faults clearly matter and were found, or clearly do not.
    """
    x, y = [], []
    for row in rows:
        large = [set(f["names"]) for f in row["faults"] if f["moved"] is not None and f["moved"] >= LARGE]
        is_clear = all(f["moved"] is not None and not SMALL <= f["moved"] < LARGE for f in row["faults"])
        names = {e["name"] for e in row["found"]}
        if is_clear and all(names & fault for fault in large):
            x.append(_left(row))
            y.append(False)
        if "without" in row:
            x.append(_left(row["without"]))
            y.append(True)
    return np.array(x), np.array(y)


def _left(row: dict[str, Any]) -> tuple[float, float]:
    usual = ordinary_gap(row["scatter_nm"], row["errors"], row["odd"], row["model_scatter"]) + LEFT_SHARE * max(
        row["distance"] - row["best"], 0.0
    )
    return float(np.log(row["best"] / usual)), float(np.log1p(row["beyond"]))


def two_steps(
    about: str | None, robots: Callable[[Namespace], object], name: str, judged: Callable[[Namespace], object]
) -> tuple[ArgumentParser, ArgumentParser]:
    """A command line of two steps, ``robots`` and one that reads their folder; the parser of all and of the first."""
    parser = ArgumentParser(description=about)
    steps = parser.add_subparsers(required=True)
    one = steps.add_parser("robots")
    one.add_argument("--seed", type=int, required=True)
    one.add_argument("--out", type=Path, required=True)
    one.add_argument("--until", type=float, default=1e9, help="begin no robot after so many seconds")
    one.set_defaults(step=robots)
    two = steps.add_parser(name)
    two.add_argument("folder", type=Path)
    two.set_defaults(step=judged)
    return parser, one


def main() -> None:
    """Read the command line."""
    parser, one = two_steps(__doc__, robots, "fit", fit)
    one.add_argument("--first", type=int, default=0)
    one.add_argument("--to", type=int, required=True)
    one.add_argument("--kind", action="append", choices=KINDS, help="these alone")
    one.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    given.step(given)


if __name__ == "__main__":
    main()
