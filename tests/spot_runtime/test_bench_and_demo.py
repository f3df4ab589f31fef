"""The benchmark and the demo, end to end and short. Their figures are read by people, not by tests."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from spot_runtime.bench import KEYS

COMMAND = [sys.executable, "-c", "from spot_model.command_line import main; main()"]


@pytest.mark.slow
def test_the_loop_benchmark_prints_one_object_with_every_figure(tmp_path: Path, make_policy_bytes: Any) -> None:
    policy = tmp_path / "policy.onnx"
    policy.write_bytes(make_policy_bytes())
    scenario = tmp_path / "brisk.yaml"
    scenario.write_text("power: {power_on_s: 0.4}\nmotion: {stand_s: 0.8, sit_s: 0.8}\n")
    words = ["bench", "loop", "--json", "--seconds", "2", "--busy-processes", "0", "--policy", str(policy)]
    words += ["--scenario", str(scenario)]
    done = subprocess.run([*COMMAND, *words], capture_output=True, text=True, timeout=300.0)
    if "ended with exit code" in done.stderr:
        pytest.skip(f"this machine is too busy for real time: {done.stderr.splitlines()[-1]}")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert set(result) == {"idle", "busy"}
    for part in result.values():
        assert set(part) == set(KEYS)
        assert part["ticks"] > 200


def test_the_demo_refuses_a_policy_that_cannot_walk_forward(tmp_path: Path, make_policy_bytes: Any) -> None:
    policy = tmp_path / "policy.onnx"
    policy.write_bytes(make_policy_bytes(velocity_command_high=(0.0, 0.0, 0.0)))
    done = subprocess.run(
        [*COMMAND, "demo", "--policy", str(policy), "--out", str(tmp_path / "out")],
        env=os.environ,
        capture_output=True,
        text=True,
        timeout=60.0,
    )
    assert done.returncode == 2
    assert "takes no forward speed" in done.stderr
    assert not (tmp_path / "out").exists()
