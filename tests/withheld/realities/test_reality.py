"""Whole realities: the same from a seed, walking, and with logs that everybody reads."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from diagnosis.recording import record
from spot_log import read_run
from spot_log.commands import app
from spot_model.io.velocity_sequence import VelocitySequence, Waypoint
from tests.withheld.realities.quick import POLICIES, QUICK, ahead, policy, request, short_run
from withheld.blind.distances import read_folder, walks_of
from withheld.plan import SIGNALS, Reality, RecordingPlan, Signal
from withheld.realities.reality import make
from withheld.simulator.settings import Settings
from withheld.simulator.simulation import RealityDivergedError, RunRequest, simulate


def plan(*sequences: VelocitySequence, repeats: int = 1, missing: tuple[Signal, ...] = ()) -> RecordingPlan:
    return RecordingPlan(POLICIES / "walk.onnx", sequences, repeats, 9, frozenset(missing))


def test_a_made_reality_is_one() -> None:
    assert isinstance(make([], 0), Reality)


def test_leaving_a_fault_out_leaves_the_same_robot() -> None:
    both = make([request("flux_change"), request("box_on_the_back", 0.5)], 4)
    one = make([request("box_on_the_back", 0.5)], 4)
    assert both.truth.faults[1] == one.truth.faults[0]
    assert np.array_equal(both.robot().drive.kp_scale, make([], 4).robot().drive.kp_scale)
    assert not np.array_equal(make([], 4).robot().drive.kp_scale, make([], 5).robot().drive.kp_scale)


def test_a_run_is_the_same_whatever_runs_beside_it() -> None:
    robot = make([request("sloshing_tank"), request("learned_drive", 0.3), request("headwind", 0.3)], 2).robot()
    alone, *_ = simulate(robot, policy(), [RunRequest(ahead(0.2), np.random.default_rng(3))], QUICK)
    requests = [RunRequest(ahead(0.2, v), np.random.default_rng(seed)) for v, seed in ((0.5, 1), (1.0, 3))]
    beside = simulate(robot, policy(), requests, QUICK)[1]
    for name in ("load_nm", "position_rad", "linear_vel_of_body_in_odom_m_s", "imu_acceleration_m_s2"):
        assert np.array_equal(getattr(alone, name), getattr(beside, name))


def test_runs_of_different_length_are_refused_side_by_side() -> None:
    requests = [RunRequest(ahead(t), np.random.default_rng(0)) for t in (0.2, 0.3)]
    with pytest.raises(ValueError, match=r"these last \[0.2, 0.3\] s"):
        simulate(make([], 0).robot(), policy(), requests, QUICK)


def test_a_rehearsal_has_the_ticks_of_the_logs(tmp_path: Path) -> None:
    made = replace(make([request("flux_change")], 5), settings=QUICK)
    rehearsed = made.rehearse(plan(ahead(0.4), repeats=2))
    rehearsed.write(tmp_path)
    walks, logged = rehearsed.walks, walks_of(read_folder(tmp_path))
    assert [name for name, _ in walks] == [name for name, _ in logged] == ["ahead", "ahead"]
    for (_, ticks), (_, read) in zip(walks, logged, strict=True):
        for name in ("index", "mode", "observation", "action", "velocity_command", "command_key"):
            assert np.array_equal(getattr(ticks, name), getattr(read, name))


def test_logs_are_read_by_all_who_read_logs(tmp_path: Path) -> None:
    made = replace(make([], 5), settings=QUICK)
    made.record(plan(ahead(0.5), ahead(0.4), repeats=2), tmp_path)
    files = sorted(tmp_path.iterdir())
    assert len(files) == 4
    assert all(len(f.stem) == 16 and f.suffix == ".mcap" for f in files)
    seen = set()
    for file in files:
        run = read_run(file)
        assert run.damage == ()
        assert run.footer is not None
        assert run.footer.outcome == "completed"
        seen.add((run.header.command_sequence, run.header.repeat, len(run.states)))
        laid = record(run)
        assert laid.period_s == pytest.approx(0.003)
        assert laid.has_receipts
        assert laid.has("imu.acceleration_m_s2")
        assert laid.has("load_nm")
        assert len(run.slow_states) >= 3
        assert np.mean(laid.commands.state_robot_stamp_ns > 0) == 1.0
    assert {r for _, r, _ in seen} == {0, 1}
    result = CliRunner().invoke(app, ["info", str(files[0])])
    assert result.exit_code == 0, result.output


def test_the_same_plan_gives_the_same_signals_and_another_seed_does_not(tmp_path: Path) -> None:
    made = replace(make([], 5), settings=QUICK)
    runs = []
    for folder, seed in (("a", 9), ("b", 9), ("c", 10)):
        made.record(replace(plan(ahead(0.15)), seed=seed), tmp_path / folder)
        runs.append(read_run(next((tmp_path / folder).iterdir())))
    assert np.array_equal(runs[0].states.load_nm, runs[1].states.load_nm)
    assert runs[0].header.run_id == runs[1].header.run_id
    assert not np.array_equal(runs[0].states.load_nm, runs[2].states.load_nm)


def test_nothing_but_signals_tells_a_fault(tmp_path: Path) -> None:
    runs = []
    for folder, requests in (("a", []), ("b", [request("lugre_friction")])):
        replace(make(requests, 5), settings=QUICK).record(plan(ahead(0.15)), tmp_path / folder)
        (file,) = (tmp_path / folder).iterdir()
        runs.append((file.name, read_run(file)))
    (name_a, a), (name_b, b) = runs
    assert name_a == name_b
    assert a.header == b.header
    assert a.events == b.events
    assert np.array_equal(a.states.robot_stamp_ns, b.states.robot_stamp_ns)
    assert np.array_equal(a.states.host_stamp_ns, b.states.host_stamp_ns)
    assert np.array_equal(a.ticks.compute_s, b.ticks.compute_s)
    assert not np.array_equal(a.states.load_nm, b.states.load_nm)


@pytest.mark.parametrize("signal", SIGNALS)
def test_a_missing_signal_is_missing_alone(tmp_path: Path, signal: Signal) -> None:
    replace(make([], 5), settings=QUICK).record(plan(ahead(0.15), missing=(signal,)), tmp_path)
    laid = record(read_run(next(tmp_path.iterdir())))
    has = {
        "battery": bool(np.isfinite(laid.slow_states.battery_voltage_v).any()),
        "temperature": bool(np.isfinite(laid.slow_states.motor_temperature_c).any()),
        "contact": laid.has("foot_contact"),
        "load": laid.has("load_nm"),
        "imu": laid.has("imu.acceleration_m_s2"),
    }
    assert {name for name, there in has.items() if not there} == {signal}


def test_sensors_are_as_good_as_a_robots() -> None:
    run = short_run(settings=Settings(ramp_s=0.3))
    still = slice(0, 60)
    assert np.std(np.diff(run.position_rad[still], n=3, axis=0)) < 2e-3
    assert np.max(np.abs(run.position_rad - run.true_position_rad)) < 0.02
    assert np.mean(run.imu_acceleration_m_s2[still, :, 2]) == pytest.approx(9.81, abs=0.6)
    assert np.all((run.battery_v > 45.0) & (run.battery_v < 59.0))
    assert run.foot_contact[still].mean() > 0.9
    ticks = run.tick_state[run.is_active]
    error = run.observation[run.is_active][:, :2] - run.true_velocity_m_s[ticks]
    assert np.sqrt(np.mean(error**2)) < 0.08


@pytest.mark.slow
@pytest.mark.parametrize("name", ["walk", "baseline", "fast"])
def test_each_policy_walks_its_range_on_a_healthy_robot(name: str) -> None:
    low, high = (np.array(v) for v in (
        policy(name).contract.velocity_command_low, policy(name).contract.velocity_command_high
    ))
    top = min(float(high[0]), 2.0)
    there = VelocitySequence(
        name="there", duration_s=3.0,
        waypoints=(Waypoint(time_s=0.0), Waypoint(time_s=1.8, v_x_m_s=top, ramp=True),
                   Waypoint(time_s=3.0, v_x_m_s=top, ramp=True)),
    )
    around = VelocitySequence(
        name="around", duration_s=3.0,
        waypoints=(Waypoint(time_s=0.0, v_x_m_s=max(float(low[0]), -0.8)), Waypoint(time_s=1.0, v_y_m_s=0.6),
                   Waypoint(time_s=2.0, yaw_rate_rad_s=1.0)),
    )
    requests = [RunRequest(s, np.random.default_rng(i)) for i, s in enumerate((there, around))]
    settings = Settings(settle_s=0.6, ramp_s=0.6)
    runs = simulate(make([], 1).robot(), policy(name), requests, settings)
    for run in runs:
        assert run.true_up.min() > 0.85
        assert run.true_height_m[200:].min() > 0.3
    assert runs[0].true_velocity_m_s[-100:, 0].mean() > 0.7 * top


def test_a_simulation_that_breaks_down_is_an_error_and_no_log() -> None:
    robot = make([], 0).robot()
    robot.drive.is_elastic = ~robot.drive.is_elastic
    robot.drive.gear_damping_nm_s_per_rad = 100.0 * robot.drive.gear_damping_nm_s_per_rad
    with pytest.raises(RealityDivergedError, match="draw another case"):
        simulate(robot, policy(), [RunRequest(ahead(0.1), np.random.default_rng(0))], QUICK)


def test_a_fall_is_logged_to_the_end() -> None:
    run = short_run([request("mixed_sides"), request("wrong_action_scale"), request("slow_current_loop")], 0.5)
    assert np.isfinite(run.position_rad).all()
