"""The body's height over its lowest foot, against the leg kinematics that the rest of the project uses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from spot_model.robot import facts
from spot_model.robot.leg_kinematics import foot_position_in_body_m
from spot_model.robot.rotation import matrix_from_wxyz
from spot_runtime.control.safety.body_height import body_height_m, is_body_above

UNIT = np.array([1.0, 0.0, 0.0, 0.0])


@given(
    arrays(np.float64, 12, elements=st.floats(-2.5, 2.5)),
    arrays(np.float64, 4, elements=st.floats(-1.0, 1.0)).filter(lambda q: float(np.linalg.norm(q)) > 0.1),
)
def test_it_is_the_largest_reach_of_any_leg_against_the_world(position_rad: np.ndarray, q: np.ndarray) -> None:
    wxyz = q / np.linalg.norm(q)
    feet_in_world = foot_position_in_body_m(position_rad) @ matrix_from_wxyz(wxyz).T
    expected = (facts.FOOT_RADIUS_M - feet_in_world[:, 2]).max()
    assert body_height_m(position_rad, wxyz) == pytest.approx(expected, abs=1e-9)


def test_standing_straight_by_hand() -> None:
    straight = np.zeros(12)
    down_m = -facts.KN_FROM_HY_M[2] - facts.FOOT_FROM_KN_M[2] + facts.FOOT_RADIUS_M
    assert body_height_m(straight, UNIT) == pytest.approx(down_m)
    upside_down = np.array([0.0, 1.0, 0.0, 0.0])
    assert body_height_m(straight, upside_down) == pytest.approx(-down_m + 2 * facts.FOOT_RADIUS_M)


@pytest.mark.parametrize("leg", range(4))
def test_one_leg_on_the_ground_is_enough(leg: int) -> None:
    folded = np.tile([0.0, 1.6, -2.7], 4)
    assert not is_body_above(0.25, folded, UNIT)
    folded[3 * leg : 3 * leg + 3] = facts.DEFAULT_POSITION_RAD[3 * leg : 3 * leg + 3]
    assert is_body_above(0.25, folded, UNIT)


def test_the_bound_itself_is_high_enough() -> None:
    height_m = body_height_m(facts.DEFAULT_POSITION_RAD, UNIT)
    assert is_body_above(height_m, facts.DEFAULT_POSITION_RAD, UNIT)
    assert not is_body_above(height_m + 1e-9, facts.DEFAULT_POSITION_RAD, UNIT)
