"""The benchmark and the demo, end to end and short. Their figures are read by people, not by tests."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import pytest

from proof.loop_bench import KEYS
from spot_model.process.signals import exit_on_termination

pytestmark = pytest.mark.slow

COMMAND = [sys.executable, "-c", "from spot_model.console.command_line import main; main()"]


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


def test_a_command_that_is_ended_clears_away_what_it_began() -> None:
    with tempfile.TemporaryDirectory(prefix="e") as folder:  # the path of a socket in it must be short
        process = subprocess.Popen(
            [*COMMAND, "bench", "loop", "--policy", "policies/walk.onnx"],
            env={**os.environ, "TMPDIR": folder},
            stderr=subprocess.DEVNULL,
        )
        while not list(Path(folder).glob("spot-rl-bench-*")) and process.poll() is None:
            time.sleep(0.02)
        process.send_signal(signal.SIGTERM)
        assert process.wait(120.0) == 128 + signal.SIGTERM
        assert list(Path(folder).iterdir()) == []


def test_signals_that_end_a_block_do_what_they_did_once_it_is_over() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(SystemExit) as ended, exit_on_termination():
        signal.raise_signal(signal.SIGHUP)
    assert ended.value.code == 129
    assert signal.getsignal(signal.SIGTERM) is before
