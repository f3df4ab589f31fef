"""The diagnosis' explanations on realities that share no formula with its library: accuracy, and rows to learn from.

Cases are drawn from the catalogue of :mod:`withheld.realities`: none, each kind alone (and once more with its effect
left out of the library), kinds that the library has not, and pairs. Nothing is simulated by the diagnosis here: figures
are those of the residual channels. Cases are shared among processes; an unfinished batch is a smaller one.

    python benchmarks/diagnose_realities.py run --out rows.jsonl --cases 64 --jobs 2 [--until 500] [--repeats 3]
    python benchmarks/diagnose_realities.py table rows.jsonl
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import tempfile
import time
import traceback
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from diagnose_fake import sequences

from diagnosis.diagnose import ORDINARY_AT_MOST, Explained, explain, status_of
from diagnosis.library.registry import LIBRARY
from diagnosis.posterior import Calibration
from diagnosis.selection.scoring import Scorer
from diagnosis.unknown import nats_by_joint, remainder
from spot_log.read.reader import read_run
from spot_log.read.run import Run
from spot_model.policy.policy import Policy, load_policy
from withheld.plan import Fault, FaultRequest, RecordingPlan
from withheld.realities.calibrating.catalogue import CATALOGUE
from withheld.realities.reality import make

POLICIES: Final = ("baseline", "walk", "fast")
Row = dict[str, Any]


def drawn(seed: int, n: int, kinds: tuple[str, ...] = ()) -> Iterator[tuple[int, str, tuple[FaultRequest, ...]]]:
    """Case number, policy and faults: a fifth none, a tenth pairs, the rest single kinds in turn."""
    names = list(kinds or CATALOGUE)
    for i in range(n):
        rng = np.random.default_rng([seed, i])
        policy = POLICIES[int(rng.integers(len(POLICIES)))]
        if i % 10 in (0, 5):
            yield i, policy, ()
            continue
        chosen = [names[(i - i // 5 - 1) % len(names)]]
        if i % 10 == 9:
            chosen.append(str(rng.choice([k for k in names if k != chosen[0]])))
        yield i, policy, tuple(
            FaultRequest(kind=k, place=CATALOGUE[k].places[int(rng.integers(len(CATALOGUE[k].places)))],
                         size=float(rng.uniform(0.4, 1.0)))
            for k in chosen
        )  # fmt: skip


def logs_of(seed: int, faults: tuple[FaultRequest, ...], policy: Path, repeats: int) -> tuple[Any, list[Run]]:
    """A reality and its logs."""
    reality = make(list(faults), seed, CATALOGUE)
    contract = load_policy(policy).contract
    low, high = np.array(contract.velocity_command_low), np.array(contract.velocity_command_high)
    made = tuple(s.clipped(low, high) for s in sequences())
    with tempfile.TemporaryDirectory() as folder:
        plan = RecordingPlan(policy=policy, sequences=made, repeats=repeats, seed=seed + 1)
        reality.record(plan, Path(folder))
        return reality, [read_run(p) for p in sorted(Path(folder).glob("*.mcap"))]


def case(
    seed: int,
    number: int,
    name: str,
    faults: tuple[FaultRequest, ...],
    repeats: int,
    calibrations: tuple[str, ...] = ("",),
) -> list[Row]:
    """Make a case's logs and explain them, with the whole library and with the fault's effect left out."""
    policy = Path(__file__).resolve().parent.parent / "policies" / f"{name}.onnx"
    began = time.process_time()
    reality, runs = logs_of(1000 * seed + number, faults, policy, repeats)
    made_s = time.process_time() - began
    truth = reality.truth.faults
    rows = []
    for name_of_calibration in calibrations:
        mine = [explained(reality, runs, load_policy(policy), truth, frozenset(), name_of_calibration)]
        if len(truth) == 1 and truth[0].names:
            left_out = frozenset(truth[0].names)
            mine.append(explained(reality, runs, load_policy(policy), truth, left_out, name_of_calibration))
        for row in mine:
            row["calibration"] = name_of_calibration
        rows += mine
    for row in rows:
        row.update(case=number, seed=seed, policy=name, made_s=round(made_s, 1), n_runs=len(runs))
    return rows


def explained(
    reality: Any,
    runs: list[Run],
    policy: Policy,
    truth: tuple[Fault, ...],
    left_out: frozenset[str],
    numbers: str = "",
) -> Row:
    """One explanation as a row of plain numbers."""
    began = time.process_time()
    library = {n: e for n, e in LIBRARY.items() if n not in left_out}
    found = explain(runs, reality.nominal, policy, library, calibration_of(numbers), lambda _: None)
    return {
        "truth": [f.model_dump() for f in truth],
        "left_out": sorted(left_out),
        **row_of(found),
        "explain_s": round(time.process_time() - began, 1),
    }


def calibration_of(words: str) -> Calibration:
    """The package's own calibration with some numbers changed, such as ``dof=60;ordinary=1.5`` (a factor on all)."""
    found = Calibration.load()
    for word in filter(None, words.split(";")):
        name, value = word.split("=")
        if name == "ordinary":
            sizes = {
                effect: {k: v if k in ("at", "alike") else float(value) * v for k, v in given.items()}
                for effect, given in found.ordinary.items()
            }
            found = replace(found, ordinary=sizes)
        else:
            found = replace(found, **{name: float(value)})  # type: ignore[arg-type]
    return found


def row_of(found: Explained) -> Row:
    """Of an explanation all that a calibration looks at."""
    board, best, p = found.board, found.selection.best, found.posterior
    effects = []
    terms = zip(best.terms, best.coefficients, found.selection.gains, found.selection.rivals, p.groups, strict=True) \
        if best is not None else ()  # fmt: skip
    for term, own, gain, rivals, group in terms:
        effects.append({
            "name": term.effect.name,
            "joints": list(board.robot.named(board.robot.joints_of(term.effect, term.place))),
            "values": dict(term.effect.values(own, term.shape)), "gain": float(gain), "group": list(group.names),
            "by_fold": [np.round(x, 5).tolist() for x in _by_fold(best, len(effects))],
            "own": np.round(own, 5).tolist(),
            "probabilities": dict(group.probabilities),
            "rivals": [(r.scored.terms[-1].effect.name, float(r.value)) for r in rivals[:8]],
        })  # fmt: skip
    by_joint = nats_by_joint(board, found.left)
    null = found.left if best is None else _left_by_null(found)
    return {
        "null_by_channel": {
            c: round(float(null.nats[n].sum()), 2) for c, n in board.by_channel.items() if null.nats[n].sum() > 0.5
        },
        "status": status_of(found), "none": p.none, "unknown": p.unknown, "effects": effects,
        "first": [(r.scored.terms[-1].effect.name, round(float(r.value), 2)) for r in found.selection.first[:8]],
        "left_nats": found.left.total_nats, "explained_nats": found.left.explained_nats,
        "left_by_channel": {
            c: round(float(found.left.nats[n].sum()), 2) for c, n in board.by_channel.items()
            if found.left.nats[n].sum() > 0.5
        },
        "left_by_joint": {board.robot.joint_names[j]: round(float(x), 2) for j, x in enumerate(by_joint) if x > 0.5},
        "squares": {
            c: [round(float((found.left.shares * found.left.left)[n].sum()), 2), round(float(_explained(best, n)), 2)]
            for c, n in board.by_channel.items()
        },
        "held_out": None if best is None else {
            c: [round(float(m), 2) for m in best.held_out[n]] for c, n in board.by_channel.items() if len(n) <= 16
        },
        "pulls": _largest(board, best),
    }  # fmt: skip


def _by_fold(best: Any, number: int) -> Any:
    sizes = [len(c) for c in best.coefficients]
    return best.spread[:, sum(sizes[:number]) : sum(sizes[: number + 1])]


def _left_by_null(found: Explained) -> Any:
    """What would be left and predictable without any effect."""
    return remainder(
        found.board,
        found.stack,
        Scorer(found.board).residuals(ORDINARY_AT_MOST),
        np.zeros(len(found.board.blocks)),
        0.0,
    )


def _explained(best: Any, numbers: list[int]) -> float:
    return 0.0 if best is None else float(best.explained[numbers].sum())


def _largest(board: Any, best: Any) -> list[tuple[str, float]]:
    from diagnosis.selection.scoring import null_of

    pulls = (best or null_of(board)).pulls
    return [(board.ordinary.names[i], round(float(pulls[i]), 2)) for i in np.argsort(-np.abs(pulls))[:6]]


def _worked(job: tuple[int, int, str, tuple[FaultRequest, ...], int, tuple[str, ...]]) -> list[Row]:
    try:
        return case(*job)
    except Exception as error:  # noqa: BLE001 - a batch goes on, and the row says what happened
        return [{"case": job[1], "seed": job[0], "error": repr(error), "trace": traceback.format_exc()[-1500:]}]


def run(given: argparse.Namespace) -> None:
    """Work through the cases until they or the time are over."""
    began = time.monotonic()
    kinds = tuple(k for k in given.kinds.split(",") if k)
    numbers = tuple(str(given.calibrations).split(","))
    jobs = [
        (int(given.seed), i, policy, faults, int(given.repeats), numbers)
        for i, policy, faults in drawn(given.seed, given.cases, kinds)
    ][given.first :]
    context = multiprocessing.get_context("fork")
    with given.out.open("a", encoding="utf-8") as out, context.Pool(given.jobs, maxtasksperchild=4) as pool:
        rows = pool.imap_unordered(_worked, jobs)
        for n in range(len(jobs)):
            left = given.until - (time.monotonic() - began)
            try:
                found = rows.next(timeout=max(1.0, left))
            except multiprocessing.TimeoutError:
                print(f"time is over after {n} of {len(jobs)} cases")
                pool.terminate()
                break
            for row in found:
                out.write(json.dumps(row) + "\n")
            out.flush()


def names_of(row: Row) -> list[set[str]]:
    """Right answers of each fault of a case; empty sets where the library has none."""
    return [set(f["names"]) - set(row["left_out"]) for f in row["truth"]]


def verdict_of(row: Row) -> tuple[bool, float]:
    """Whether a row's verdict is right, and the joints' F1 (1 where there are none to name)."""
    wanted, groups = names_of(row), [set(e["group"][:3]) | {e["name"]} for e in row["effects"]]
    if row["status"] == "unknown_effect":
        groups = []
    if not wanted:
        return row["status"] in ("no_gap", "cannot_tell"), 1.0
    unknown = any(not w for w in wanted)
    right = all(any(w & g for g in groups) for w in wanted if w)
    if unknown:
        right &= row["status"] in ("unknown_effect", "partly_explained")
    true = {j for f in row["truth"] for j in f["joints"]}
    if not true:
        return right, 1.0
    said = {j for e in row["effects"] for j in e["joints"]}
    if row["status"] in ("unknown_effect", "partly_explained"):
        most = max(row["left_by_joint"].values(), default=0.0)
        carry = {j for j, x in row["left_by_joint"].items() if x > 0.35 * most}
        said = carry if row["status"] == "unknown_effect" else said | carry
    return right, 2.0 * len(said & true) / max(1, len(said) + len(true))


def table(rows: list[Row]) -> None:
    """Print accuracy by kind."""
    groups: Mapping[str, list[tuple[bool, float]]] = defaultdict(list)
    for row in rows:
        if "error" in row:
            print("error", row["case"], row["error"])
            continue
        kinds = "+".join(f["kind"] for f in row["truth"]) or "none"
        word = "left out: " if row["left_out"] else "pair" if len(row["truth"]) > 1 else ""
        groups[word if word == "pair" else word + kinds].append(verdict_of(row))
    for name in sorted(groups):
        right, f1 = zip(*groups[name], strict=True)
        print(f"{name:45s} {sum(right):3d}/{len(right):<3d} joint F1 {np.mean(f1):.2f}")
    for word, chosen in (
        ("none", lambda n: n == "none"), ("left out", lambda n: n.startswith("left out")),
        ("pairs", lambda n: n == "pair"), ("single", lambda n: n not in ("none", "pair") and ":" not in n),
    ):  # fmt: skip
        mine = [v for n, vs in groups.items() if chosen(n) for v in vs]
        if mine:
            print(
                f"{word:10s} {np.mean([v[0] for v in mine]):.2f} of {len(mine)}, F1 {np.mean([v[1] for v in mine]):.2f}"
            )


def main() -> None:
    """Run or tabulate."""
    parser = argparse.ArgumentParser(description=__doc__)
    steps = parser.add_subparsers(dest="step", required=True)
    running = steps.add_parser("run")
    running.add_argument("--out", type=Path, required=True)
    running.add_argument("--cases", type=int, default=64)
    running.add_argument("--first", type=int, default=0)
    running.add_argument("--seed", type=int, default=1)
    running.add_argument("--jobs", type=int, default=1)
    running.add_argument("--repeats", type=int, default=3)
    running.add_argument("--until", type=float, default=1e9, help="seconds after which what is not done is left")
    running.add_argument("--kinds", default="", help="only these, separated by commas")
    running.add_argument("--calibrations", default="", help="changes to compare, as dof=60;ordinary=1.5,dof=90")
    showing = steps.add_parser("table")
    showing.add_argument("rows", type=Path, nargs="+")
    given = parser.parse_args()
    if given.step == "run":
        run(given)
    else:
        table([json.loads(line) for p in given.rows for line in p.read_text().splitlines()])


if __name__ == "__main__":
    main()
