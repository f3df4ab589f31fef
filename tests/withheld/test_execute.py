"""Which robot a case keeps: one that can be simulated, and where a case asks for it one that moves the gap."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from spot_model.errors import SpotRlError
from withheld.cases.draw import draw
from withheld.blind.execute import MAX_ATTEMPTS, MAX_DRAWS, Execution, Job
from withheld.plan import RecordingPlan, Walk
from withheld.simulator.simulation import RealityDivergedError
from withheld.cases.source import source_of

from .stand_in import StandIn

POLICIES = Path("policies")
SEED = 11


class Silent(StandIn):
    """Writes nothing."""

    def record(self, plan: RecordingPlan, folder: Path) -> None:
        pass


class Broken(StandIn):
    """Breaks every simulation."""

    def record(self, plan: RecordingPlan, folder: Path) -> None:
        raise RealityDivergedError("not a number")


class Measured(Execution):
    """The distances of one robot after the other are given."""

    distances: Sequence[float | None] = ()

    def _moved(self, walks: Sequence[Walk]) -> float | None:
        return self.distances[self.case.attempt]


def execution(tmp_path: Path, reality: str, *, is_asked: bool) -> Measured:
    source = source_of(f"tests.withheld.test_execute:{reality}")
    cases = (draw(SEED, n, source, POLICIES) for n in range(50))
    number = next(c.number for c in cases if c.is_asked == is_asked and c.kind == "known")
    job = Job(number, SEED, tmp_path, POLICIES, "audit hook", f"tests.withheld.test_execute:{reality}")
    return Measured(job, tmp_path, tmp_path)


def test_a_case_that_asks_keeps_the_first_robot_whose_effect_moves_the_gap(tmp_path: Path) -> None:
    made = execution(tmp_path, "Silent", is_asked=True)
    made.distances = (0.1, None, 2.5)
    made.robot(tmp_path / "logs")
    assert (made.case.attempt, made.moved) == (2, 2.5)
    assert made.case == draw(SEED, made.case.number, made.source, POLICIES, attempt=2)


def test_the_last_is_kept_where_none_does(tmp_path: Path) -> None:
    made = execution(tmp_path, "Silent", is_asked=True)
    made.distances = [0.1 * n for n in range(MAX_DRAWS)]
    made.robot(tmp_path / "logs")
    assert (made.case.attempt, made.moved) == (MAX_DRAWS - 1, made.distances[-1])


def test_other_cases_keep_the_first(tmp_path: Path) -> None:
    made = execution(tmp_path, "Silent", is_asked=False)
    made.robot(tmp_path / "logs")
    assert (made.case.attempt, made.moved) == (0, None)


def test_robots_that_all_break_end_the_case(tmp_path: Path) -> None:
    made = execution(tmp_path, "Broken", is_asked=False)
    with pytest.raises(SpotRlError, match=f"no robot in {MAX_ATTEMPTS} draws"):
        made.robot(tmp_path / "logs")
