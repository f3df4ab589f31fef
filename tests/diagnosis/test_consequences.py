"""Consequences in closed loop: the true model closes its gaps, and falls are figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from diagnosis.closed_loop.consequences import GAPS, Outcomes, worse_gaps
from diagnosis.closed_loop.run_numbers import WalkTime, restricted_mean_s, run_numbers, time_to_fall
from diagnosis.closed_loop.simulation import rollouts_under
from diagnosis.closed_loop.trials import NOMINAL, Bench, Trials, compared_by_sequence
from diagnosis.decision_constants import PRACTICAL
from diagnosis.document import Consequences, GapChange, QuantityChange
from diagnosis.read.prepare import prepared
from diagnosis.read.robot_file import SPOT
from diagnosis.read.segments import cut
from diagnosis.read.signal_checks import plausible
from spot_log.read.run import Run
from spot_model.effects.drivetrain import TorqueGain
from spot_model.effects.torque_limits import TorqueLimit
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import load_policy
from trainer.signals.policy_ticks import policy_ticks, scripts_of
from trainer.signals.recording import record
from trainer.simulate.recorded_runs import UsualNoise, simulate_scripts

from .planted import POLICY, scripts

WEAK = RobotModel((TorqueGain(joints=("kn",), gain=0.8),))
FALLING = RobotModel((TorqueLimit(joints=("kn",), limit_nm=22.0),))
PLAIN = RobotModel()


def _runs(model: RobotModel, seed: int, n: int = 4, n_ticks: int = 160) -> list[Run]:
    told = [replace(script, repeat=k) for script in scripts(n_ticks) for k in range(n)]
    rng = np.random.default_rng(seed)
    starts = [replace(s.start, velocity_rad_s=0.3 * rng.standard_normal(12)) for s in told]
    told = [replace(script, start=start) for script, start in zip(told, starts, strict=True)]
    return simulate_scripts(model, load_policy(POLICY), told, rng, UsualNoise())


def _standing(runs: Sequence[Run]) -> list[Run]:
    """Those that stand, and fall after one to three seconds; the others fall sooner."""
    return [run for run in runs if run.header.command_sequence == "b"]


def _bench(real: Sequence[Run]) -> Bench:
    policy = load_policy(POLICY)
    return Bench(tuple(real), tuple(scripts_of(real)), policy, rollouts_under(policy))


def _trials(bench: Bench, **models: Sequence[Run]) -> Trials:
    runs = {name: list(made) for name, made in models.items()}
    return Trials(bench, runs, tuple(compared_by_sequence(bench, runs)[0]), is_crossed=True, notes=())


@pytest.fixture(scope="module")
def plain() -> list[Run]:
    return _runs(PLAIN, 2)


@pytest.fixture(scope="module")
def falling() -> list[Run]:
    return _standing(_runs(FALLING, 1))


def test_the_true_model_closes_each_gap_and_changes_what_the_robot_does(plain: list[Run]) -> None:
    bench = _bench(_runs(WEAK, 1))
    trials = _trials(bench, **{NOMINAL: plain, "true": _runs(WEAK, 3)})
    found = Outcomes.of(trials).consequences(NOMINAL, "true", np.random.default_rng(0))
    assert [g.gap for g in found.gaps] == ["torque", "joint motion", "body motion"]
    for gap, left in zip(found.gaps, Outcomes.of(trials).remainder("true"), strict=True):
        assert gap.share is not None
        assert gap.low is not None
        assert gap.high is not None
        assert gap.low <= 1.0 <= gap.high
        assert gap.share == pytest.approx(1.0, abs=0.25)
        assert (left.left, left.floor) == (gap.after, gap.floor)
        assert left.ratio == pytest.approx(1.0, abs=0.3)
        assert left.repeats == gap.repeats == gap.floor
    changes = {c.quantity: c for c in found.changes}
    assert "time_to_fall" not in changes
    assert (changes["fall_share"].before, changes["fall_share"].after, changes["fall_share"].robot) == (0.0, 0.0, 0.0)
    for name in ("mean_speed", "power", "knee_torque"):
        c = changes[name]
        assert c.after == pytest.approx(c.robot, rel=0.05)
        assert c.low is not None
        assert c.high is not None
        assert c.low <= c.after - c.before <= c.high
    assert worse_gaps(found) == []
    back = worse_gaps(Outcomes.of(trials).consequences("true", NOMINAL, np.random.default_rng(0)))
    assert len(back) == 3
    assert back[0].startswith("the corrected model is farther from the robot than the nominal one in torque: ")


def test_a_robot_that_repeats_itself_exactly_has_a_floor_all_the_same(plain: list[Run]) -> None:
    twin = [replace(run, header=replace(run.header, repeat=9)) for run in plain if run.header.repeat == 0]
    real = [run for run in plain if run.header.repeat == 0] + twin
    trials = Trials(_bench(real), {NOMINAL: _runs(WEAK, 3), "true": plain}, (), is_crossed=True, notes=())
    gaps = Outcomes.of(trials).consequences(NOMINAL, "true", np.random.default_rng(0)).gaps
    for gap, left, of in zip(gaps, Outcomes.of(trials).remainder("true"), GAPS, strict=True):
        spread = np.mean([np.mean(np.std(of.pick(run), axis=0)) for run in real])
        assert gap.repeats == 0.0
        assert gap.floor == pytest.approx(PRACTICAL * spread, rel=0.1)
        assert (left.floor, left.repeats) == (gap.floor, 0.0)
        assert left.ratio == pytest.approx(left.left / gap.floor)


def test_a_robot_that_ran_once_has_the_models_scatter_for_a_floor(plain: list[Run]) -> None:
    bench = _bench([run for run in _runs(WEAK, 1) if run.header.repeat == 0])
    trials = _trials(bench, **{NOMINAL: plain, "true": _runs(WEAK, 3)})
    for gap in Outcomes.of(trials).consequences(NOMINAL, "true", np.random.default_rng(0)).gaps:
        assert gap.floor > 0.0
        assert gap.repeats is None
        assert gap.share == pytest.approx(1.0, abs=0.4)


def test_falls_are_in_the_figures(plain: list[Run], falling: list[Run]) -> None:
    bench = _bench(falling)
    trials = _trials(bench, **{NOMINAL: _standing(plain), "true": _standing(_runs(FALLING, 3))})
    _, notes = compared_by_sequence(bench, trials.runs)
    assert [n.partition(", the first")[0] for n in notes] == ["sequence b: 4 of 4 runs of the robot fell"]
    found = Outcomes.of(trials).consequences(NOMINAL, "true", np.random.default_rng(0))
    changes = {c.quantity: c for c in found.changes}
    share, time_s = changes["fall_share"], changes["time_to_fall"]
    assert (share.before, share.after, share.robot) == (0.0, 1.0, 1.0)
    assert time_s.before is not None
    assert time_s.after is not None
    assert time_s.after == pytest.approx(time_s.robot, rel=0.25)
    # What nothing makes fall lasts as long as the longest run of the robot.
    assert time_s.before == pytest.approx(max(time_to_fall(run).time_s for run in falling), abs=0.05)
    assert len(found.gaps) == 3
    assert found.gaps[0].share == pytest.approx(1.0, abs=0.3)
    assert worse_gaps(found) == []


def test_a_model_that_falls_at_once_is_compared_too(plain: list[Run]) -> None:
    bench = _bench(plain)
    trials = _trials(bench, **{NOMINAL: _runs(RobotModel((TorqueLimit(limit_nm=1.0),)), 3)})
    assert {c.sequence for c in trials.compared} == {"a", "b"}
    assert trials.distances()[NOMINAL] > 5.0


def test_a_run_is_used_up_to_its_fall(falling: list[Run]) -> None:
    run = falling[0]
    lasted = time_to_fall(run)
    assert lasted is not None
    assert lasted.has_fallen
    ticks_s = (run.ticks.robot_stamp_ns[policy_ticks(run)] - run.ticks.robot_stamp_ns[0]) * 1e-9
    assert 0.0 <= lasted.time_s - ticks_s[-1] <= 0.02
    assert np.isfinite(run_numbers(run)["knee_torque"])
    segmentation = cut(record(run))
    (fallen,) = (s for s in segmentation.segments if s.kind == "fallen")
    assert fallen.first * 0.003 == pytest.approx(lasted.time_s - 0.3, abs=0.02)


@pytest.mark.parametrize(("before_s", "n_notes"), [(0.06, 0), (0.6, 1)])
def test_a_joint_beyond_its_stop_where_the_robot_falls_hides_no_fall(
    plain: list[Run], falling: list[Run], before_s: float, n_notes: int
) -> None:
    run = falling[0]
    lasted = time_to_fall(run)
    assert lasted is not None
    position = run.states.position_rad.copy()
    position[round((lasted.time_s - before_s) / 0.003) :, 2] = -4.0
    broken = replace(run, states=replace(run.states, position_rad=position))
    kept, notes = plausible([*plain, broken], SPOT)
    assert len(notes) == n_notes
    assert time_to_fall(kept[-1]) == pytest.approx(lasted, abs=0.1)
    assert len(prepared(kept, SPOT)[0]) == len(plain) + 1


def test_a_fallen_run_is_simulated_for_as_long_as_the_longest(plain: list[Run], falling: list[Run]) -> None:
    made = scripts_of([falling[0], *_standing(plain)])
    assert len({len(s.velocity_command) for s in made}) == 1


def test_time_to_a_fall_by_hand() -> None:
    # Falls at 2 and 6 s, one cut short at 4 s, one whole: 2·1 + 4·¾ + 4·(¾·½).
    lasted = [WalkTime(2.0, True), WalkTime(4.0, False), WalkTime(6.0, True), WalkTime(10.0, False)]
    each = np.array([[1, 1, 1, 1], [0, 4, 0, 0], [2, 0, 1, 1]])
    np.testing.assert_allclose(restricted_mean_s(lasted, 10.0, each), [2.0 + 3.0 + 1.5, 10.0, 2.0 + 2.0 + 1.0])


def test_what_became_worse_is_said_by_hand() -> None:
    gap = GapChange(gap="torque", unit="N·m", before=1.6, after=2.1, floor=0.4, share=-0.4)
    falls = QuantityChange(quantity="fall_share", title="", unit="", before=0.0, after=0.5, robot=0.0)
    assert worse_gaps(Consequences(loop="closed", gaps=(gap,), changes=(falls,))) == [
        "the corrected model is farther from the robot than the nominal one in torque: 2.1 instead of 1.6 N·m",
        "the corrected model falls in 50% of its runs, the nominal one in 0%, the robot in 0%",
    ]
    nothing = gap.model_copy(update={"floor": 2.1})
    assert worse_gaps(Consequences(loop="closed", gaps=(nothing,))) == []
    same = gap.model_copy(update={"after": 1.61})
    assert worse_gaps(Consequences(loop="closed", gaps=(same,))) == []
