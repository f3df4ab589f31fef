"""Bounds and calibration, against numbers known otherwise."""

import numpy as np
import pytest

from withheld.scoring.statistics import Estimate, Share, between, calibration_error, estimate, median, share


@pytest.mark.parametrize(
    ("hits", "trials", "low", "high"),
    [(0, 60, 0.0, 0.0596), (5, 10, 0.1871, 0.8129), (10, 10, 0.6915, 1.0), (90, 100, 0.8238, 0.9510)],
)
def test_clopper_pearson(hits: int, trials: int, low: float, high: float) -> None:
    """Source of the numbers: Clopper and Pearson's table, and 1 - 0.025**(1/60)."""
    made = Share(hits, trials)
    assert made.low == pytest.approx(low, abs=2e-4)
    assert made.high == pytest.approx(high, abs=2e-4)


def test_no_trial_is_no_value() -> None:
    assert Share(0, 0).value is None
    assert Estimate.of((), median).value is None
    assert share("k", "t", [], 0.9).met == ""


def test_met_is_said_by_the_bound_and_not_by_the_value() -> None:
    # 95 of 100 are 95 %, but no less than 88.7 % for sure.
    assert share("k", "t", [True] * 95 + [False] * 5, 0.9).met == "not shown"
    assert share("k", "t", [True] * 196 + [False] * 4, 0.9).met == "met"
    assert share("k", "t", [True] * 70 + [False] * 30, 0.9).met == "not met"
    assert between("k", "t", [True] * 900 + [False] * 100, 0.85, 0.95).met == "met"
    assert between("k", "t", [True] * 100, 0.85, 0.95).met == "not met"
    assert estimate("k", "t", Estimate.of([0.1, 0.11] * 10, median), at_most=0.2).met == "met"
    assert estimate("k", "t", Estimate.of([0.1, 0.3] * 10, median), at_most=0.2).met == "not shown"
    assert estimate("k", "t", Estimate.of([0.1] * 19, median), at_most=0.2).met == "not shown"


def test_calibration_error_of_certainty_of_doubt_and_of_conceit() -> None:
    def error(*claims: tuple[float, float]) -> float:
        return calibration_error(np.array(claims))

    assert error((1.0, 1.0), (0.0, 0.0)) == 0.0
    assert error((0.5, 1.0), (0.5, 0.0)) == 0.0
    # Two claims of 0.95 of which one is so are 0.45 off; one of 0.05 that is not so is 0.05 off.
    assert error((0.95, 1.0), (0.95, 0.0), (0.05, 0.0)) == pytest.approx((0.9 + 0.05) / 3)
