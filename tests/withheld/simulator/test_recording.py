"""Transport, ticks and logs of simulated runs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from spot_log import Run, read_run
from spot_log.commands import app
from spot_model.io.velocity_sequence import VelocitySequence
from tests.withheld.simulator.quick import POLICIES, QUICK, ahead, policy, widest
from withheld.plan import IMPORT_LACKS, RecordingPlan, Signal
from withheld.realities.reality import make
from withheld.realities.source import CATALOGUES
from withheld.simulator.link import NEVER_NS, Deliveries, deliveries, mean_delay_s, tick_states
from withheld.simulator.parameters import LinkParameters
from withheld.simulator.simulation import RunRequest, simulate

CATALOGUE = CATALOGUES["calibrating"]
LINK = LinkParameters()
N = 50_000


def plan(*sequences: VelocitySequence, repeats: int = 1, missing: frozenset[Signal] = frozenset()) -> RecordingPlan:
    return RecordingPlan(POLICIES / "walk.onnx", sequences, repeats, 9, missing)


def recorded(folder: Path, what: RecordingPlan, kinds: tuple[str, ...] = ()) -> Run:
    requests = [widest(CATALOGUE[k]) for k in kinds]
    replace(make(requests, 5, CATALOGUE, error_scale=1.0), settings=QUICK).record(what, folder)
    return read_run(next(folder.iterdir()))


def test_state_to_command_takes_as_long_as_recordings_say() -> None:
    rng = np.random.default_rng(0)
    way = deliveries(N, LINK, tick_states(N, LINK, rng), [], rng)
    took_ms = (way.arrival_ns - 3_000_000 * np.arange(N)) * 1e-6
    assert np.quantile(took_ms, [0.5, 0.95]) == pytest.approx([4.0, 6.0], abs=0.15)
    assert took_ms.mean() * 1e-3 == pytest.approx(mean_delay_s(LINK), rel=0.01)
    assert np.all(np.diff(way.arrival_ns) >= 0)


def test_a_timer_ticks_at_fifty_hertz_and_a_divider_at_every_sixth_state() -> None:
    on_time = replace(LINK, slipped_share=0.0)
    assert tick_states(2001, on_time, np.random.default_rng(0))[:7].tolist() == [0, 7, 14, 20, 27, 34, 40]
    divider = replace(LINK, schedule="divider", slipped_share=0.016)
    steps = np.diff(tick_states(N, divider, np.random.default_rng(0)))
    # A slipped tick is one state late: 21 ms, then 15 ms.
    assert set(steps.tolist()) <= {5, 6, 7}
    assert np.mean(steps == 7) == pytest.approx(0.016, abs=0.004)


def test_a_divider_sends_with_its_ticks_alone() -> None:
    divider, rng = replace(LINK, schedule="divider"), np.random.default_rng(0)
    ticks = tick_states(600, divider, rng)
    way = deliveries(600, divider, ticks, [], rng)
    assert np.flatnonzero(way.is_sent).tolist() == ticks.tolist()
    assert np.all(way.arrival_ns[~way.is_sent] == NEVER_NS)


def test_the_newest_arrival_is_in_effect_and_lost_ones_never_are() -> None:
    four = np.zeros(4, dtype=np.int64)
    way = Deliveries(four, four, four == 0, np.array([5, NEVER_NS, 9, 9]))
    assert way.newest(np.array([0, 4, 5, 8, 9, 100])).tolist() == [-1, -1, 0, 0, 3, 3]


def test_logs_are_read_by_all_who_read_logs(tmp_path: Path) -> None:
    run = recorded(tmp_path, plan(ahead(0.5)))
    (file,) = tmp_path.iterdir()
    assert len(file.stem) == 16
    assert run.damage == ()
    assert run.footer is not None
    assert run.footer.outcome == "completed"
    result = CliRunner().invoke(app, ["info", str(file)])
    assert result.exit_code == 0, result.output


def test_first_states_may_still_echo_the_run_before(tmp_path: Path) -> None:
    stale = []
    for seed in range(8):
        run = recorded(tmp_path / str(seed), replace(plan(ahead(0.1)), seed=seed))
        first = int(run.states.last_command_key[0])
        is_before = bool(run.states.last_command_robot_stamp_ns[0] < run.states.robot_stamp_ns[0] - 1_000_000_000)
        assert (first == 0) or (first > int(run.commands.key.max()) and is_before)
        stale.append(first > 0)
    assert 0 < sum(stale) < 8


def test_an_import_is_uneven_and_has_no_ticks_no_policy_and_no_receipts(tmp_path: Path) -> None:
    run = recorded(tmp_path, replace(plan(ahead(2.0)), detail="import", missing=IMPORT_LACKS))
    steps_ms = np.diff(run.states.robot_stamp_ns) * 1e-6
    assert 50.0 < 1000.0 / steps_ms.mean() < 60.0
    assert len(set(steps_ms.tolist())) > 1
    assert len(run.ticks) == 0
    assert not run.header.policy_sha256
    assert np.all(run.states.last_command_key == 0)
    assert len(run.slow_states) == 0


def test_the_same_plan_gives_the_same_signals_and_another_seed_does_not(tmp_path: Path) -> None:
    runs = [recorded(tmp_path / f, replace(plan(ahead(0.15)), seed=s)) for f, s in (("a", 9), ("b", 9), ("c", 10))]
    assert np.array_equal(runs[0].states.load_nm, runs[1].states.load_nm)
    assert runs[0].header.run_id == runs[1].header.run_id
    assert not np.array_equal(runs[0].states.load_nm, runs[2].states.load_nm)


def test_nothing_but_signals_tells_a_fault(tmp_path: Path) -> None:
    a = recorded(tmp_path / "a", plan(ahead(0.15)))
    b = recorded(tmp_path / "b", plan(ahead(0.15)), ("lugre_friction",))
    assert [p.name for p in (tmp_path / "a").iterdir()] == [p.name for p in (tmp_path / "b").iterdir()]
    assert a.header == b.header
    assert a.events == b.events
    assert np.array_equal(a.states.robot_stamp_ns, b.states.robot_stamp_ns)
    assert np.array_equal(a.ticks.compute_s, b.ticks.compute_s)
    assert not np.array_equal(a.states.load_nm, b.states.load_nm)


def test_a_run_is_the_same_whatever_runs_beside_it() -> None:
    robot = make([widest(CATALOGUE["gear_loss"])], 2, CATALOGUE).robot()
    alone, *_ = simulate(robot, policy(), [RunRequest(ahead(0.2), np.random.default_rng(3))], QUICK)
    requests = [RunRequest(ahead(0.2, v), np.random.default_rng(seed)) for v, seed in ((0.5, 1), (1.0, 3))]
    beside = simulate(robot, policy(), requests, QUICK)[1]
    for name in ("load_nm", "position_rad", "linear_vel_of_body_in_odom_m_s", "imu_acceleration_m_s2", "observation"):
        # The policy's products round differently for one row and for two on some processors.
        np.testing.assert_allclose(getattr(alone, name), getattr(beside, name), rtol=1e-3, atol=1e-3)


def test_runs_of_different_length_are_refused_side_by_side() -> None:
    requests = [RunRequest(ahead(t), np.random.default_rng(0)) for t in (0.2, 0.3)]
    with pytest.raises(ValueError, match=r"these last \[0.2, 0.3\] s"):
        simulate(make([], 0, {}).robot(), policy(), requests, QUICK)
