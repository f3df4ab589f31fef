"""Claim: 20 s of joint control in lock-step take under 3 s on two idle cores.

Runs `spot-rl run --lock-step` against a fake robot in its own process and prints how long the controlled part took.
Usage: python benchmarks/loop_lock_step.py [SECONDS [POLICY]]
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from proof.fake_process import FakeProcess

COMMAND = [sys.executable, "-c", "from spot_model.io.command_line import main; main()", "run"]


def measure(seconds: float, policy: str) -> None:
    """One run; the summary's own clocks count, so that starting two processes does not."""
    with tempfile.TemporaryDirectory() as folder, FakeProcess(is_lock_step=True) as fake:
        summary = Path(folder) / "summary.json"
        words = ["--robot", fake.address.robot, "--lock-step", fake.address.admin, "--policy", policy]
        words += ["--duration", str(seconds), "--log-dir", folder, "--summary-json", str(summary)]
        subprocess.run(  # noqa: S603 - our own command line
            [*COMMAND, *words], env={**os.environ, **fake.address.environment}, check=True, capture_output=True
        )
        figures = json.loads(summary.read_text())
    robot_s, wall_s = figures["control_robot_s"], figures["control_wall_s"]
    print(f"{robot_s:.1f} s of robot time in {wall_s:.2f} s: 20 s take {20.0 * wall_s / robot_s:.2f} s")
    print(f"load average of this machine: {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    measure(
        float(sys.argv[1]) if len(sys.argv) > 1 else 20.0, sys.argv[2] if len(sys.argv) > 2 else "policies/walk.onnx"
    )
