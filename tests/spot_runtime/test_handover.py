"""The hand-over blends torques, so nothing jumps at its start and nothing is left of the stand at its end."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spot_model.robot import facts
from spot_model.robot.control import pd_torque
from spot_model.robot.facts import Array
from spot_model.robot.state import Gains, RobotState
from spot_runtime.control.set_point import (
    LoadAverage,
    Setpoint,
    blend,
    damping_setpoint,
    hold_setpoint,
    hold_weight_in,
    hold_weight_out,
    policy_setpoint,
)

MEASURED_RAD = facts.DEFAULT_POSITION_RAD + 0.05
LOAD_NM = np.tile([2.0, -4.0, -21.0], 4)
HOLD = hold_setpoint(MEASURED_RAD, LOAD_NM)
POLICY = policy_setpoint(facts.DEFAULT_POSITION_RAD - 0.1, Gains.policy())


def torque(setpoint: Setpoint, position_rad: Array, velocity_rad_s: Array) -> Array:
    result: Array = pd_torque(
        position_rad=position_rad,
        velocity_rad_s=velocity_rad_s,
        setpoint_position_rad=setpoint.position_rad,
        setpoint_velocity_rad_s=0.0,
        feedforward_nm=setpoint.load_nm,
        kp_nm_per_rad=setpoint.gains.kp_nm_per_rad,
        kd_nm_s_per_rad=setpoint.gains.kd_nm_s_per_rad,
    )
    return result


def test_at_the_measured_pose_and_at_rest_the_hold_asks_for_the_measured_load() -> None:
    np.testing.assert_allclose(torque(HOLD, MEASURED_RAD, np.zeros(12)), LOAD_NM, atol=1e-12)


@given(st.floats(0.0, 1.0), st.integers(0, 2**32 - 1))
def test_the_torque_of_the_blend_is_the_weighted_sum_of_both_torques(weight: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    position, velocity = MEASURED_RAD + rng.normal(0.0, 0.2, 12), rng.normal(0.0, 2.0, 12)
    blended = torque(blend(HOLD, POLICY, weight), position, velocity)
    expected = weight * torque(HOLD, position, velocity) + (1.0 - weight) * torque(POLICY, position, velocity)
    np.testing.assert_allclose(blended, expected, rtol=1e-9, atol=1e-9)


def test_the_ends_of_the_blend_are_the_two_laws_themselves() -> None:
    assert blend(HOLD, POLICY, 1.0) is HOLD
    assert blend(HOLD, POLICY, 0.0) is POLICY


@pytest.mark.parametrize("weight", [-0.01, 1.01, float("nan")])
def test_a_weight_outside_0_to_1_is_refused(weight: float) -> None:
    with pytest.raises(ValueError, match=r"hold_weight = .*allowed: 0 to 1"):
        blend(HOLD, POLICY, weight)


@given(st.floats(-0.5, 1.5), st.floats(-0.5, 1.5))
def test_weights_move_one_way_and_meet_their_ends(a: float, b: float) -> None:
    low, high = sorted((a, b))
    assert hold_weight_in(low) >= hold_weight_in(high)
    assert hold_weight_out(low) <= hold_weight_out(high)
    assert (hold_weight_in(0.0), hold_weight_in(1.0)) == (1.0, 0.0)
    assert (hold_weight_out(0.0), hold_weight_out(1.0)) == (0.0, 1.0)


def test_the_gains_reach_the_policys_exactly() -> None:
    np.testing.assert_array_equal(blend(HOLD, POLICY, hold_weight_in(1.0)).gains.kp_nm_per_rad, np.full(12, 60.0))
    np.testing.assert_array_equal(blend(HOLD, POLICY, hold_weight_in(2.0)).gains.kd_nm_s_per_rad, np.full(12, 1.5))


def test_damping_has_no_stiffness_and_brakes_every_motion() -> None:
    setpoint = damping_setpoint(MEASURED_RAD, 8.0)
    velocity = np.linspace(-3.0, 3.0, 12)
    np.testing.assert_allclose(torque(setpoint, MEASURED_RAD + 0.7, velocity), -8.0 * velocity)


def test_the_load_is_averaged_over_the_window_alone(make_state: Callable[..., RobotState]) -> None:
    average = LoadAverage.over(0.3)
    for i in range(200):
        load = np.full(12, 100.0 if i < 99 else 1.0)
        average = average.after([make_state(i * 3_000_000, load_nm=load)])
    assert average.is_full
    np.testing.assert_allclose(average.mean_nm(), np.full(12, 1.0))


def test_a_state_as_old_as_the_window_still_counts(make_state: Callable[..., RobotState]) -> None:
    average = LoadAverage.over(0.3)
    for stamp_ns, load_nm in ((-1, 900.0), (0, 4.0), (300_000_000, 2.0)):
        average = average.after([make_state(stamp_ns, load_nm=load_nm + np.arange(12.0))])
    np.testing.assert_array_equal(average.mean_nm(), 3.0 + np.arange(12.0))


def test_nine_tenths_of_the_window_are_full(make_state: Callable[..., RobotState]) -> None:
    average = LoadAverage.over(0.3)
    begin_ns = 1_700_000_000_000_000_000
    for i in range(90):
        average = average.after([make_state(begin_ns + i * 3_000_000)])
    assert not average.is_full
    assert average.after([make_state(begin_ns + 270_000_000)]).is_full


def test_the_average_of_too_few_states_is_not_full(make_state: Callable[..., RobotState]) -> None:
    average = LoadAverage.over(0.3)
    for i in range(80):
        average = average.after([make_state(i * 3_000_000)])
    assert not average.is_full


def test_no_new_state_leaves_the_average_as_it_is() -> None:
    average = LoadAverage.over(0.3)
    assert average.after([]) is average


def test_no_state_has_no_average() -> None:
    with pytest.raises(ValueError, match="no state"):
        LoadAverage.over(0.3).mean_nm()
