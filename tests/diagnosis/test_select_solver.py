import numpy as np
import pytest

from diagnosis.library import Robot
from diagnosis.library.registry import LIBRARY
from diagnosis.selection.normal_equations import solve_bounded
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
