"""The paper's story in one command: walk, log, find out what the robot is like, train again, walk faster.

    python examples/close_the_loop.py --robot paper --out OUT --device cuda
    python examples/close_the_loop.py --robot weak_knees --out OUT --improved IMPROVED.onnx --oracle ORACLE.onnx

1. *before*, a policy that was trained without knowing the robot, walks the paper's four command sequences.
2. ``spot-rl improve`` makes *after* from these logs, and the *oracle* is trained the same way on the robot's own truth.
   A policy that is given (``--improved``, ``--oracle``) is taken instead; without a GPU there is no other oracle.
3. All three climb stairs of speeds, run the paper's forward sequence, and walk ten times at random.

``OUT/loop.html`` shows it. Every step leaves its files in OUT; a step whose files are there is not done again.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Final

import numpy as np
from loop_measures import Deployment, deployment, jumps, stairs
from loop_page import Walked, loop_page
from loop_robots import ROBOTS, robot_of, walk

from diagnosis.improve.retraining import RETRAIN, train_words
from spot_log import Run, read_run
from spot_model.errors import BadInputError
from spot_model.io.model_file import save_model
from spot_model.io.velocity_sequence import VelocitySequence, load_sequence
from spot_model.policy.built_in import policy_file
from spot_model.policy.policy import Policy, load_policy
from trainer.collect.collect_run import PAPER_SEQUENCES, sequence_sources

WALKS: Final = 10
WIDER: Final = "task.commands.v_x_m_s=[-2, 6.5]"
"""A policy that knows its robot may be asked for more than before."""


def main() -> None:
    """Run the loop and print its table."""
    given = _options()
    out: Path = given.out
    out.mkdir(parents=True, exist_ok=True)
    policies = {"before": given.before, "after": improved(given), "oracle": oracle(given)}
    there = {name: load_policy(path) for name, path in policies.items() if path is not None}
    record({name: policies[name] for name in there}, there, given)
    walked = [measured(name, policy, out / "walks" / name) for name, policy in there.items()]
    table = [one.row for one in walked]
    # A robot that tipped over has no speed at rest; JSON has no NaN.
    rows = [{k: None if isinstance(v, float) and np.isnan(v) else v for k, v in asdict(row).items()} for row in table]
    (out / "loop.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    (out / "loop.html").write_text(loop_page(given.robot, robot_of(given.robot).truth(), walked), encoding="utf-8")
    print("\n".join(lines(table)))
    print(f"page {out / 'loop.html'}")


def improved(given: argparse.Namespace) -> Path | None:
    """*after*: the policy that was given, or what ``spot-rl improve`` makes of *before*'s logs."""
    if given.improved is not None:
        return Path(given.improved)
    logs, out = given.out / "logs", given.out / "improve"
    asked = [load_sequence(source) for source in sequence_sources(",".join(PAPER_SEQUENCES))]
    make([(given.robot, given.before, s, given.seed, logs / f"{s.name}.mcap") for s in asked], given.runs_at_once)
    nominal = given.out / "nominal.yaml"
    if not nominal.exists():
        save_model(robot_of(given.robot).nominal(), nominal)
    words = ["improve", str(logs), "--policy", str(given.before), "--nominal", str(nominal), "--out", str(out)]
    spot_rl([*words, "--device", given.device, *(w for change in changes(given) for w in ("--set", change))])
    made: Path = out / "improved.onnx"
    return made if made.exists() else None


def oracle(given: argparse.Namespace) -> Path | None:
    """The policy that was given, or one trained by the same config on the robot's own truth; None without a GPU."""
    if given.oracle is not None:
        return Path(given.oracle)
    made: Path = given.out / "oracle.onnx"
    if given.device != "cpu" and not made.exists():
        truth, run = given.out / "truth.yaml", given.out / "train-oracle"
        truth.unlink(missing_ok=True)
        save_model(robot_of(given.robot).truth(), truth)
        contract = load_policy(given.before).contract
        changed = (*changes(given), "name=oracle")
        words = train_words(truth, given.before, contract, RETRAIN, changed, run, given.device)
        spot_rl(["train", "--resume", str(run), "--device", given.device] if run.exists() else list(words))
        spot_rl(["export", str(run), "--out", str(made)])
    return made if made.exists() else None


def changes(given: argparse.Namespace) -> tuple[str, ...]:
    """What both trainings change in the config."""
    return (WIDER, f"seed={given.seed + 1}")


Job = tuple[str, Path, VelocitySequence, int, Path]
"""Robot, policy, what is asked for, seed, and the log's place."""


def record(files: dict[str, Path], policies: dict[str, Policy], given: argparse.Namespace) -> None:
    """Make all walks that the table needs and that are not there."""
    jobs: list[Job] = []
    for name, policy in policies.items():
        folder = given.out / "walks" / name
        top_m_s = float(policy.contract.velocity_command_high[0])
        asked = [("stairs", 0, stairs(top_m_s)), ("forward", 0, load_sequence("forward"))]
        asked += [("jumps", seed, jumps(np.random.default_rng(seed))) for seed in range(1, WALKS + 1)]
        jobs += [(given.robot, files[name], s, seed, folder / f"{label}-{seed}.mcap") for label, seed, s in asked]
    make(jobs, given.runs_at_once)


def make(jobs: Sequence[Job], at_once: int) -> None:
    """Make the logs that are missing, some at a time; a log does not depend on how many."""
    missing = [job for job in jobs if not job[-1].exists()]
    with ProcessPoolExecutor(at_once, mp_context=multiprocessing.get_context("spawn")) as pool:
        for job, _ in zip(missing, pool.map(walk, *zip(*missing, strict=True)) if missing else (), strict=True):
            print(f"walked {job[-1]}", flush=True)


def measured(name: str, policy: Policy, folder: Path) -> Walked:
    """What the logs of one policy say.

    Raises:
        BadInputError: They are of another policy.
    """

    def read(path: Path) -> Run:
        run = read_run(path)
        if run.header.policy_sha256 != policy.sha256:
            raise BadInputError(f"{path} is a walk of another policy; name another folder with --out, or remove it")
        return run

    climb, forward = read(folder / "stairs-0.mcap"), read(folder / "forward-0.mcap")
    walks = [read(folder / f"jumps-{seed}.mcap") for seed in range(1, WALKS + 1)]
    return Walked(deployment(name, climb, forward, walks), climb)


def lines(table: Sequence[Deployment]) -> list[str]:
    """The table as text."""
    head = "policy        held (asked)       error    cost    at rest      turning    falls  stairs"
    rows = [
        f"{r.policy:<8} {r.held_m_s:>6.2f} ({r.commanded_m_s:.1f}) m/s {r.tracking_error_m_s:>6.3f} m/s "
        f"{r.cost_of_transport:>6.2f} {r.standing_m_s:>6.2f} m/s {r.turning_error_rad_s:>6.2f} rad/s "
        f"{r.falls:>3} of {r.walks}  {r.stairs_end}"
        for r in table
    ]
    return [head, *rows]


def spot_rl(words: list[str]) -> None:
    """Run one of our commands.

    Raises:
        SystemExit: It failed; what went wrong stands above.
    """
    print("spot-rl", " ".join(words), flush=True)
    code = subprocess.run([sys.executable, "-m", "spot_model", *words], check=False).returncode  # noqa: S603
    if code != 0:
        raise SystemExit(f"spot-rl {words[0]} ended with exit code {code}; what went wrong stands above")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", default="paper", help=f"{', '.join(ROBOTS)}, or a scenario file")
    parser.add_argument("--out", type=Path, required=True, help="folder of all files; finished steps are kept")
    parser.add_argument("--seed", type=int, default=0, help="draws *before*'s logs and both trainings")
    parser.add_argument("--before", type=policy_file, default="baseline", help="policy to begin with")
    parser.add_argument("--improved", type=policy_file, help="policy to take as after")
    parser.add_argument("--oracle", type=policy_file, help="policy to take as oracle")
    parser.add_argument("--runs-at-once", type=int, default=2, help="logs made at a time")
    parser.add_argument("--device", default="cpu", help="cpu, cuda or cuda:N, for training")
    return parser.parse_args()


if __name__ == "__main__":
    main()
