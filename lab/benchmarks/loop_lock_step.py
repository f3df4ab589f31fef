"""Claim: lock-step runs at seven times real time or more: 20 s of joint control take under 3 s on two idle cores.

Runs `spot-rl run --lock-step` against a fake robot in its own process; the summary's own clocks count, so that starting
two processes does not.

    python lab/benchmarks/loop_lock_step.py [SECONDS [POLICY]]
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from fake_robot.start.process import FakeProcess

COMMAND = [sys.executable, "-m", "spot_model", "run"]


def measure(seconds: float, policy: str) -> dict[str, float]:
    """One run."""
    with tempfile.TemporaryDirectory() as folder, FakeProcess(is_lock_step=True) as fake:
        summary = Path(folder) / "summary.json"
        words = ["--robot", fake.address.robot, "--lock-step", fake.address.admin, "--policy", policy]
        words += ["--duration", str(seconds), "--log-dir", folder, "--summary-json", str(summary)]
        subprocess.run(  # noqa: S603 - our own command line
            [*COMMAND, *words], env={**os.environ, **fake.address.environment}, check=True, capture_output=True
        )
        figures = json.loads(summary.read_text())
    robot_s, wall_s = figures["control_robot_s"], figures["control_wall_s"]
    return {
        "robot_s": round(robot_s, 1),
        "wall_s_for_20_s": round(20.0 * wall_s / robot_s, 2),
        "times_real_time": round(robot_s / wall_s, 2),
    }


if __name__ == "__main__":
    seconds, policy = [*sys.argv[1:], *("20", "walk")[len(sys.argv) - 1 :]]
    print(json.dumps(measure(float(seconds), policy)))
