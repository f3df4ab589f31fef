"""A robot other than Spot: what the diagnosis says that it can do for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from diagnosis.session import NO_MODEL, DiagnosisProgress, DiagnosisRequest, run_session
from diagnosis.terminal import twelve_lines
from spot_log.importing import import_log, load_mapping

KP, KD, INERTIA, RATE_HZ, STEPS = 20.0, 0.5, 0.25, 200, 20


def swings(names: list[str], seconds: float = 8.0) -> dict[str, np.ndarray]:
    """An arm whose joints follow sines with servo gains, the last one with dry friction of 1.5 N·m."""
    rng, n = np.random.default_rng(0), len(names)
    time_s = np.arange(int(RATE_HZ * seconds)) / RATE_HZ
    rate = 0.7 + 0.2 * np.arange(n)
    asked = 0.6 * np.sin(2 * np.pi * rate * time_s[:, None]) + 0.2 * np.sin(2 * np.pi * (rate + 1.3) * time_s[:, None])
    friction = np.append(np.zeros(n - 1), 1.5)
    x, v, rows = np.zeros(n), np.zeros(n), []
    for goal in asked:
        for _ in range(STEPS):
            torque = KP * (goal - x) - KD * v
            v = v + (torque - friction * np.tanh(v / 0.01)) / INERTIA / RATE_HZ / STEPS
            x = x + v / RATE_HZ / STEPS
        rows.append((x, v, torque))
    q, dq, load = (np.array(part) for part in zip(*rows, strict=True))
    sigma = {"q": 2e-4, "dq": 5e-3, "load": 0.02}
    told = {"q": q, "dq": dq, "load": load}
    return {"t": time_s, "goal": asked} | {k: a + sigma[k] * rng.normal(size=a.shape) for k, a in told.items()}


@pytest.mark.parametrize("names", [["hip", "knee"], ["pivot"]])
def test_it_says_what_it_can_do_and_never_to_train(names: list[str], tmp_path: Path) -> None:
    np.savez(tmp_path / "r.npz", **swings(names))
    signals = {
        "position": {"from": ["q"], "unit": "rad"},
        "velocity": {"from": ["dq"], "unit": "rad/s"},
        "load": {"from": ["load"], "unit": "N·m"},
        "setpoint_position": {"from": ["goal"], "unit": "rad"},
        "setpoint_velocity": {"value": 0, "unit": "rad/s"},
        "kp": {"value": KP, "unit": "N·m/rad"},
        "kd": {"value": KD, "unit": "N·m·s/rad"},
    }
    mapping = {"schema": "spot-rl/import/1", "robot": "arm", "joint_names": names, "foot_names": []}
    mapping |= {"command_sequence": "sines", "time": {"from": "t", "unit": "s"}, "signals": signals}
    (tmp_path / "m.yaml").write_text(yaml.safe_dump(mapping, allow_unicode=True))
    robot = tmp_path / "robot.yaml"
    robot.write_text(yaml.safe_dump({"schema": "spot-rl/robot/1", "name": "arm", "joint_names": names}))
    import_log(load_mapping(tmp_path / "m.yaml"), tmp_path / "r.npz", tmp_path / "log.mcap")
    inputs = DiagnosisRequest(logs=(str(tmp_path / "log.mcap"),), nominal="ideal")
    with DiagnosisProgress() as progress:
        result, paths = run_session(inputs, tmp_path / "out", progress, robot_file=robot)
    told = result.verdict
    assert told.no_model == NO_MODEL
    assert NO_MODEL in told.notes
    assert "model" not in paths
    lines = twelve_lines(told, paths)
    assert f"model       {NO_MODEL}" in lines
    assert not any("train on" in line for line in lines)
    assert "train on the" not in paths["report"].read_text()
    assert NO_MODEL in paths["report"].read_text()
