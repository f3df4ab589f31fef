"""Which set-point each mode asks for."""

from __future__ import annotations

import numpy as np
import pytest

from spot_model.robot import facts
from spot_model.robot.state import Gains
from spot_runtime.config import HandoverConfig
from spot_runtime.control.modes import TAKE_HOLD_S, Mode
from spot_runtime.control.set_point import (
    asked_setpoint,
    blend,
    hold_setpoint,
    hold_weight_out,
    policy_setpoint,
    taking_hold,
    within_stops,
)

CONFIG = HandoverConfig(ramp_in_s=2.0, ramp_out_s=1.0, damping_kd_nm_s_per_rad=7.0)
POSE = facts.DEFAULT_POSITION_RAD
HOLD = hold_setpoint(POSE, np.full(12, 3.0))
POLICY_RAD = POSE + 0.1
MEASURED_RAD = POSE - 0.2


def asked(mode: Mode, in_mode_s: float = 0.5, policy_rad: np.ndarray | None = POLICY_RAD):  # type: ignore[no-untyped-def]
    return asked_setpoint(
        mode,
        in_mode_s,
        hold=HOLD,
        policy_rad=policy_rad,
        policy_gains=Gains.policy(),
        measured_rad=MEASURED_RAD,
        config=CONFIG,
    )


def test_without_the_policy_the_pose_is_held() -> None:
    assert asked(Mode.STANDING) is HOLD
    assert asked(Mode.STANDING, policy_rad=None) is HOLD


@pytest.mark.parametrize(
    ("held_share", "stiffness"), [(-1.0, 0.1), (0.0, 0.1), (0.5, 0.1**0.5), (1.0, 1.0), (3.0, 1.0)]
)
def test_a_pose_is_taken_hold_of_by_equal_factors_from_a_tenth_of_the_stiffness(
    held_share: float, stiffness: float
) -> None:
    """Damping and the torque that carries the body are all there from the beginning."""
    setpoint = asked(Mode.ACTIVATING, held_share * TAKE_HOLD_S, policy_rad=None)
    np.testing.assert_allclose(setpoint.gains.kp_nm_per_rad, stiffness * HOLD.gains.kp_nm_per_rad)
    assert setpoint.gains.kd_nm_s_per_rad is HOLD.gains.kd_nm_s_per_rad
    assert setpoint.position_rad is HOLD.position_rad
    assert setpoint.load_nm is HOLD.load_nm


def test_a_pose_is_held_firmly_at_once_where_no_load_is_reported() -> None:
    bare = hold_setpoint(POSE, np.zeros(12))
    assert taking_hold(bare, 0.0) is bare
    one = hold_setpoint(POSE, np.where(np.arange(12) == 7, 1e-3, 0.0))
    assert taking_hold(one, 0.0) is not one


@pytest.mark.parametrize("mode", [Mode.ACTIVE, Mode.SOFT_STOP])
def test_the_policy_alone_drives(mode: Mode) -> None:
    setpoint = asked(mode)
    np.testing.assert_array_equal(setpoint.position_rad, POLICY_RAD)
    np.testing.assert_array_equal(setpoint.gains.kp_nm_per_rad, Gains.policy().kp_nm_per_rad)
    assert not setpoint.load_nm.any()


@pytest.mark.parametrize(
    ("mode", "in_mode_s", "weight"),
    [
        (Mode.RAMPING_IN, 0.0, 1.0),
        (Mode.RAMPING_IN, 0.5, 0.75**3),
        (Mode.RAMPING_IN, 2.0, 0.0),
        (Mode.RAMPING_OUT, 0.0, 0.0),
        (Mode.RAMPING_OUT, 0.25, 0.25**3),
        (Mode.RAMPING_OUT, 1.0, 1.0),
    ],
)
def test_the_ramps_blend(mode: Mode, in_mode_s: float, weight: float) -> None:
    expected = blend(HOLD, policy_setpoint(POLICY_RAD, Gains.policy()), weight)
    setpoint = asked(mode, in_mode_s)
    np.testing.assert_allclose(setpoint.position_rad, expected.position_rad)
    np.testing.assert_allclose(setpoint.load_nm, expected.load_nm)
    np.testing.assert_allclose(setpoint.gains.kp_nm_per_rad, expected.gains.kp_nm_per_rad)


def test_damping_needs_neither_policy_nor_state() -> None:
    setpoint = asked(Mode.DAMPING, policy_rad=None)
    np.testing.assert_array_equal(setpoint.position_rad, MEASURED_RAD)
    assert not setpoint.gains.kp_nm_per_rad.any()
    assert (setpoint.gains.kd_nm_s_per_rad == 7.0).all()


@pytest.mark.parametrize("mode", [m for m in Mode if m.runs_policy])
def test_a_mode_of_the_policy_needs_its_set_point(mode: Mode) -> None:
    with pytest.raises(ValueError, match=f"mode {mode.value} needs the policy's set-point"):
        asked(mode, policy_rad=None)


def test_a_measured_pose_is_brought_within_the_stops() -> None:
    np.testing.assert_array_equal(within_stops(POSE), POSE)
    np.testing.assert_array_equal(within_stops(facts.POSITION_HIGH_RAD + 0.1), facts.POSITION_HIGH_RAD)
    np.testing.assert_array_equal(within_stops(facts.POSITION_LOW_RAD - 0.1), facts.POSITION_LOW_RAD)


def test_no_load_is_nobodys_to_change() -> None:
    with pytest.raises(ValueError, match="read-only"):
        policy_setpoint(POLICY_RAD, Gains.policy()).load_nm[0] = 1.0


def test_the_way_back_begins_and_ends_where_the_ramp_does() -> None:
    weights = [hold_weight_out(share) for share in (-1.0, 0.0, 0.5, 1.0, 3.0)]
    assert weights == [0.0, 0.0, 0.125, 1.0, 1.0]
