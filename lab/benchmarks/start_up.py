"""How soon the command line and a run are there, and what a run holds in memory, against a fake robot in real time.

python lab/benchmarks/start_up.py [RUNS]
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from fake_robot.start.process import FakeAddress, FakeProcess
from spot_log import read_run

SPOT_RL = [str(Path(sys.executable).with_name("spot-rl"))]


FIRST: dict[str, list[str]] = {
    "help_s": [*SPOT_RL, "--help"],
    "run_help_s": [*SPOT_RL, "run", "--help"],
    "import_s": [sys.executable, "-c", "import spot_rl"],
}
"""What somebody who looks for a command or a name waits for."""


def time_s(command: list[str]) -> float:
    """Time of a command, s."""
    began_s = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)  # noqa: S603 - our own command line
    return time.perf_counter() - began_s


def start_of_a_run(address: FakeAddress, folder: Path) -> dict[str, float]:
    """One run: from the start of its process to its first state, s, and its memory at the end, MB.

    Args:
        address: Of the fake robot.
        folder: A new one: a run overwrites no summary.
    """
    folder.mkdir()
    summary = folder / "summary.json"
    words = ["run", "--robot", address.robot, "--policy", "walk", "--sequence", "standing"]
    words += ["--duration", "1", "--log-dir", str(folder), "--summary-json", str(summary)]
    began_ns = time.time_ns()
    environment = {**os.environ, **address.environment}
    subprocess.run([*SPOT_RL, *words], env=environment, check=True, capture_output=True)  # noqa: S603 - our own
    told = json.loads(summary.read_text())
    states = read_run(Path(told["log_path"])).states
    return {"first_state_s": (int(states.host_stamp_ns[0]) - began_ns) / 1e9, "rss_mb": told["rss_mb"]}


def main() -> None:
    """Print one JSON object: median and worst of each."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    # Once more than counted: the first brings the files into the system's cache.
    found = {name: [time_s(command) for _ in range(count + 1)][1:] for name, command in FIRST.items()}
    with FakeProcess(fifo_priority=30) as fake, tempfile.TemporaryDirectory() as folder:
        runs = [start_of_a_run(fake.address, Path(folder) / str(number)) for number in range(count)]
    found |= {name: [run[name] for run in runs] for name in runs[0]}
    worst = {name: {"median": round(statistics.median(v), 3), "worst": round(max(v), 3)} for name, v in found.items()}
    print(json.dumps(worst, indent=2))


if __name__ == "__main__":
    main()
