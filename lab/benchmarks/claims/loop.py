"""Claim: the loop computes less a tick, answers sooner and keeps its period better than a textbook loop.

Three programs drive one kind of fake robot, whose network has no delay, one after another: `spot-rl run` (all checks,
limits and the log included), textbook_loop.py, and its bare gRPC echo, which is what the transport takes by itself.
All get the same CPU and the same priority. The robot's stamps judge: a state's acquisition, and the receipt of the
command that answers it, both echoed in the states.

    python lab/benchmarks/claims/loop.py [--busy 2] [--plain] [--seconds 10]
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from fake_robot.start.process import FakeAddress
from proof.loop_bench import robot_beside, run_once
from spot_log.read.reader import read_run
from spot_model.policy.built_in import policy_file

HERE = Path(__file__).parent
SCENARIO = str(HERE / "direct.yaml")
PERIOD_MS = 20.0
FIFO = 40
SETTLED = 25
"""Ticks left out at the start: half a second, in which everything is touched for the first time."""


def figures(ticks: np.ndarray, compute_s: list[float], skipped: int = 0) -> dict[str, float]:
    """What is told of a loop.

    Args:
        ticks: Stamps of the state and of its command's receipt, ns, shape (n, 2); NaN where no state has echoed it,
            as when two commands come within one state's period.
        compute_s: Of each tick.
        skipped: Ticks that the loop left out.
    """
    ticks = ticks[SETTLED:] / 1e6
    period_ms = np.diff(ticks[:, 1])
    period_ms = period_ms[np.isfinite(period_ms)]
    error_ms = np.abs(period_ms - PERIOD_MS)
    answered_ms = ticks[:, 1] - ticks[:, 0]
    told = {
        "rate_hz": 1e3 / period_ms.mean(),
        "rate_error_percent": abs(100.0 * (PERIOD_MS / period_ms.mean() - 1.0)),
        "period_error_mean_ms": error_ms.mean(),
        "period_error_p99_ms": np.percentile(error_ms, 99),
        "slipped": max(skipped, (period_ms > 1.5 * PERIOD_MS).sum()),
        **percentiles("state_to_command_ms", answered_ms[np.isfinite(answered_ms)]),
    }
    if compute_s:
        told |= percentiles("compute_us", np.array(compute_s[SETTLED:]) * 1e6)
    return {name: round(float(value), 3) for name, value in told.items()}


def percentiles(name: str, values: np.ndarray) -> dict[str, float]:
    """Median and 99th percentile."""
    return {f"{name}_p{q}": round(float(np.percentile(values, q)), 3) for q in (50, 99)}


def ours(address: FakeAddress, cpus: list[int], chosen: argparse.Namespace) -> dict[str, float]:
    """`spot-rl run`, from its log."""
    with tempfile.TemporaryDirectory() as folder:
        real_time = {"cpu_affinity": cpus, "fifo_priority": 0 if chosen.plain else FIFO}
        summary = run_once(address, Path(folder), chosen.seconds, chosen.policy, "standing", real_time)
        run = read_run(summary["log_path"])
    first_ns = int(run.states.robot_stamp_ns[0])
    receipts = dict(zip(run.states.last_command_key, run.states.last_command_robot_stamp_ns - first_ns, strict=True))
    pairs = zip(run.ticks.robot_stamp_ns - first_ns, run.ticks.command_key, strict=True)
    ticks = np.array([(stamp, receipts.get(key, np.nan)) for stamp, key in pairs], dtype=np.float64)
    network = percentiles("network_us", run.ticks.inference_s[SETTLED:] * 1e6)
    return figures(ticks, run.ticks.compute_s.tolist(), int(run.ticks.skipped[SETTLED:].sum())) | network


def textbook(address: FakeAddress, cpus: list[int], chosen: argparse.Namespace, *words: str) -> dict[str, float]:
    """The textbook loop, or with `--echo` the bare echo."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out.json"
        command = [sys.executable, str(HERE / "textbook_loop.py"), address.robot, "--out", str(out), *words]
        command += ["--policy", str(chosen.policy), "--seconds", str(chosen.seconds)]
        command += ["--fifo", "0" if chosen.plain else str(FIFO), "--cpus", *map(str, cpus)]
        environment = {**os.environ, **address.environment}
        subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL)  # noqa: S603
        told = json.loads(out.read_text())
    return figures(np.array(told["ticks"], dtype=np.float64), told["compute_s"])


def main() -> None:
    """Run each once, and print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--policy", type=policy_file, default="walk")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--busy", type=int, default=0, help="processes that only burn time")
    parser.add_argument("--plain", action="store_true", help="no real-time priority for the loops")
    chosen = parser.parse_args()
    told: dict[str, Any] = {}
    subjects = {
        "ours": ours,
        "textbook": textbook,
        "echo": lambda *given: textbook(*given, "--echo"),
    }
    for name, subject in subjects.items():
        with robot_beside(chosen.busy, SCENARIO) as (address, cpus):
            told[name] = subject(address, cpus, chosen)
    print(json.dumps(told))


if __name__ == "__main__":
    main()
