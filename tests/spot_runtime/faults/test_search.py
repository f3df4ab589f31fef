"""The search of faults: what it draws can be done, can be kept, and is judged by what really happened."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from fake_robot.faults.registry import make_fault
from proof.faults.search import INJECTIONS, Case, Fault, draw, judge_case, vary
from proof.rig import rig

WALK = Path(__file__).parents[3] / "policies" / "walk.onnx"


def cases(seed: int) -> Iterator[Case]:
    rng = np.random.default_rng(seed)
    while True:
        case = draw(rng)
        yield from (case, vary(case, rng))


def test_the_fake_robot_knows_every_fault_that_is_drawn() -> None:
    drawn = [fault for case in islice(cases(1), 2000) for fault in case.faults if fault.what.startswith("inject ")]
    for fault in drawn:
        make_fault(fault.what.removeprefix("inject "), fault.values)
    assert {fault.what.removeprefix("inject ") for fault in drawn} == set(INJECTIONS)


def test_a_case_can_be_kept_as_a_line() -> None:
    assert all(Case.from_json(case.to_json()) == case for case in islice(cases(2), 100))


def test_a_robot_that_is_stopped_before_it_stands_has_not_fallen(tmp_path: Path) -> None:
    case = Case("up", 2.5, (Fault("signal SIGTERM", 0.27, 0.0, {}),))
    with rig(tmp_path, WALK) as robot:
        verdict = judge_case(robot, case)
    assert (verdict.outcome, verdict.problems) == ("operator_stop", [])


def test_a_robot_that_is_half_way_down_when_it_is_stopped_has_not_fallen(tmp_path: Path) -> None:
    case = Case("down", 1.6, (Fault("signal SIGINT", 1.475, 0.0, {}),))
    with rig(tmp_path, WALK) as robot:
        verdict = judge_case(robot, case)
    assert (verdict.outcome, verdict.problems) == ("operator_stop", [])
