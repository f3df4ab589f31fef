"""The safety core: what it lets through, what it cuts, and what it stops."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from spot_model.robot import facts
from spot_model.robot.state import Gains, JointCommand, RobotState, SlowState
from spot_runtime.control.safety.battery import BatteryMemory, check_slow_state
from spot_runtime.control.safety.commands import SetpointMemory, check_command, limit_setpoint
from spot_runtime.control.safety.states import StateMemory, check_age, check_echo, screen_state
from spot_runtime.safety_limits import SafetyLimits
from spot_runtime.stops import StopReason

MakeState = Callable[..., RobotState]
MakeSlow = Callable[..., SlowState]
MS = 1_000_000
START_NS = 1_700_000_000_000_000_000
LIMITS = SafetyLimits()
STIFF = np.full(12, 1000.0)
ANY_FLOAT = st.floats(allow_nan=True, allow_infinity=True, width=64)


def screen(states: list[RobotState], limits: SafetyLimits = LIMITS) -> tuple[StateMemory, list[bool], list[StopReason]]:
    memory, usable, reasons = StateMemory(), [], []
    for state in states:
        memory, is_usable, stop = screen_state(memory, state, state.robot_stamp_ns + 2 * MS, limits)
        usable.append(is_usable)
        reasons += [stop.reason] if stop is not None else []
    return memory, usable, reasons


# States --------------------------------------------------------------------------------------------------------------


def test_a_healthy_stream_passes(make_state: MakeState) -> None:
    memory, usable, reasons = screen([make_state(START_NS + i * 3 * MS) for i in range(100)])
    assert all(usable)
    assert reasons == []
    assert memory.newest is not None
    assert memory.newest.robot_stamp_ns == START_NS + 297 * MS


def test_duplicated_and_back_dated_states_are_never_used(make_state: MakeState) -> None:
    stamps = [0, 3, 3, 0, 6]
    memory, usable, reasons = screen([make_state(START_NS + ms * MS) for ms in stamps])
    assert usable == [True, True, False, False, True]
    assert memory.rejected == 2
    assert memory.rejected_in_row == 0
    assert reasons == []


def test_ten_rejected_states_in_a_row_are_a_stop(make_state: MakeState) -> None:
    _, usable, reasons = screen([make_state(START_NS)] * 11)
    assert usable == [True] + [False] * 10
    assert reasons == [StopReason.STATE_REJECTED]


def test_a_state_from_the_future_means_a_jumped_clock(make_state: MakeState) -> None:
    _, is_usable, stop = screen_state(StateMemory(), make_state(START_NS), START_NS - 51 * MS, LIMITS)
    assert not is_usable
    assert stop is not None
    assert stop.reason is StopReason.CLOCK_JUMPED
    assert stop.values == {"ahead_s": pytest.approx(0.051), "bound_s": 0.05}


@pytest.mark.parametrize(
    "field", ["position_rad", "velocity_rad_s", "load_nm", "linear_vel_of_body_in_odom_m_s", "odom_from_body_wxyz"]
)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_one_value_that_is_no_number_is_a_stop_at_once(make_state: MakeState, field: str, value: float) -> None:
    broken = getattr(make_state(), field).copy()
    broken[-1] = value
    memory, usable, reasons = screen([make_state(START_NS), make_state(START_NS + 3 * MS, **{field: broken})])
    assert usable == [True, False]
    assert reasons == [StopReason.STATE_NOT_FINITE]
    assert memory.newest is not None
    assert memory.newest.robot_stamp_ns == START_NS


def test_opposite_infinities_do_not_cancel(make_state: MakeState) -> None:
    velocity = np.zeros(12)
    velocity[:2] = np.inf, -np.inf
    assert screen([make_state(velocity_rad_s=velocity)])[2] == [StopReason.STATE_NOT_FINITE]


def test_another_number_of_joints_is_a_stop(make_state: MakeState) -> None:
    assert screen([make_state(load_nm=np.zeros(19))])[2] == [StopReason.STATE_NOT_FINITE]


def test_an_attitude_that_is_no_rotation_is_a_stop(make_state: MakeState) -> None:
    assert screen([make_state(odom_from_body_wxyz=np.array([0.9, 0.0, 0.0, 0.0]))])[2] == [StopReason.STATE_ATTITUDE]
    assert screen([make_state(odom_from_body_wxyz=np.array([-1.0, 0.0, 0.0, 0.0]))])[2] == []


def test_frozen_joint_values_are_a_stop_after_40_ms(make_state: MakeState) -> None:
    same = make_state(START_NS).position_rad
    states = [make_state(START_NS + i * 3 * MS, position_rad=same) for i in range(15)]
    _, usable, reasons = screen(states)
    assert usable == [True] * 14 + [False]
    assert reasons == [StopReason.STATE_FROZEN]


@pytest.mark.parametrize(("roll_deg", "is_stop"), [(44.0, False), (46.0, True), (180.0, True)])
def test_the_body_may_tilt_up_to_45_degrees(make_state: MakeState, roll_deg: float, is_stop: bool) -> None:
    half = np.deg2rad(roll_deg) / 2.0
    state = make_state(odom_from_body_wxyz=np.array([np.cos(half), np.sin(half), 0.0, 0.0]))
    assert screen([state])[2] == ([StopReason.TILT] if is_stop else [])


def test_heading_is_not_tilt(make_state: MakeState) -> None:
    assert screen([make_state(odom_from_body_wxyz=np.array([0.0, 0.0, 0.0, 1.0]))])[2] == []


def test_a_joint_that_is_too_fast_or_beyond_its_stop_is_named(make_state: MakeState) -> None:
    velocity, position = np.zeros(12), make_state().position_rad.copy()
    velocity[5] = -41.0
    position[9] = 1.1
    _, _, fast = screen_state(StateMemory(), make_state(velocity_rad_s=velocity), START_NS, LIMITS)
    _, _, beyond = screen_state(StateMemory(), make_state(position_rad=position), START_NS, LIMITS)
    assert fast is not None
    assert (fast.reason, fast.detail) == (StopReason.JOINT_VELOCITY, "fr_kn")
    assert beyond is not None
    assert (beyond.reason, beyond.detail) == (StopReason.JOINT_POSITION, "hr_hx")


@pytest.mark.parametrize(
    ("age_ms", "reason"),
    [
        (0, None),
        (39.9, None),
        (40, StopReason.STATE_STALE),
        (199, StopReason.STATE_STALE),
        (200, StopReason.STATE_LOST),
    ],
)
def test_the_age_of_the_newest_state(make_state: MakeState, age_ms: float, reason: StopReason | None) -> None:
    memory, _, _ = screen([make_state(START_NS)])
    stop = check_age(memory, START_NS + round(age_ms * MS), LIMITS)
    assert (stop.reason if stop else None) is reason


def test_without_any_state_there_is_no_age() -> None:
    assert check_age(StateMemory(), START_NS, LIMITS) is None
    assert check_echo(StateMemory(), START_NS, LIMITS) is None


def test_the_robot_must_go_on_confirming_commands(make_state: MakeState) -> None:
    states = [make_state(START_NS + i * 3 * MS, last_command_key=min(i, 10)) for i in range(61)]
    memory, _, _ = screen(states[:60])
    assert check_echo(memory, START_NS, LIMITS) is None
    memory, _, _ = screen(states)
    stop = check_echo(memory, START_NS, LIMITS)
    assert stop is not None
    assert stop.reason is StopReason.COMMAND_UNCONFIRMED
    assert stop.values["silent_s"] == pytest.approx(0.150)


# Set-points ----------------------------------------------------------------------------------------------------------


@given(arrays(np.float64, 12, elements=ANY_FLOAT), arrays(np.float64, 12, elements=st.floats(-0.7, -0.3)))
def test_no_set_point_ever_leaves_the_limits(requested: np.ndarray, before: np.ndarray) -> None:
    memory = SetpointMemory(sent_rad=np.clip(before, facts.POSITION_LOW_RAD, facts.POSITION_HIGH_RAD))
    after, limited, stop = limit_setpoint(memory, requested, STIFF, LIMITS)
    assert memory.sent_rad is not None
    assert np.isfinite(limited.position_rad).all()
    assert (limited.position_rad >= facts.POSITION_LOW_RAD).all()
    assert (limited.position_rad <= facts.POSITION_HIGH_RAD).all()
    assert np.abs(limited.position_rad - memory.sent_rad).max() <= LIMITS.setpoint_step_rad + 1e-12
    if np.isfinite(requested).all():
        np.testing.assert_array_equal(limited.cut, limited.position_rad != requested)
        np.testing.assert_array_equal(after.sent_rad, limited.position_rad)
    else:
        assert stop is not None
        assert stop.reason is StopReason.POLICY_NOT_FINITE


@given(arrays(np.float64, 12, elements=st.floats(-0.2, 0.2)))
def test_a_request_within_the_limits_passes_bit_for_bit(offset: np.ndarray) -> None:
    requested = facts.DEFAULT_POSITION_RAD + offset
    _, limited, stop = limit_setpoint(SetpointMemory(facts.DEFAULT_POSITION_RAD), requested, STIFF, LIMITS)
    np.testing.assert_array_equal(limited.position_rad, requested)
    assert not limited.cut.any()
    assert stop is None


def test_a_request_that_is_no_number_keeps_what_was_sent() -> None:
    requested = facts.DEFAULT_POSITION_RAD.copy()
    requested[2] = np.nan
    sent = facts.DEFAULT_POSITION_RAD + 0.01
    _, limited, stop = limit_setpoint(SetpointMemory(sent), requested, STIFF, LIMITS)
    np.testing.assert_array_equal(limited.position_rad, sent)
    assert stop is not None
    assert stop.detail == "fl_kn"
    _, limited, _ = limit_setpoint(SetpointMemory(), requested, STIFF, LIMITS)
    np.testing.assert_array_equal(limited.position_rad, facts.DEFAULT_POSITION_RAD)


def test_requests_that_keep_jumping_are_cut_then_stopped() -> None:
    limits = SafetyLimits(setpoint_step_rad=0.2, setpoint_step_ticks=3)
    memory = SetpointMemory(facts.DEFAULT_POSITION_RAD)
    stops = []
    for i in range(3):
        requested = facts.DEFAULT_POSITION_RAD + (0.6 if i % 2 == 0 else -0.6)
        memory, limited, stop = limit_setpoint(memory, requested, STIFF, limits)
        assert limited.cut.all()
        stops.append(stop)
    assert stops[:2] == [None, None]
    assert stops[2] is not None
    assert stops[2].reason is StopReason.SETPOINT_STEP


def test_requests_far_beyond_a_stop_end_the_run_and_name_the_joint() -> None:
    requested = facts.DEFAULT_POSITION_RAD.copy()
    requested[3] = 2.0
    memory = SetpointMemory()
    for _ in range(4):
        memory, _, stop = limit_setpoint(memory, requested, STIFF, LIMITS)
        assert stop is None
    _, _, stop = limit_setpoint(memory, requested, STIFF, LIMITS)
    assert stop is not None
    assert (stop.reason, stop.detail) == (StopReason.SETPOINT_OVERSHOOT, "fr_hx")
    assert stop.values["beyond_rad"] == pytest.approx(2.0 - 0.785398)


def test_one_good_tick_forgives_the_cut_ones_before() -> None:
    limits = SafetyLimits(setpoint_step_rad=0.2, setpoint_step_ticks=2)
    memory = SetpointMemory(facts.DEFAULT_POSITION_RAD)
    for offset in (0.5, 0.2, 0.7, 0.4):
        memory, _, stop = limit_setpoint(memory, facts.DEFAULT_POSITION_RAD + offset, STIFF, limits)
        assert stop is None
    assert memory.cut_ticks == 2


# Slow state ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({}, None),
        ({"estopped": True}, StopReason.ESTOPPED),
        ({"motors_powered": False}, StopReason.MOTORS_OFF),
        ({"behavior_faults": ("fall (1)",)}, StopReason.BEHAVIOR_FAULT),
        ({"battery_charge_percent": 7.9}, StopReason.BATTERY_LOW),
        ({"motor_temperature_c": {"fl_kn": 40.0, "hr_kn": 75.1}}, StopReason.MOTOR_HOT),
        ({"system_faults": ("critical: battery",)}, StopReason.SYSTEM_FAULT),
        ({"system_faults": ("camera",)}, None),
        ({"host_stamp_ns": START_NS - 3_001 * MS}, StopReason.LINK_LOST),
    ],
)
def test_the_slow_state(make_slow: MakeSlow, changes: dict[str, object], reason: StopReason | None) -> None:
    _, stop = check_slow_state(BatteryMemory(), make_slow(**changes), START_NS, LIMITS)
    assert (stop.reason if stop else None) is reason


# The last gate -------------------------------------------------------------------------------------------------------


def command(**changes: object) -> JointCommand:
    fields: dict[str, object] = {
        "key": 7,
        "position_rad": facts.DEFAULT_POSITION_RAD,
        "velocity_rad_s": np.zeros(12),
        "load_nm": np.zeros(12),
        "gains": Gains.policy(),
        "end_robot_stamp_ns": START_NS + 50 * MS,
        **changes,
    }
    return JointCommand(**fields)  # type: ignore[arg-type]


def test_a_good_command_passes_the_gate() -> None:
    assert check_command(command(), 6, START_NS) is None


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"key": 6}, "key 6 is not above 6"),
        ({"end_robot_stamp_ns": START_NS}, "allowed: above 0, at most 0.1"),
        ({"end_robot_stamp_ns": START_NS + 101 * MS}, "0.101 s ahead"),
        ({"load_nm": np.full(12, np.nan)}, "no number"),
        ({"gains": Gains(np.full(12, np.inf), np.zeros(12))}, "no number"),
        ({"position_rad": facts.POSITION_HIGH_RAD + 1e-9}, "beyond a joint's stop"),
    ],
)
def test_the_gate_says_what_is_wrong(changes: dict[str, object], words: str) -> None:
    wrong = check_command(command(**changes), 6, START_NS)
    assert wrong is not None
    assert words in wrong


def test_bounds_on_ages_must_rise() -> None:
    with pytest.raises(ValueError, match="must rise"):
        SafetyLimits(state_age_damp_s=0.3)
