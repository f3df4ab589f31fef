"""Claim: on the same robots' logs, the diagnosis tells a fault from none and names it more often than simpler means.

Robots are drawn as the withheld check draws them, without a fault or with one effect of the library, and all logs are
whole. Robots of ``--catalogue calibrating`` are in favour of the diagnosis, whose numbers were fitted to that
catalogue's kinds on other seeds. Peers, on the same logs and the same nominal model: least squares of drive parameters
with a threshold (least_squares.py), a fit by `mujoco.sysid` (mujoco_fit.py), a two-sample test and a CMA-ES ranking of
effects in closed loops (closed_loop_ranking.py), and the residual of an actuator network (actuator_network.py).

``robots`` can be interrupted, and goes on. ``table`` prints, of robots whose fault moves the gap by twice its floor,
how often each means ranks a right effect first, and among its first three; and how well it tells these robots from
those without a fault: the area under its ROC curve, 0.5 by chance, and its false alarms where it finds four faults in
five. Of the diagnosis, which alone says probabilities and when it is silent, also on how many robots without a fault it
names something or calls it unknown, and the calibration error of what it names. Intervals are of 95 %.

    python lab/benchmarks/claims/diagnosis_peers.py robots --seed 2207 --to 80 --out DIR [--workers 2] [--until 600]
    python lab/benchmarks/claims/diagnosis_peers.py table DIR [--below 60]

Robots that take longest are finished last: where some are missing, ``--below`` ends the table before the first.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from argparse import Namespace
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from actuator_network import ratios
from closed_loop_ranking import Distances, candidates, distances_of, nearest, searched
from least_squares import estimates, ranking
from torch import set_num_threads

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mujoco_fit
from calibrate_diagnosis import recorded
from many_robots import make_all, two_steps

from diagnosis.channels import Channel
from diagnosis.channels.build import build_views
from diagnosis.channels.stack import stacked
from diagnosis.closed_loop.simulation import rollouts_under, run_all
from diagnosis.closed_loop.trials import Bench
from diagnosis.verdict.diagnose import diagnose_runs
from spot_model.policy.built_in import FOLDER
from spot_model.policy.policy import load_policy
from trainer.signals.recording import record
from withheld.blind.execution import what_faults_do
from withheld.cases import draw, kind_of
from withheld.realities.source import CATALOGUES, source_of
from withheld.scoring.scores import LARGE
from withheld.scoring.statistics import LEVEL, N_RESAMPLES, Estimate, Share, calibration_error
from withheld.simulator.simulation import RealityDivergedError

KINDS: Final = ("faultless", "single")
MISSED: Final = 0.2
"""Share of the faults that are missed where false alarms are counted."""
MEANS: Final = {
    "ours": "this diagnosis",
    "least_squares": "least squares, threshold",
    "mujoco": "`mujoco.sysid`, threshold",
    "two_sample": "two-sample test (MMD)",
    "cma_es": "CMA-ES ranking",
    "network": "actuator network's residual",
}


def robot(seed: int, number: int, catalogue: str, out: Path, late_s: float) -> str:
    """Simulate one robot, ask every means, and write what they say; returns a line to print."""
    file = out / f"{seed}-{number:04d}.json"
    if time.monotonic() > late_s:
        return f"{number}: left for another time"
    source = source_of(catalogue)
    case = draw(seed, number, source, FOLDER)
    if file.exists() or case.missing:
        return f"{number}: {'there' if file.exists() else 'left out, lacks ' + ', '.join(case.missing)}"
    policy = load_policy(FOLDER / f"{case.policy}.onnx")
    try:
        reality, runs = recorded(case, source)
        with tempfile.TemporaryDirectory() as work:
            file_of = FOLDER / f"{case.policy}.onnx"
            does = what_faults_do(source, case, reality, runs, policy, file_of, Path(work))
        moved = [by for by, _ in does]
    except RealityDivergedError:
        return f"{number}: its simulation broke down"
    nominal, seconds = reality.nominal, {}

    def timed(name: str, ask: Callable[[], Any]) -> Any:
        begin_s = time.process_time()
        found = ask()
        seconds[name] = round(time.process_time() - begin_s, 1)
        return found

    def least_squares() -> Any:
        views, _ = build_views(stacked([record(run) for run in runs]), nominal, policy=policy)
        return estimates(views[Channel.SET_POINT_TO_LOAD]).tolist()

    def network() -> Any:
        bench = Bench.of(runs, policy, rollouts_under(policy))
        jobs = [(nominal, script) for script in bench.scripts] if bench else []
        healthy = run_all(jobs, rollouts_under(policy), np.random.default_rng(case.diagnosis_seed), lambda _: None)
        return ratios(healthy, runs, case.diagnosis_seed).tolist()

    kept: dict[str, Any] = {"number": number, "kind": case.kind, "seconds": seconds}
    kept["faults"] = [{"names": f.names, "moved": m} for f, m in zip(reality.truth.faults, moved, strict=True)]
    is_large = any(m is not None and m >= LARGE for m in moved)
    if moved and not is_large:
        file.write_text(json.dumps(kept))
        return f"{number}: {case.kind}, its fault does not matter"
    kept["least_squares"] = timed("least_squares", least_squares)
    kept["network"] = timed("network", network)
    kept["mujoco"] = timed("mujoco", lambda: mujoco_fit.estimates(runs).tolist())
    measure = Distances(runs, policy, case.diagnosis_seed)
    gap = timed("two_sample", lambda: measure.to([nominal])[0])
    kept["two_sample"], kept["cma_es"] = {"gap": gap[1], "effects": {}}, {"gap": gap.mean(), "effects": {}}
    if is_large:
        views, _ = build_views(stacked([record(run) for run in runs]), nominal, policy=policy)
        tried = candidates(views)
        distances = timed("two_sample", lambda: distances_of(measure, nominal, tried))
        kept["two_sample"]["effects"] = nearest(tried, distances[:, 1])
        kept["cma_es"]["effects"] = timed(
            "cma_es", lambda: searched(measure, nominal, tried, distances, case.diagnosis_seed)
        )
        seconds["cma_es"] = round(seconds["cma_es"] + seconds["two_sample"], 1)
    found = timed(
        "ours", lambda: diagnose_runs(runs, nominal, policy, np.random.default_rng(case.diagnosis_seed), print_no)
    )
    verdict = found.verdict
    kept["ours"] = {
        "gap": 1.0 - verdict.probability_none,
        "effects": {n: p for d in verdict.differences for n, p in {d.name: d.probability, **d.rivals}.items()},
        "named": [{"names": sorted({d.name, *d.group}), "p": d.probability} for d in verdict.differences],
        "is_silent": not verdict.differences and verdict.status != "unknown_effect",
    }
    file.write_text(json.dumps(kept))
    return f"{number}: {case.kind}, {seconds}"


def print_no(line: str) -> None:
    """Progress that nobody reads."""


def robots(given: Namespace) -> None:
    """Make what is missing."""
    given.out.mkdir(parents=True, exist_ok=True)
    late_s = time.monotonic() + given.until
    numbers = [n for n in range(given.first, given.to) if kind_of(given.seed, n) in KINDS]
    robots = [(given.seed, n, given.catalogue, given.out, late_s) for n in numbers]
    make_all(robot, robots, given.workers, partial(set_num_threads, 1))


def said(row: Mapping[str, Any], healthy: list[Any]) -> dict[str, tuple[float, dict[str, float]]]:
    """By means, how sure it is of a gap, and how it ranks effects."""
    squares = ranking(np.array(row["least_squares"]), [np.array(h["least_squares"]) for h in healthy])
    fitted = mujoco_fit.ranking(np.array(row["mujoco"]), [np.array(h["mujoco"]) for h in healthy])
    simulated = {name: (row[name]["gap"], row[name]["effects"]) for name in ("ours", "two_sample", "cma_es")}
    return {
        **simulated,
        "least_squares": (max(squares.values()), dict(squares)),
        "mujoco": (max(fitted.values()), dict(fitted)),
        "network": (float(np.max(row["network"])), {}),
    }


def table(given: Namespace) -> None:
    """Print one JSON object, and a table."""
    rows = [json.loads(path.read_text()) for path in sorted(given.folder.glob("*.json"))]
    rows = [row for row in rows if row["number"] < given.below]
    healthy = [r for r in rows if not r["faults"]]
    faulty = [r for r in rows if any(f["moved"] is not None and f["moved"] >= LARGE for f in r["faults"])]
    if len(healthy) < 2 or not faulty:
        raise SystemExit(f"{len(healthy)} robots without a fault and {len(faulty)} with one are too few")
    clear = [said(r, [h for h in healthy if h is not r]) for r in (*healthy, *faulty)]
    is_faulty = np.arange(len(clear)) >= len(healthy)
    told = {}
    for means, title in MEANS.items():
        gaps = np.array([s[means][0] for s in clear])
        first, three = [], []
        for row, s in zip(faulty, clear[len(healthy) :], strict=True):
            order = sorted(s[means][1], key=lambda n: -s[means][1][n])
            right = {name for fault in row["faults"] for name in fault["names"]}
            first.append(bool(right & set(order[:1])))
            three.append(bool(right & set(order[:3])))
        seconds = [r["seconds"][means] for r in faulty]
        told[means] = {
            "title": title,
            "first": str(Share.of(first)) if means != "network" else "says where, not what",
            "first_three": str(Share.of(three)) if means != "network" else "",
            "roc_area": area(gaps, is_faulty),
            "false_alarms": str(Share.of([bool(g >= np.quantile(gaps[is_faulty], MISSED)) for g in gaps[~is_faulty]])),
            "core_s": round(float(np.median(seconds)), 1),
        }
    told["ours_alone"] = {
        "false_alarms": str(Share.of([not h["ours"]["is_silent"] for h in healthy])),
        "calibration_error": str(Estimate.of(stated(rows), calibration_error)),
    }
    told["cases"] = {"faultless": len(healthy), "faulty": len(faulty), "all": len(rows)}
    print(json.dumps(told, ensure_ascii=False, indent=1))
    columns = ("means", "right effect first", "among the first three", "ROC area", "false alarms", "core-seconds")
    print("\n| " + " | ".join(columns) + " |\n" + "|---" * len(columns) + "|")
    for means in MEANS:
        print("| " + " | ".join(str(v) for v in told[means].values()) + " |")


def stated(rows: list[dict[str, Any]]) -> list[tuple[float, float]]:
    """Each difference that the diagnosis names: its probability, and whether it is there."""
    out: list[tuple[float, float]] = []
    for row in rows:
        right = {name for fault in row["faults"] for name in fault["names"]}
        out += [(d["p"], float(bool(right & set(d["names"])))) for d in row.get("ours", {}).get("named", ())]
    return out


def area(gaps: np.ndarray, is_faulty: np.ndarray) -> str:
    """Area under the ROC curve with a bootstrap interval over the robots of each kind."""
    rng, groups = np.random.default_rng(0), (gaps[is_faulty], gaps[~is_faulty])
    resampled = [_area(*(rng.choice(group, len(group)) for group in groups)) for _ in range(N_RESAMPLES)]
    low, high = np.quantile(resampled, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return f"{_area(*groups):.2f} ({low:.2f} to {high:.2f})"


def _area(faulty: np.ndarray, healthy: np.ndarray) -> float:
    """How often a faulty robot's gap is larger than a healthy one's; an equal pair counts half (Mann and Whitney)."""
    return 0.5 + 0.5 * float(np.sign(faulty[:, None] - healthy).mean())


def main() -> None:
    """Read the command line."""
    parser, one, two = two_steps(__doc__, robots, "table", table)
    two.add_argument("--below", type=int, default=sys.maxsize)
    one.add_argument("--first", type=int, default=0)
    one.add_argument("--to", type=int, required=True)
    one.add_argument("--catalogue", choices=CATALOGUES, default="judging")
    one.add_argument("--workers", type=int, default=1, help="processes, each on one core")
    given = parser.parse_args()
    given.step(given)


if __name__ == "__main__":
    main()
