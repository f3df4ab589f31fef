"""Which robot a case keeps, and what each of its faults does."""

from pathlib import Path

import pytest

from spot_model.errors import SpotRlError
from spot_model.policy.policy import load_policy
from tests.withheld.scoring.made_up import verdict
from tests.withheld.stand_in import StandIn
from withheld.blind.execute import MAX_ATTEMPTS, Job, _Execution
from withheld.cases.draw import draw
from withheld.cases.source import source_of
from withheld.plan import Made, RecordingPlan
from withheld.simulator.simulation import RealityDivergedError

POLICIES = Path("policies")
SEED = 11


class Broken(StandIn):
    """Breaks every simulation."""

    def make_runs(self, plan: RecordingPlan) -> Made:
        raise RealityDivergedError("not a number")


def execution(tmp_path: Path, reality: str, kind: str) -> _Execution:
    name = f"tests.withheld.{reality}"
    number = next(n for n in range(80) if draw(SEED, n, source_of(name), POLICIES).kind == kind)
    return _Execution(Job(number, SEED, tmp_path, POLICIES, "audit hook", name, is_quick=True), tmp_path, tmp_path)


def test_a_robot_that_breaks_is_drawn_anew(tmp_path: Path) -> None:
    made = execution(tmp_path, "stand_in:Brittle", "single")
    made._made(tmp_path)
    assert made.case.attempt == 1
    assert made.case == draw(SEED, made.case.number, made.source, POLICIES, True, 1)


def test_robots_that_all_break_end_the_case(tmp_path: Path) -> None:
    made = execution(tmp_path, "blind.test_execute:Broken", "single")
    with pytest.raises(SpotRlError, match=f"no robot in {MAX_ATTEMPTS} draws"):
        made._made(tmp_path)


def test_each_fault_is_measured_by_leaving_it_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("withheld.blind.execute.TWIN_REPEATS", 1)
    made = execution(tmp_path, "stand_in:StandIn", "double")
    reality, runs = made._made(tmp_path)
    walks = runs.walks(load_policy(made.policy))
    (first, one), (second, other) = made._does(walks, reality.truth)
    assert first is not None
    assert second is not None
    assert first != second
    assert one is not None
    assert other is not None
    # Both are the change to the same robot, with both faults.
    assert one.power.after == other.power.after
    assert one.power.before != other.power.before


def test_what_a_verdict_without_a_difference_delivers_is_not_measured(tmp_path: Path) -> None:
    made = execution(tmp_path, "stand_in:StandIn", "faultless")
    (tmp_path / "corrected_model.yaml").touch()
    assert made._shrunk(StandIn(SEED, ()), verdict()) == (None, {})
