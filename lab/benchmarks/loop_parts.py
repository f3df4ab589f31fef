"""Where the time of a control tick goes: median and 99th percentile of each part, in µs.

Runs `spot-rl run` for standing in real time against a fake robot, with timers around the parts of the loop. What lies
within a part is counted there and not above it, so the medians add up to about the whole. The timers make the tick
longer, by about a tenth.

    python lab/benchmarks/loop_parts.py [--busy 2] [--seconds 10] [--policy walk]
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any, Final

import numpy as np

from proof.loop_bench import robot_beside
from spot_model.policy.built_in import policy_file
from spot_model.policy.policy import Policy
from spot_runtime.control import loop, step
from spot_runtime.control.safety import watchdogs
from spot_runtime.hal.spot.adapter import BosdynHal
from spot_runtime.hal.spot.command_stream import CommandEncoder

FIFO: Final = 40
SETTLED: Final = 25
"""Ticks left out at the start: half a second, in which everything is touched for the first time."""

PARTS: Final = (
    ("clocks and problems of the link", loop.ControlLoop, "_look"),
    ("screening of states", watchdogs, "screen"),
    ("watchdogs", watchdogs, "look"),
    ("modes", step, "_end_and_move"),
    ("observation", Policy, "observe"),
    ("network", Policy, "act"),
    ("rest of the policy", step, "_run_policy"),
    ("limits of the set-point", step, "_aim"),
    ("last check of the command", step, "_command"),
    ("encoding", CommandEncoder, "encode"),
    ("hand-over to the transport", BosdynHal, "send"),
    ("rest of the step", loop, "control_step"),
)
"""Name of a part, and where its function is."""


class Timers:
    """Time of each part of the tick under way, without the parts within it."""

    def __init__(self) -> None:
        self.ticks: list[dict[str, float]] = []
        self._now: defaultdict[str, float] = defaultdict(float)
        self._within_s = [0.0]

    def around(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function with a timer."""

        def timed(*given: Any, **named: Any) -> Any:
            if name == PARTS[0][0]:  # a new cycle; what the loop has tried for the next state before is not its time
                self._now.clear()
            self._within_s.append(0.0)
            begin_s = perf_counter()
            try:
                return function(*given, **named)
            finally:
                took_s = perf_counter() - begin_s
                self._now[name] += took_s - self._within_s.pop()
                self._within_s[-1] += took_s

        return timed

    def ends(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """``tick_record``, which has the time of the whole."""

        def ended(done: Any, tick: Any, now: Any, compute_s: float) -> Any:
            if tick.result is not None:
                self.ticks.append({**self._now, "whole": compute_s})
            return function(done, tick, now, compute_s)

        return ended


def inside(out: Path, words: list[str]) -> None:
    """Run ``spot-rl`` with timers in this process, and write each tick's times."""
    from spot_model.__main__ import main as spot_rl

    timers = Timers()
    for name, place, function in PARTS:
        setattr(place, function, timers.around(name, getattr(place, function)))
    loop.tick_record = timers.ends(loop.tick_record)
    sys.argv = ["spot-rl", *words]
    try:
        spot_rl()
    finally:
        out.write_text(json.dumps(timers.ticks))


def main() -> None:
    """Run once, and print one JSON object."""
    if sys.argv[1:2] == ["--inside"]:
        inside(Path(sys.argv[2]), sys.argv[3:])
        return
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--policy", type=policy_file, default="walk")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--busy", type=int, default=0, help="processes that only burn time")
    chosen = parser.parse_args()
    with robot_beside(chosen.busy, "default") as (address, cpus), tempfile.TemporaryDirectory() as folder:
        config, out = Path(folder) / "run.yaml", Path(folder) / "ticks.json"
        config.write_text(json.dumps({"real_time": {"cpu_affinity": cpus, "fifo_priority": FIFO}}))
        words = ["run", "--robot", address.robot, "--policy", str(chosen.policy), "--sequence", "standing"]
        words += ["--config", str(config), "--duration", str(chosen.seconds), "--log-dir", folder]
        subprocess.run(  # noqa: S603 - our own command line
            [sys.executable, __file__, "--inside", str(out), *words],
            env={**os.environ, **address.environment},
            check=True,
            stdout=subprocess.DEVNULL,
        )
        ticks = json.loads(out.read_text())[SETTLED:]
    told: dict[str, Any] = {"ticks": len(ticks)}
    for name in (*(name for name, _, _ in PARTS), "whole"):
        median, late = np.percentile([1e6 * tick.get(name, 0.0) for tick in ticks], (50, 99))
        told[name] = {"p50_us": round(median, 1), "p99_us": round(late, 1)}
    print(json.dumps(told, indent=1))


if __name__ == "__main__":
    main()
