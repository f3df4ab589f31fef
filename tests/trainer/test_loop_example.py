"""What the example of the closed loop measures and draws."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from spot_log.format.records import RunHeader
from spot_log.read.run import Run, run_of_columns
from spot_model.effects.torque_limits import PositionTorqueLimit, TorqueSpeedCurve
from spot_model.policy.policy import Policy, load_policy
from spot_model.robot import facts

from .sysid.conftest import oscillator_bytes
from .sysid.test_read_logs import as_log

EXAMPLES = Path(__file__).parents[2] / "examples"


def loaded(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def measures() -> Iterator[ModuleType]:
    yield loaded("loop_measures")
    del sys.modules["loop_measures"]


@pytest.fixture(scope="module")
def picture() -> Iterator[ModuleType]:
    yield loaded("loop_picture")
    del sys.modules["loop_picture"]


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> Policy:
    path = tmp_path_factory.mktemp("policy") / "stamp.onnx"
    path.write_bytes(oscillator_bytes())
    return load_policy(path)


def made(policy: Policy, command: np.ndarray, speed: np.ndarray, setpoint_rad: float = 0.0) -> Run:
    """A run with a given command and forward speed; joints rest at their default, ``setpoint_rad`` from set-points."""
    n = len(command)
    stamps = np.arange(n, dtype=np.int64) * 20_000_000 + 1_000_000_000
    observation = np.zeros((n, 48), dtype=np.float32)
    observation[:, 0], observation[:, 8] = speed, -1.0
    commands = np.zeros((n, 3))
    commands[:, 0] = command
    rest = np.tile(facts.DEFAULT_POSITION_RAD, (n, 1))
    one, keys = np.ones((n, 12)), np.arange(1, n + 1)
    header = RunHeader(run_id="x", started_host_stamp_ns=0, command_sequence="forward", repeat=1)
    run = run_of_columns(
        Path("x"),
        header,
        states={
            "robot_stamp_ns": stamps,
            "position_rad": rest,
            "velocity_rad_s": 0.0 * one,
            "load_nm": 3.0 * one,
            "odom_from_body_wxyz": np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
            "linear_vel_of_body_in_odom_m_s": np.zeros((n, 3)),
            "angular_vel_of_body_in_odom_rad_s": np.zeros((n, 3)),
            "last_command_key": keys,
            "last_command_robot_stamp_ns": stamps,
        },
        commands={
            "key": keys,
            "robot_stamp_ns": stamps,
            "state_robot_stamp_ns": stamps,
            "position_rad": rest + setpoint_rad,
            "kp_nm_per_rad": 60.0 * one,
            "kd_nm_s_per_rad": 1.5 * one,
        },
        ticks={
            "robot_stamp_ns": stamps,
            "observation": observation,
            "action": np.zeros((n, 12), dtype=np.float32),
            "velocity_command": commands,
        },
    )
    logged = replace(run, header=replace(header, policy_sha256=policy.sha256))
    return as_log(logged, policy)


def test_sustained_speed_is_the_best_whole_step(measures: ModuleType, policy: Policy) -> None:
    command = measures.stairs().sampled(50.0)[:, 0]
    slow = np.minimum(command, 4.2)
    assert measures.sustained_speed(made(policy, command, slow))[0] == pytest.approx(4.2)
    assert measures.sustained_speed(made(policy, command, command)) == (pytest.approx(7.0), 7.0)
    # A fall in the middle of the step to 4 m/s: the step before counts.
    end = int(np.flatnonzero(command >= 4.0)[0]) + 200
    assert measures.sustained_speed(made(policy, command[:end], command[:end])) == (pytest.approx(3.5), 3.5)
    assert measures.sustained_speed(made(policy, command[:300], command[:300])) == (0.0, 0.0)


def test_the_stairs_hold_every_speed_for_ten_seconds(measures: ModuleType) -> None:
    command = measures.stairs().sampled(50.0)[:, 0]
    for speed in measures.SPEEDS_M_S:
        assert np.sum(np.abs(command - speed) < 1e-6) >= 500
    assert np.abs(np.diff(command)).max() <= 0.05
    assert command[-1] == 0.0


def test_errors_and_torques_worked_out_by_hand(measures: ModuleType, policy: Policy) -> None:
    run = made(policy, np.full(300, 2.0), np.full(300, 1.5), setpoint_rad=1.0)
    assert measures.tracking_error(run) == pytest.approx(0.5)
    assert measures.knee_torque(run) == pytest.approx(3.0)
    # 60 N·m are asked for at rest; 45 are given.
    curve = TorqueSpeedCurve(joints=("knees",), torque_max_nm=45.0, torque_min_nm=-45.0)
    free = PositionTorqueLimit(motor_torque_nm=10.0)
    assert measures.knee_shortage(run, curve, free) == pytest.approx(15.0)
    assert measures.knee_shortage(run, replace(curve, torque_max_nm=100.0), free) == 0.0


def test_the_picture_is_whole_and_names_who_ended_early(picture: ModuleType, policy: Policy, tmp_path: Path) -> None:
    long, short = (made(policy, np.full(n, 2.0), np.full(n, 2.0)) for n in (900, 300))
    path = tmp_path / "overlay.svg"
    picture.write_overlay({"baseline": short, "identified": long, "oracle": long}, path, "Knees <at> 4 m/s")
    text = path.read_text()
    root = ET.fromstring(text)  # noqa: S314 - our own file
    assert "baseline (ended before)" in text
    assert "Knees &lt;at&gt; 4 m/s" in text
    assert sum(e.tag.endswith("polyline") for e in root.iter()) == 8
