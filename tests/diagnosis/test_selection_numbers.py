"""Numbers of the selection worked out by hand: solving, places, intervals, sizes, what is left over."""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis.channels import Channel
from diagnosis.closed_loop.gap_map import benjamini_hochberg
from diagnosis.decision_constants import ODD_EXCESS, ORDINARY_EXCESS, PARAMETER_SPREAD
from diagnosis.library import Robot
from diagnosis.library.registry import LIBRARY
from diagnosis.selection.normal_equations import OrdinarySums, products_by_fold, solve_bounded, solved
from diagnosis.selection.robot_models import SMALLEST, size_of_errors
from diagnosis.verdict.calibration import Z_90, with_formula_error
from diagnosis.verdict.probability import excess, is_odd
from spot_model.robot.facts import JOINT_NAMES

ROBOT = Robot(JOINT_NAMES, np.repeat(np.arange(4), 3))


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


def _parts(columns: list[np.ndarray]) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
    base, ours, both = [], [], []
    for x in columns:
        gram = np.swapaxes(x, 1, 2) @ x
        q = gram.shape[1] - N_TRIED - 1
        known, tried = [*range(q), q + N_TRIED], list(range(q, q + N_TRIED))
        base.append(gram[:, known][:, :, known])
        ours.append(gram[:, tried][:, :, known])
        both.append(gram[:, tried][:, :, tried])
    return base, ours, both


def test_one_weighted_problem_is_solved() -> None:
    columns = _columns()
    base, ours, both = _parts(columns)
    sums = OrdinarySums(NUMBERS, SIZE, base)
    tried, by_fold = products_by_fold(ours, both)
    for part, own, folds in (
        (sums.total, tried, [0, 1]),
        (sums.folds[0], by_fold[0], [0]),
        (sums.others[0], tried - by_fold[0], [1]),
    ):
        # One least-squares problem over all columns of all blocks, with a prior on each ordinary error.
        rows, right = [np.eye(SIZE, SIZE + N_TRIED)], [np.zeros(SIZE)]
        for at, x, weight in zip(NUMBERS, columns, WEIGHTS, strict=True):
            for fold in folds:
                wide = np.zeros((x.shape[1], SIZE + N_TRIED))
                wide[:, at] = x[fold][:, : len(at)]
                wide[:, SIZE:] = x[fold][:, len(at) : -1]
                rows.append(np.sqrt(weight) * wide)
                right.append(np.sqrt(weight) * x[fold][:, -1])
        wanted = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0]
        far = np.full(N_TRIED, 100.0)
        pulls, beta = solved(sums, part, own, WEIGHTS, -far, far)
        assert np.concatenate([pulls, beta]) == pytest.approx(wanted, rel=1e-7)
        left, explained = sums.squares(part, own, pulls, beta)
        for number, (at, x) in enumerate(zip(NUMBERS, columns, strict=True)):
            said = np.concatenate([x[f][:, : len(at)] @ pulls[at] + x[f][:, len(at) : -1] @ beta for f in folds])
            y = np.concatenate([x[f][:, -1] for f in folds])
            assert explained[number] == pytest.approx(np.sum(said**2))
            assert left[number] == pytest.approx(np.sum((y - said) ** 2))


def test_nothing_tried_leaves_the_ordinary_errors() -> None:
    base, _, _ = _parts(_columns())
    sums = OrdinarySums(NUMBERS, SIZE, base)
    none = [np.zeros((N_FOLDS, 0, b.shape[1])) for b in base]
    tried, _ = products_by_fold(none, [np.zeros((N_FOLDS, 0, 0))] * len(base))
    pulls, beta = solved(sums, sums.total, tried, WEIGHTS, np.zeros(0), np.zeros(0))
    assert beta.shape == (0,)
    left, _ = sums.squares(sums.total, tried, pulls, beta)
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


def _errors_board(names: Sequence[str], scale: Sequence[float], published: Sequence[float]) -> Any:
    kinds = tuple(SimpleNamespace(effect=LIBRARY[name]) for name in dict.fromkeys(names))
    ordinary = SimpleNamespace(
        names=tuple(names), kinds=kinds, scale=np.array(scale, float), published=np.array(published, float)
    )
    return SimpleNamespace(ordinary=ordinary)


def test_size_is_the_geometric_mean_of_the_kinds_root_mean_squares() -> None:
    board = _errors_board(["torque_gain", "torque_gain", "armature"], [0.5, 0.5, 2.0], [1.0, 1.0, 1.0])
    # 3 and 4 times a half: root mean square 0.5·√12.5. One times 2.
    expected = np.sqrt(0.5 * np.sqrt(12.5) * 2.0)
    assert size_of_errors(board, np.array([3.0, -4.0, 1.0])) == pytest.approx(expected)


def test_a_load_cell_moves_no_robot() -> None:
    board = _errors_board(["torque_gain", "load_sensor_gain"], [1.0, 1.0], [1.0, 1.0])
    assert size_of_errors(board, np.array([0.3, 50.0])) == pytest.approx(0.3)


def test_a_kind_without_any_error_counts_as_the_smallest() -> None:
    board = _errors_board(["torque_gain", "armature"], [1.0, 1.0], [1.0, 1.0])
    assert size_of_errors(board, np.array([0.0, 1.0])) == pytest.approx(np.sqrt(SMALLEST))


def test_without_any_kind_errors_are_as_published() -> None:
    assert size_of_errors(_errors_board([], [], []), np.zeros(0)) == 1.0


LOAD, WRENCH = Channel.SET_POINT_TO_LOAD, Channel.BASE_WRENCH


def _left_board() -> Any:
    return SimpleNamespace(
        by_channel={LOAD: [0, 1], WRENCH: [2], Channel.BATTERY_POWER: [3]},
        tolerance_square=np.array([3.0, 3.0, 0.0, 0.0]),
        relative_square=np.array([0.25, 0.25, 0.0, 0.0]),
    )


def test_the_signal_that_is_farthest_over_noise_and_formulas_counts() -> None:
    scored: Any = SimpleNamespace(held_out=np.array([8.0, 40.0, 0.5, 1e6]), explained=np.array([0.0, 64.0, 0.0, 0.0]))
    # 8 of 1 + 3; 40 of 1 + 3 + 64/4; the battery is not checked.
    assert excess(_left_board(), scored) == pytest.approx({LOAD: np.log(2.0), WRENCH: np.log(0.5)})


def test_a_signal_that_is_explained_to_the_bit_is_not_odd() -> None:
    scored: Any = SimpleNamespace(held_out=np.zeros(4), explained=np.zeros(4))
    assert is_odd(excess(_left_board(), scored)) < 0.01


@pytest.mark.parametrize("channel", ORDINARY_EXCESS)
def test_what_robots_without_a_fault_leave_is_not_odd_and_far_more_is(channel: Channel) -> None:
    median, spread = ORDINARY_EXCESS[channel]
    even, _ = ODD_EXCESS
    assert is_odd({channel: median}) < 0.01
    assert is_odd({channel: median + even * spread}) == pytest.approx(0.5)
    assert is_odd({channel: median + 2.0 * even * spread}) > 0.99


def test_one_odd_signal_is_enough_and_without_signals_nothing_is_odd() -> None:
    usual = {channel: median for channel, (median, _) in ORDINARY_EXCESS.items()}
    assert is_odd(usual | {WRENCH: 5.0}) > 0.99 > 0.01 > is_odd(usual)
    assert is_odd({}) == 0.0


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
