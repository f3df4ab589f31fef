from __future__ import annotations

import math

import pytest

from diagnosis.decision_constants import PARAMETER_SPREAD
from diagnosis.selection.fitted import Z_90, with_formula_error

FORMULA_ERROR = Z_90 * PARAMETER_SPREAD


def test_an_interval_counts_a_formulas_error_from_where_the_effect_vanishes() -> None:
    low, high = with_formula_error(1.2, 1.2, 1.2, null=1.0)
    assert (low, high) == pytest.approx((1.2 - FORMULA_ERROR * 0.2, 1.2 + FORMULA_ERROR * 0.2))


def test_the_scatter_of_the_data_and_the_formulas_error_add_as_squares() -> None:
    low, high = with_formula_error(0.0, -0.3, 0.4, null=1.0)
    assert low == pytest.approx(-math.hypot(0.3, FORMULA_ERROR))
    assert high == pytest.approx(math.hypot(0.4, FORMULA_ERROR))


@pytest.mark.parametrize("null", [math.inf, 1e6])
def test_a_limit_that_is_never_met_is_counted_from_zero(null: float) -> None:
    low, high = with_formula_error(50.0, 50.0, 50.0, null=null)
    assert (low, high) == pytest.approx((50.0 * (1.0 - FORMULA_ERROR), 50.0 * (1.0 + FORMULA_ERROR)))


def test_an_effect_at_its_null_keeps_the_scatter_alone() -> None:
    assert with_formula_error(1.0, 0.9, 1.1, null=1.0) == pytest.approx((0.9, 1.1))
