"""What the example of the closed loop measures and draws."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from spot_log import read_run
from spot_log.format.records import RunHeader
from spot_log.read.run import Run, RunFooter, run_of_columns
from spot_model.io.velocity_sequence import standing_sequence
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
def parts() -> Iterator[dict[str, ModuleType]]:
    """The example's modules by name; each imports those before it."""
    names = ("loop_measures", "loop_robots", "loop_page")
    yield {name: loaded(name) for name in names}
    for name in names:
        del sys.modules[name]


@pytest.fixture(scope="module")
def measures(parts: dict[str, ModuleType]) -> ModuleType:
    return parts["loop_measures"]


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
            "velocity_rad_s": 2.0 * one,
            "load_nm": 3.0 * one,
            "foot_contact": np.arange(n)[:, None] % 20 < 10 + np.zeros(4),
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


def test_the_highest_speed_is_that_of_the_best_step_held_to_its_end(measures: ModuleType, policy: Policy) -> None:
    command = measures.stairs(6.5).sampled(50.0)[:, 0]

    def best(speed: np.ndarray) -> tuple[float, float]:
        run = made(policy, command[: len(speed)], speed)
        row = measures.deployment("before", run, run, [])
        return row.held_m_s, row.commanded_m_s

    slow = np.minimum(command, 4.2)
    assert best(slow) == (pytest.approx(4.2), 4.5)
    assert best(command) == (pytest.approx(6.5), 6.5)
    # A fall in the middle of the step to 4 m/s: the step before counts.
    end = int(np.flatnonzero(command >= 4.0)[0]) + 200
    assert best(command[:end]) == (pytest.approx(3.5), 3.5)
    assert best(command[:300]) == (0.0, 0.0)


def test_the_stairs_hold_every_speed_that_the_policy_accepts_for_ten_seconds(measures: ModuleType) -> None:
    command = measures.stairs(5.5).sampled(50.0)[:, 0]
    for speed in measures.SPEEDS_M_S:
        assert np.sum(np.abs(command - speed) < 1e-6) >= 500 * (speed <= 5.5)
    assert command.max() == 5.5
    assert np.abs(np.diff(command)).max() <= 0.05
    assert command[-1] == 0.0


def test_jumps_follow_from_the_seed_and_stay_within_their_bounds(measures: ModuleType) -> None:
    first, again, other = (measures.jumps(np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert first == again != other
    commands = other.sampled(50.0)
    assert np.abs(commands[:, 0] * commands[:, 2]).max() <= measures.LATERAL_M_S2
    assert len(np.unique(commands, axis=0)) == measures.JUMPS + 1


def test_a_row_worked_out_by_hand(measures: ModuleType, policy: Policy) -> None:
    run = made(policy, np.full(300, 2.0), np.full(300, 1.5))
    fallen = replace(run, footer=RunFooter(0, {}, {}, "tilt"))
    whole = replace(run, footer=RunFooter(0, {}, {}, "completed"))
    row = measures.deployment("before", run, run, [whole, fallen, whole])
    assert row.tracking_error_m_s == pytest.approx(0.5)
    # Twelve joints give 3 N·m at 2 rad/s, 72 W; at 1.5 m/s.
    assert row.cost_of_transport == pytest.approx(72.0 / (facts.TOTAL_MASS_KG * 9.81 * 1.5))
    assert (row.falls, row.walks) == (1, 3)
    assert np.isnan(row.standing_m_s)
    assert measures.standing_speed(made(policy, np.zeros(100), np.full(100, -0.3))) == pytest.approx(0.3)


def test_the_turning_error_is_that_of_each_commands_last_second(measures: ModuleType, policy: Policy) -> None:
    run = made(policy, np.zeros(150), np.zeros(150))
    turns, rate = np.array(run.ticks.velocity_command), np.array(run.ticks.observation)
    first = int(np.argmax(run.ticks.mode == "active"))
    half = first + 75
    turns[first:half, 2], turns[half:, 2] = 1.0, -1.0
    rate[first:half, 5], rate[half:, 5] = 0.6, -0.9
    rate[half : half + 15, 5] = 5.0
    walk = replace(run, ticks=replace(run.ticks, velocity_command=turns, observation=rate))
    assert measures.turning_error([walk]) == pytest.approx(0.25)


def row(measures: ModuleType, policy: str, held_m_s: float, falls: int = 0, standing_m_s: float = 0.0) -> Any:
    return measures.Deployment(policy, held_m_s, 5.5, 0.1, 0.3, standing_m_s, 0.2, falls, 10, "completed")


def test_the_verdict_follows_from_the_rows(parts: dict[str, ModuleType]) -> None:
    page, measures = parts["loop_page"], parts["loop_measures"]
    before, oracle = row(measures, "before", 4.0), row(measures, "oracle", 5.5)

    def met(robot: str, after: Any) -> tuple[list[bool], bool]:
        told, is_met = page.verdict(robot, {"before": before, "after": after, "oracle": oracle})
        return [words.startswith("Met") for words in told], is_met

    assert met("paper", row(measures, "after", 5.3)) == ([True, True, True], True)
    assert met("paper", row(measures, "after", 5.1)) == ([True, False, False], False)
    assert met("harsher", row(measures, "after", 5.3)) == ([True, True], True)
    assert met("harsher", row(measures, "after", 5.3, falls=1)) == ([False, True], False)
    assert met("harsher", row(measures, "after", 5.3, standing_m_s=0.2)) == ([False, True], False)
    assert page.verdict("paper", {"before": before})[1] is False


def test_the_page_shows_each_policy_and_its_gait(parts: dict[str, ModuleType], policy: Policy) -> None:
    page, measures = parts["loop_page"], parts["loop_measures"]
    command = measures.stairs(3.0).sampled(50.0)[:, 0]
    climb = made(policy, command, command)
    walked = [page.Walked(row(measures, name, 3.0), climb) for name in ("before", "after")]
    text = page.loop_page("weak_knees", parts["loop_robots"].robot_of("weak_knees").truth(), walked)
    assert "weak_knees: 3.00 m/s before, 3.00 m/s after" in text
    assert text.count(">fl</text>") == 2
    assert "oracle, 3" not in text


def test_the_bounds_of_a_knee_are_those_of_the_limits_in_force(parts: dict[str, ModuleType]) -> None:
    weak, usual = (parts["loop_robots"].robot_of(name).truth() for name in ("weak_knees", "torque_lag"))
    speeds = np.array([0.0, 17.255, 30.0])
    high, low = parts["loop_page"].knee_bounds(usual, speeds)
    assert high == pytest.approx([97.0, 48.5, 0.0])
    assert low == pytest.approx([-108.79] * 3)
    assert parts["loop_page"].knee_bounds(weak, speeds)[0] == pytest.approx([45.0, 45.0, 0.0])


def test_a_withheld_walk_ends_where_the_runtime_would_stop_it(
    parts: dict[str, ModuleType], policy: Policy, tmp_path: Path
) -> None:
    robots, path = parts["loop_robots"], tmp_path / "walk.mcap"
    robot = robots.robot_of("weak_knees")
    robot.walk(Path(policy.path), standing_sequence(0.3), 1, path)
    run = read_run(path)
    assert run.outcome in {"completed", "body_low", "tilt", "joint_velocity"}
    assert run.header.policy_sha256 == policy.sha256
    again = tmp_path / "again.mcap"
    robot.walk(Path(policy.path), standing_sequence(0.3), 1, again)
    assert np.array_equal(read_run(again).states.position_rad, run.states.position_rad)
