"""Numbers of the selection worked out by hand: solving, places, intervals, sizes, what is left over."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis.channels import Channel
from diagnosis.closed_loop.gap_map import benjamini_hochberg
from diagnosis.decision_constants import ODD, OUTSIDE, PARAMETER_SPREAD
from diagnosis.library import JointGroups
from diagnosis.library.registry import LIBRARY
from diagnosis.selection.faultless import FAULTLESS, Tail, even_odds
from diagnosis.selection.normal_equations import ColumnProducts, OrdinarySums, solve_bounded, solved
from diagnosis.verdict.calibration import Z_90, is_odd, with_formula_error
from diagnosis.verdict.left_over import left_over, nats_left, probability
from spot_model.robot.facts import JOINT_NAMES

ROBOT = JointGroups(JOINT_NAMES, np.repeat(np.arange(4), 3))


def test_inside_its_bounds_the_solution_is_least_squares() -> None:
    rng = np.random.default_rng(0)
    x = rng.standard_normal((3, 50, 4))
    y = rng.standard_normal((3, 50))
    gram, right = np.einsum("bni,bnj->bij", x, x), np.einsum("bni,bn->bi", x, y)
    found = solve_bounded(gram, right, np.full(4, -10.0), np.full(4, 10.0))
    for k in range(3):
        np.testing.assert_allclose(found[k], np.linalg.lstsq(x[k], y[k], rcond=None)[0], atol=1e-7)


def test_at_a_bound_the_others_are_fitted_anew() -> None:
    # Minimise (a + b - 3)² + (b - 1)² with a <= 1: a = 1, then b = ((3 - 1) + 1) / 2 = 1.5.
    x = np.array([[1.0, 1.0], [0.0, 1.0]])
    y = np.array([3.0, 1.0])
    found = solve_bounded(x.T @ x, x.T @ y, np.array([-5.0, -5.0]), np.array([1.0, 5.0]))
    np.testing.assert_allclose(found, [1.0, 1.5], atol=1e-6)


def test_a_column_without_freedom_keeps_its_value() -> None:
    x = np.array([[1.0, 1.0], [0.0, 1.0], [1.0, 0.0]])
    found = solve_bounded(x.T @ x, x.T @ np.array([2.0, 1.0, 9.0]), np.array([1.0, -9.0]), np.array([1.0, 9.0]))
    assert found[0] == pytest.approx(1.0)
    assert found[1] == pytest.approx(1.0)


def test_places_hold_joints_types_legs_and_all_once_each() -> None:
    places = ROBOT.places(LIBRARY["coulomb_friction"])
    assert len(np.unique(places, axis=0)) == len(places)
    sizes = places.sum(axis=1)
    assert (sizes == 1).sum() == 12
    assert (sizes == 12).sum() == 1
    knees = np.array([name.endswith("kn") for name in JOINT_NAMES])
    hind_left = np.array([name.startswith("hl") for name in JOINT_NAMES])
    for wanted in (knees, hind_left):
        assert any(np.array_equal(p > 0.5, wanted) for p in places)


def test_an_effect_of_the_whole_robot_has_one_place() -> None:
    assert ROBOT.places(LIBRARY["power_limit"]).shape == (1, 1)
    assert ROBOT.joints_of(LIBRARY["power_limit"], np.ones(1)).all()


def test_what_is_set_joint_by_joint_is_looked_for_at_one() -> None:
    np.testing.assert_array_equal(ROBOT.places(LIBRARY["encoder_offset"]), np.eye(12))


SIZE = 6
NUMBERS = (np.array([4, 0, 2]), np.array([], dtype=np.intp), np.array([5, 1, 2, 3]))
WEIGHTS = np.array([0.5, 3.0, 1.5])
N_FOLDS, N_TRIED = 2, 2


def _columns() -> list[np.ndarray]:
    """By block [ordinary errors, two columns that are tried, y], shape (folds, samples, q + 3)."""
    rng = np.random.default_rng(0)
    return [rng.normal(size=(N_FOLDS, 30, len(n) + N_TRIED + 1)) for n in NUMBERS]


def _parts(columns: list[np.ndarray]) -> tuple[OrdinarySums, ColumnProducts, list[ColumnProducts]]:
    """What is the same whatever is tried, what is tried, and the same by fold."""
    base, ours, both = [], [], []
    for x in columns:
        gram = np.swapaxes(x, 1, 2) @ x
        q = gram.shape[1] - N_TRIED - 1
        known, own = [*range(q), q + N_TRIED], list(range(q, q + N_TRIED))
        base.append(gram[:, known][:, :, known])
        ours.append(gram[:, own][:, :, known])
        both.append(gram[:, own][:, :, own])
    folds = [ColumnProducts.of([o[f] for o in ours], [b[f] for b in both]) for f in range(N_FOLDS)]
    tried = ColumnProducts.of([o.sum(axis=0) for o in ours], [b.sum(axis=0) for b in both])
    return OrdinarySums(NUMBERS, SIZE, base), tried, folds


def test_one_weighted_problem_is_least_squares_with_priors() -> None:
    columns, held = _columns(), np.array([4.0, 0.25])
    sums, tried, by_fold = _parts(columns)
    for part, own, folds in (
        (sums.total, tried, [0, 1]),
        (sums.folds[0], by_fold[0], [0]),
        (sums.total - sums.folds[0], tried - by_fold[0], [1]),
    ):
        # One problem over all columns of all blocks, with a prior on each ordinary error and each coefficient.
        rows, right = [np.diag(np.sqrt([*np.ones(SIZE), *held]))], [np.zeros(SIZE + N_TRIED)]
        for at, x, weight in zip(NUMBERS, columns, WEIGHTS, strict=True):
            for fold in folds:
                wide = np.zeros((x.shape[1], SIZE + N_TRIED))
                wide[:, at] = x[fold][:, : len(at)]
                wide[:, SIZE:] = x[fold][:, len(at) : -1]
                rows.append(np.sqrt(weight) * wide)
                right.append(np.sqrt(weight) * x[fold][:, -1])
        every = np.concatenate(rows)
        wanted = np.linalg.lstsq(every, np.concatenate(right), rcond=None)[0]
        far = np.full(N_TRIED, 100.0)
        pulls, beta, information = solved(sums, part, own, WEIGHTS, -far, far, held)
        assert np.concatenate([pulls, beta]) == pytest.approx(wanted, rel=1e-7)
        # The information that ordinary errors leave is the inverse of the coefficients' covariance, less the prior.
        covariance = np.linalg.inv(every.T @ every)[SIZE:, SIZE:]
        assert information + np.diag(held) == pytest.approx(np.linalg.inv(covariance), rel=1e-7)
        left = sums.left(part, own, pulls, beta)
        for number, (at, x) in enumerate(zip(NUMBERS, columns, strict=True)):
            said = np.concatenate([x[f][:, : len(at)] @ pulls[at] + x[f][:, len(at) : -1] @ beta for f in folds])
            y = np.concatenate([x[f][:, -1] for f in folds])
            assert left[number] == pytest.approx(np.sum((y - said) ** 2))


def test_nothing_tried_leaves_the_ordinary_errors() -> None:
    sums, _, _ = _parts(_columns())
    none = ColumnProducts.of([np.zeros((0, len(n) + 1)) for n in NUMBERS], [np.zeros((0, 0))] * len(NUMBERS))
    pulls, beta, _ = solved(sums, sums.total, none, WEIGHTS, np.zeros(0), np.zeros(0), np.zeros(0))
    assert beta.shape == (0,)
    left = sums.left(sums.total, none, pulls, beta)
    # Fitting shortens what is left of the whole, prior and all.
    assert WEIGHTS @ left + pulls @ pulls < WEIGHTS @ sums.total.yy


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


def test_a_number_is_odd_by_its_size_in_spreads_and_how_well_it_is_told() -> None:
    """Told exactly, odds are even where ½ s² (1 − 1/100) = log 99 + log 10: at 3.73 published spreads."""
    even = math.sqrt(2.0 * (math.log((1.0 - ODD) / ODD) + math.log(10.0)) / 0.99)
    assert is_odd(even, 0.0) == pytest.approx(0.5)
    assert is_odd(0.0, 0.0) < ODD < is_odd(even, 1.0) < 0.5 < is_odd(-1.1 * even, 0.0)
    # What the logs do not tell stays as probable as before.
    assert is_odd(0.0, 1e4) == pytest.approx(ODD, rel=1e-3)


LOAD, WRENCH = Channel.SET_POINT_TO_LOAD, Channel.BASE_WRENCH


def test_the_signal_that_is_farthest_over_noise_and_formulas_counts() -> None:
    board: Any = SimpleNamespace(
        is_coarse=False,
        by_channel={LOAD: [0, 1], WRENCH: [2]},
        tolerance_square=np.array([3.0, 3.0, 0.0]),
        relative_square=np.array([0.25, 0.25, 0.0]),
    )
    scored: Any = SimpleNamespace(left=np.array([8.0, 40.0, 0.0]), explained=np.array([0.0, 64.0, 0.0]))
    # 8 of 1 + 3; 40 of 1 + 3 + 64/4; what is explained to the bit counts as a tenth.
    assert left_over(board, scored) == pytest.approx({LOAD: np.log(2.0), WRENCH: np.log(0.1)})


def test_nats_that_are_left_count_from_what_is_usual() -> None:
    usual = FAULTLESS.left[LOAD].median
    board: Any = SimpleNamespace(
        is_coarse=False,
        by_channel={LOAD: [0, 1]},
        dof=np.array([40.0, 20.0]),
        tolerance_square=np.zeros(2),
        relative_square=np.zeros(2),
    )
    scored: Any = SimpleNamespace(left=np.exp([max(usual, 0.0) + 0.5, usual - 0.1]), explained=np.zeros(2))
    assert nats_left(board, scored) == pytest.approx({LOAD: 0.5 * 40.0 * 0.5})


TAIL = Tail(median=-0.5, tenth=0.2, beyond=0.3)


def test_a_tail_falls_from_the_median_on_and_tells_where_it_is() -> None:
    at = np.linspace(-3.0, 9.0, 200)
    shares = [TAIL.tail(value) for value in at]
    assert np.all(np.diff(shares) <= 0.0)
    assert [TAIL.tail(v) for v in (-9.0, -0.5, 0.2)] == pytest.approx([1.0, 0.5, 0.1])
    assert [TAIL.tail(TAIL.at(p)) for p in (0.1, 0.03, 1e-6)] == pytest.approx([0.1, 0.03, 1e-6])


def test_a_p_value_carries_the_less_odds_the_larger_it_is() -> None:
    odds = [even_odds(p) for p in (0.0, 1e-300, 1e-9, 0.05, 0.3, 1.0 / math.e, 0.9)]
    assert odds == sorted(odds, reverse=True)
    # 1 / (−e · 0.05 · log 0.05) is 2.46; from 1/e on a p value says nothing.
    assert odds[3] == pytest.approx(2.456, abs=1e-3)
    assert odds[-2:] == [1.0, 1.0]


def test_usual_leftovers_say_nothing_and_one_far_one_is_enough() -> None:
    usual = {name: tail.median for name, tail in FAULTLESS.left.items()}
    assert probability(usual) == pytest.approx(OUTSIDE)
    for name, tail in FAULTLESS.left.items():
        assert probability(usual | {name: tail.at(1e-5)}) > 0.9
    # More signals, more chances; without signals nothing is odd.
    odd = {str(LOAD): FAULTLESS.left[LOAD].at(0.01)}
    assert probability(odd) > probability(usual | odd)
    assert probability({}) == pytest.approx(OUTSIDE)


def test_adjusted_p_values_by_hand() -> None:
    # Sorted 0.01, 0.02, 0.03, 0.5 times 4/1, 4/2, 4/3, 4/4 = 0.04, 0.04, 0.04, 0.5.
    found = benjamini_hochberg(np.array([0.5, 0.01, 0.03, 0.02]))
    np.testing.assert_allclose(found, [0.5, 0.04, 0.04, 0.04])


def test_adjusted_p_values_are_monotone_and_at_most_one() -> None:
    p = np.random.default_rng(0).uniform(size=200)
    found = benjamini_hochberg(p)
    assert found.max() <= 1.0
    assert np.all(found >= p - 1e-12)
    assert np.all(np.diff(found[np.argsort(p)]) >= 0.0)


def test_few_discoveries_among_noise() -> None:
    p = np.random.default_rng(1).uniform(size=1000)
    assert (benjamini_hochberg(p) < 0.05).sum() == pytest.approx(0, abs=2)
