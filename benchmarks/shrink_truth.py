"""Does the shrink S tell the truth? Realities with one known fault, their S in a verdict, and S with many more runs.

The claim: where the diagnosis is right, S on sequences that the fit never saw is at least 0.8, its 90 % interval covers
the true S nine times in ten, and the best wrong effect stays clearly below. The true S is that of the same models on
the same sequences with ``--pool`` runs of each; verdicts are drawn from that pool again and again.

    python benchmarks/shrink_truth.py run --out rows.jsonl --jobs 2 --until 500
    python benchmarks/shrink_truth.py table rows.jsonl
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final

import numpy as np
from diagnose_fake import sequences

from diagnosis.diagnose import Explained, explain
from diagnosis.engine import LocalEngine
from diagnosis.fitted import corrected_model, without_fold
from diagnosis.library.registry import LIBRARY
from diagnosis.logs import script_of
from diagnosis.measure import Bench, measure, simulate_all
from diagnosis.posterior import Calibration
from diagnosis.seam import Array
from diagnosis.selection.scoring import Scored
from diagnosis.shrink import Compared, Features, Shrinkage, features_by_sequence, shrinkage
from diagnosis.surroundings import SURROUNDING_EFFECTS, run_all
from spot_log import Run, read_run
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy, load_policy
from trainer.sysid.distance.measures import SequenceReference
from withheld.plan import FaultRequest, Place, RecordingPlan
from withheld.realities.calibrating.catalogue import CATALOGUE
from withheld.realities.reality import make

POLICIES: Final = Path(__file__).parents[1] / "policies"
CASES: Final[tuple[tuple[str, Place], ...]] = (
    ("flux_change", "type"), ("box_on_the_back", "body"), ("shear_thinning_grease", "type"), ("gear_loss", "all"),
    ("slow_queue", "body"), ("heavy_rotor", "type"), ("lugre_friction", "all"), ("soft_current_limit", "type"),
    ("moved_ballast", "body"), ("slow_current_loop", "all"), ("boots", "all"), ("encoder_offset", "joint"),
    ("hot_motors", "all"), ("few_volts", "type"), ("bus_current_limiter", "body"), ("tooth_ripple", "type"),
    ("filtered_rates", "all"), ("wrong_odometry", "body"), ("wrong_pose", "type"),
)  # fmt: skip
N_DRAWS: Final = 20


def one_case(kind: str, place: Place, seed: int, name: str, size: float, repeats: int, pool: int) -> dict[str, Any]:
    """One reality: what a verdict says of S, and the truth."""
    began_s = time.process_time()
    path = POLICIES / f"{name}.onnx"
    policy = load_policy(path)
    reality = make([FaultRequest(kind=kind, place=place, size=size)], seed, CATALOGUE)
    with tempfile.TemporaryDirectory() as folder:
        low, high = (np.array(v) for v in (policy.contract.velocity_command_low, policy.contract.velocity_command_high))
        asked = tuple(s.clipped(low, high) for s in sequences())
        plan = RecordingPlan(policy=path, sequences=asked, repeats=pool, seed=seed + 100)
        reality.record(plan, Path(folder) / "logs")
        runs = [read_run(p) for p in sorted((Path(folder) / "logs").glob("*.mcap"))]
    row: dict[str, Any] = {
        "kind": kind,
        "policy": name,
        "size": size,
        "place": place,
        "seed": seed,
        "repeats": repeats,
        "pool": pool,
    }
    few = [r for name in {r.header.command_sequence for r in runs} for r in _of(runs, name)[:repeats]]
    nominal = reality.nominal
    found = explain(few, nominal, policy, LIBRARY, Calibration.load(), lambda _: None)
    best = found.selection.best
    row["found"] = [t.effect.name for t in best.terms] if best is not None else []
    row["right"] = set(row["found"]) <= set(CATALOGUE[kind].names) and bool(row["found"])
    if best is None:
        return row
    whole = corrected_model(nominal, found.board.robot, best)
    is_shared = any(t.effect.name in SURROUNDING_EFFECTS for t in best.terms)
    bench = _bench(few, policy, whole if is_shared else None)
    rng = np.random.default_rng(seed)
    simulated = simulate_all(bench, nominal, found.board, found.selection, found.posterior.groups, rng)
    said = measure(bench, simulated, rng).shrink
    if said is not None:
        row |= {"s": said.s, "low": said.s_low, "high": said.s_high, "d0": said.d0, "d1": said.d1}
        row["placebo"] = said.placebo.s if said.placebo is not None else None
    row |= _truth(runs, bench, found, best, nominal, repeats, rng)
    return row | {"cpu_s": time.process_time() - began_s}


def _of(runs: Sequence[Run], sequence: str) -> list[Run]:
    return [r for r in runs if r.header.command_sequence == sequence]


def _bench(runs: Sequence[Run], policy: Policy, shared: RobotModel | None) -> Bench:
    scripts = tuple(s for run in runs if (s := script_of(run)) is not None)
    return Bench(tuple(runs), scripts, policy, LocalEngine(policy), shared)


@dataclass(frozen=True)
class _Pairs:
    """Distances of one sequence's runs, not yet divided by the floor of those that are drawn."""

    sequence: str
    real: Array
    models: dict[str, Array]

    @staticmethod
    def of(sequence: str, pool: dict[str, Features]) -> _Pairs:
        """Of all runs."""
        reference = SequenceReference.build(sequence, list(pool["real"]))
        models = {k: np.array([reference.distances(f) for f in runs]) for k, runs in pool.items() if k != "real"}
        return _Pairs(sequence, reference.pair_distances, models)

    def drawn(self, n: int | None, rng: np.random.Generator) -> Compared:
        """Of n runs each, all by default."""

        def some(count: int) -> Any:
            return np.arange(count) if n is None else rng.choice(count, min(n, count), replace=False)

        real = some(len(self.real))
        pairs = self.real[np.ix_(real, real)]
        scale = pairs.sum(axis=(0, 1)) / (len(real) * (len(real) - 1))
        # A simulated run starts as its real one does.
        models = {
            k: m[np.ix_(real if len(m) == len(self.real) else some(len(m)), real)] for k, m in self.models.items()
        }
        return Compared(
            self.sequence, (pairs / scale).mean(axis=-1), {k: (m / scale).mean(axis=-1) for k, m in models.items()}
        )


def _truth(
    runs: Sequence[Run], small: Bench, found: Explained, best: Scored, nominal: RobotModel, repeats: int,
    rng: np.random.Generator,
) -> dict[str, Any]:  # fmt: skip
    """S with all runs, and how often intervals of a few of them cover it."""
    large = _bench(runs, small.policy, small.shared)
    pool = {"real": features_by_sequence(runs, large.policy)}
    jobs, names = [], []
    for name in ("nominal", "corrected"):
        around = small.surroundings["all" if small.shared is not None else name].by_sequence
        for k, sequence in enumerate(small.sequences):
            model = nominal if name == "nominal" else corrected_model(
                nominal, found.board.robot, best, without_fold(best, k)
            )  # fmt: skip
            mine = [s for s in large.scripts if s.sequence == sequence]
            jobs += [(model, s, around.get(sequence)) for s in mine]
            names += [name] * len(mine)
    made = run_all(jobs, large.engine, rng, lambda _: None)
    for name in ("nominal", "corrected"):
        own = [run for run, which in zip(made, names, strict=True) if which == name]
        pool[name] = features_by_sequence(own, large.policy)
    pairs = {s: _Pairs.of(s, {k: p[s] for k, p in pool.items()}) for s in small.sequences if all(
        p.get(s) for p in pool.values()
    )}  # fmt: skip

    def shrunk(n: int | None) -> Shrinkage:
        return shrinkage([p.drawn(n, rng) for p in pairs.values()], "nominal", "corrected", rng)

    true = shrunk(None)
    drawn = [shrunk(repeats) for _ in range(N_DRAWS)]
    inside = [
        d.low <= true.s <= d.high for d in drawn if d.low is not None and d.high is not None and true.s is not None
    ]
    return {
        "true_s": true.s, "true_d0": true.d0, "true_d1": true.d1, "floor": true.floor,
        "cover": float(np.mean(inside)) if inside else None, "drawn_s": [d.s for d in drawn],
    }  # fmt: skip


def table(rows: Sequence[dict[str, Any]]) -> None:
    """Print a line a case, and the totals."""
    print("kind                   found                        D0    D1  true S      S  interval        placebo  cover")
    large = []
    for r in sorted(rows, key=lambda r: (r["kind"], r["seed"])):
        if r.get("true_s") is None:
            print(f"{r['kind']:22s} {', '.join(r['found'])[:28]:28s} no gap, or nothing found")
            continue
        s = ["-" if r.get(k) is None else f"{r[k]:.2f}" for k in ("s", "low", "high", "placebo")]
        print(f"{r['kind']:22s} {', '.join(r['found'])[:28]:28s} {r['true_d0']:4.1f}  {r['true_d1']:4.1f}  "
              f"{r['true_s']:6.2f}  {s[0]:>5s}  {s[1]} to {s[2]}  {s[3]:>7s}  {r['cover'] or 0.0:5.2f}")  # fmt: skip
        if r["right"] and r["true_d0"] >= 2.0 * r["floor"] and r.get("s") is not None:
            large.append(r)
    if not large:
        return
    stated, true = np.array([r["s"] for r in large]), np.array([r["true_s"] for r in large])
    inside = np.mean([r["low"] <= r["true_s"] <= r["high"] for r in large])
    over = [r["s"] - r["placebo"] for r in large if r["placebo"] is not None]
    draws = np.mean([r["cover"] for r in large])
    print(f"right, and D0 at least twice the floor: {len(large)} cases")
    print(
        f"S >= 0.8: {np.mean(stated >= 0.8):.2f}, true S: {np.mean(true >= 0.8):.2f}; median S {np.median(stated):.2f}"
    )
    print(f"intervals that cover the true S: of verdicts {inside:.2f}, of draws {draws:.2f}")
    print(f"S less the placebo's: median {np.median(over) if over else float('nan'):.2f}")


def main() -> None:
    """Run or print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    steps = parser.add_subparsers(dest="step", required=True)
    run = steps.add_parser("run")
    run.add_argument("--out", type=Path, required=True)
    run.add_argument("--jobs", type=int, default=1)
    run.add_argument("--until", type=float, default=1e9, help="seconds after which no case is begun")
    run.add_argument("--repeats", type=int, default=5)
    run.add_argument("--pool", type=int, default=10)
    run.add_argument("--seeds", type=int, default=1)
    run.add_argument("--seed", type=int, default=3, help="of the first reality; the others follow in steps of 10")
    run.add_argument("--kinds", default="")
    run.add_argument("--policy", default="baseline")
    run.add_argument("--size", type=float, default=1.0)
    shown = steps.add_parser("table")
    shown.add_argument("rows", type=Path)
    given = parser.parse_args()
    if given.step == "table":
        table([json.loads(line) for line in given.rows.read_text().splitlines()])
        return
    chosen = [c for c in CASES if not given.kinds or c[0] in given.kinds.split(",")]
    work = [(k, p, given.seed + s + 10 * i) for s in range(given.seeds) for i, (k, p) in enumerate(chosen)]
    began_s = time.monotonic()
    with ProcessPoolExecutor(given.jobs, get_context("spawn")) as pool, given.out.open("a") as out:
        waiting: dict[Any, tuple[str, Place, int]] = {}
        while work or waiting:
            while work and len(waiting) < given.jobs and time.monotonic() - began_s < given.until:
                case = work.pop(0)
                task = pool.submit(one_case, *case, given.policy, given.size, given.repeats, given.pool)
                waiting[task] = case
            if not waiting:
                break
            done = next(as_completed(waiting))
            case = waiting.pop(done)
            try:
                out.write(json.dumps(done.result()) + "\n")
                print(f"{case[0]} is done after {time.monotonic() - began_s:.0f} s", flush=True)
            except Exception as error:  # noqa: BLE001 - one case must not end the others
                print(f"{case}: {type(error).__name__}: {error}")
            out.flush()


if __name__ == "__main__":
    main()
