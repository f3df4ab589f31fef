"""The safety core at its bounds: the last value that passes and the first that does not, and what a stop tells."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from spot_model.policy.contract import PolicyContract, StoredPair
from spot_model.robot import facts
from spot_model.robot.state import Gains, JointCommand, RobotState, SlowState
from spot_runtime.config import HandoverConfig
from spot_runtime.control.modes import Mode, ModeInputs
from spot_runtime.control.safety import states
from spot_runtime.control.safety.battery import BatteryMemory, check_slow_state, watch
from spot_runtime.control.safety.body_height import body_height_m, check_policy, with_speed_limit
from spot_runtime.control.safety.commands import LimitedSetpoint, SetpointMemory, check_command, limit_setpoint
from spot_runtime.control.safety.states import DOUBTFUL_STATES, StateMemory, check_age, check_echo, screen_state
from spot_runtime.control.safety.watchdogs import LossMemory
from spot_runtime.control.set_point import (
    Setpoint,
    asked_setpoint,
    blend,
    hold_setpoint,
    hold_weight_in,
    hold_weight_out,
    policy_setpoint,
)
from spot_runtime.safety_limits import SafetyLimits
from spot_runtime.stops import Ending, Stop, StopReason

MakeState = Callable[..., RobotState]
MakeSlow = Callable[..., SlowState]
MS = 1_000_000
START_NS = 1_700_000_000_000_000_000
LIMITS = SafetyLimits()
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
STIFF = np.full(12, 1000.0)

# Bounds as data ------------------------------------------------------------------------------------------------------

RANGES = {
    # key: default, least, largest; a least of None is "above 0"
    "state_age_warn_s": (0.015, None, 1.0),
    "state_age_damp_s": (0.040, None, 1.0),
    "state_age_stop_s": (0.200, None, 5.0),
    "state_from_future_s": (0.050, None, 5.0),
    "rejected_states": (10, 1, 1000),
    "frozen_s": (0.040, None, 5.0),
    "quaternion_norm_error": (0.05, None, 1.0),
    "tilt_rad": (0.785398, None, 3.2),
    "body_height_m": (0.25, 0.0, 0.6),
    "joint_velocity_rad_s": (40.0, None, 100.0),
    "body_velocity_m_s": (10.0, None, 100.0),
    "body_turn_rate_rad_s": (20.0, None, 100.0),
    "load_nm": (400.0, None, 5000.0),
    "joint_position_margin_rad": (0.25, 0.0, 1.0),
    "signals": ("stop", None, None),
    "setpoint_speed_rad_s": (75.0, None, 500.0),
    "policy_kp_nm_per_rad": (300.0, None, 1000.0),
    "policy_kd_nm_s_per_rad": (15.0, None, 50.0),
    "policy_action_scale_rad": (1.0, None, 2.0),
    "policy_action_torque_nm": (113.0, None, 1000.0),
    "policy_rate_hz": ([10.0, 200.0], None, None),
    "setpoint_step_rad": (1.5, None, 10.0),
    "setpoint_step_ticks": (5, 1, 1000),
    "setpoint_overshoot_rad": (1.0, None, 20.0),
    "setpoint_overshoot_ticks": (5, 1, 1000),
    "feedforward_nm": (120.0, None, 200.0),
    "command_echo_s": (0.150, None, 5.0),
    "command_loss_share": (0.15, None, 1.0),
    "skipped_ticks": (10, 1, 1000),
    "clock_jump_s": (0.050, None, 5.0),
    "clock_unsynced_warn_s": (10.0, None, 600.0),
    "battery_percent": (8.0, 0.0, 100.0),
    "motor_temperature_c": (75.0, None, 150.0),
    "slow_state_age_s": (3.0, None, 60.0),
}


def test_every_bound_has_its_default_and_its_range() -> None:
    properties = SafetyLimits.model_json_schema()["properties"]
    told = {key: (entry["default"], entry.get("minimum"), entry.get("maximum")) for key, entry in properties.items()}
    assert told == RANGES
    above = {key for key, entry in properties.items() if entry.get("exclusiveMinimum") == 0.0}
    assert above == {
        key for key, (_, least, _) in RANGES.items() if least is None and key not in ("signals", "policy_rate_hz")
    }


@pytest.mark.parametrize(
    "ages", [(0.04, 0.04, 0.2), (0.05, 0.04, 0.2), (0.015, 0.2, 0.2), (0.015, 0.3, 0.2), (0.3, 0.2, 0.1)]
)
def test_bounds_on_ages_rise_strictly(ages: tuple[float, float, float]) -> None:
    names = ("state_age_warn_s", "state_age_damp_s", "state_age_stop_s")
    with pytest.raises(ValidationError, match="state_age_warn_s < state_age_damp_s < state_age_stop_s"):
        SafetyLimits.model_validate(dict(zip(names, ages, strict=True)))
    assert SafetyLimits(state_age_warn_s=0.001, state_age_damp_s=0.002, state_age_stop_s=0.003).frozen_s == 0.04


def test_limits_are_frozen_and_take_no_unknown_key_and_no_infinity() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        LIMITS.tilt_rad = 3.0
    with pytest.raises(ValidationError, match="Extra inputs"):
        SafetyLimits(tilt_deg=45.0)  # type: ignore[call-arg]
    with pytest.raises(ValidationError, match="finite"):
        SafetyLimits(setpoint_step_rad=float("nan"))


@pytest.mark.parametrize(
    "kind", [StateMemory, SetpointMemory, LimitedSetpoint, LossMemory, ModeInputs, Stop, Ending, Setpoint]
)
def test_memory_and_verdicts_cannot_be_changed(kind: Any) -> None:
    assert issubclass(kind, tuple) or kind.__dataclass_params__.frozen


# States --------------------------------------------------------------------------------------------------------------


def judged(state: RobotState, memory: StateMemory | None = None, now_ns: int = START_NS) -> Stop | None:
    return screen_state(memory or StateMemory(), state, now_ns, LIMITS)[2]


def test_the_future_begins_50_ms_ahead(make_state: MakeState) -> None:
    assert judged(make_state(START_NS + 50 * MS)) is None
    memory, is_usable, stop = screen_state(StateMemory(), make_state(START_NS + 51 * MS), START_NS, LIMITS)
    assert stop is not None
    assert stop.detail == "a state is stamped in the future"
    assert not is_usable
    assert memory == StateMemory(arrived_robot_stamp_ns=START_NS + 51 * MS)


@pytest.mark.parametrize(
    ("bound", "measured", "changes"),
    [
        ("quaternion_norm_error", "norm_error", {"odom_from_body_wxyz": np.array([0.9, 0.0, 0.0, 0.45])}),
        ("tilt_rad", "tilt_rad", {"odom_from_body_wxyz": np.array([np.cos(0.1), 0.0, np.sin(0.1), 0.0])}),
        ("body_velocity_m_s", "velocity_m_s", {"linear_vel_of_body_in_odom_m_s": np.array([0.3, -1.1, 0.7])}),
        ("body_turn_rate_rad_s", "turn_rate_rad_s", {"angular_vel_of_body_in_odom_rad_s": np.array([0.3, -1.1, 0.7])}),
        ("joint_velocity_rad_s", "velocity_rad_s", {"velocity_rad_s": np.where(np.arange(12) == 5, -7.3, 0.1)}),
    ],
)
def test_a_value_at_its_bound_may_be_used_and_one_beyond_it_not(
    make_state: MakeState, bound: str, measured: str, changes: dict[str, Any]
) -> None:
    def stop_at(value: float) -> Stop | None:
        limits = LIMITS.model_copy(update={bound: value})
        return screen_state(StateMemory(), make_state(START_NS, **changes), START_NS, limits)[2]

    stop = stop_at(1e-6)
    assert stop is not None
    value = stop.values[measured]
    assert stop_at(value) is None
    assert stop_at(float(np.nextafter(value, 0.0))) is not None


@pytest.mark.parametrize(
    ("measured", "changes"),
    [
        ("moved_rad", {"position_rad": np.where(np.arange(12) == 7, 0.3, 0.0)}),
        ("turned_rad", {"odom_from_body_wxyz": np.array([np.cos(0.1), 0.0, 0.0, np.sin(0.1)])}),
    ],
)
def test_a_motion_at_its_bound_is_no_leap(
    make_state: MakeState, monkeypatch: pytest.MonkeyPatch, measured: str, changes: dict[str, Any]
) -> None:
    limits = LIMITS.model_copy(update={"joint_velocity_rad_s": 0.0, "body_turn_rate_rad_s": 0.0})
    still = {"position_rad": np.zeros(12), "odom_from_body_wxyz": LEVEL}
    before, after = make_state(START_NS, **still), make_state(START_NS + 3 * MS, **{**still, **changes})
    stop = states._leap(before, after, limits)
    assert stop is not None
    monkeypatch.setattr(states, "LEAP_RAD", stop.values[measured])
    assert states._leap(before, after, limits) is None
    monkeypatch.setattr(states, "LEAP_RAD", float(np.nextafter(stop.values[measured], 0.0)))
    assert states._leap(before, after, limits) is not None


def test_an_attitude_a_little_longer_than_one_has_not_leapt(make_state: MakeState) -> None:
    before, after = (make_state(START_NS + at * MS, odom_from_body_wxyz=1.04 * LEVEL) for at in (0, 3))
    assert states._leap(before, after, LIMITS) is None


def test_a_robot_on_its_back_is_tilted_by_half_a_turn_however_long_its_quaternion(
    make_state: MakeState,
) -> None:
    for length in (1.0, 1.04):
        stop = judged(make_state(START_NS, odom_from_body_wxyz=length * np.array([0.0, 1.0, 0.0, 0.0])))
        assert stop is not None
        assert stop.reason is StopReason.TILT
        assert stop.values["tilt_rad"] == pytest.approx(np.pi)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("index", [0, -1])
@pytest.mark.parametrize(
    "name",
    [
        *("position_rad", "velocity_rad_s", "load_nm", "position_of_body_in_odom_m", "odom_from_body_wxyz"),
        *("linear_vel_of_body_in_odom_m_s", "angular_vel_of_body_in_odom_rad_s"),
    ],
)
def test_one_value_that_is_no_number_is_enough(make_state: MakeState, name: str, index: int, value: float) -> None:
    values = getattr(make_state(START_NS), name).copy()
    values[index] = value
    stop = judged(make_state(START_NS, **{name: values}))
    assert stop is not None
    assert stop.reason is StopReason.STATE_NOT_FINITE


def test_a_first_state_that_confirms_nothing_is_no_rise(make_state: MakeState) -> None:
    memory, _, _ = screen_state(StateMemory(), make_state(START_NS, last_command_key=0), START_NS, LIMITS)
    assert memory.echo_robot_stamp_ns == 0
    memory, _, _ = screen_state(StateMemory(), make_state(START_NS, last_command_key=1), START_NS, LIMITS)
    assert memory.echo_robot_stamp_ns == START_NS


def test_nothing_is_cut_unless_said() -> None:
    assert LimitedSetpoint(facts.DEFAULT_POSITION_RAD).cut.dtype == np.bool_


def test_whether_anything_was_cut() -> None:
    untouched = LimitedSetpoint(facts.DEFAULT_POSITION_RAD)
    assert not untouched.is_cut
    assert not untouched.cut.any()
    with pytest.raises(ValueError, match="read-only"):
        untouched.cut[0] = True
    nothing = np.zeros(12, dtype=np.bool_)
    assert not LimitedSetpoint(facts.DEFAULT_POSITION_RAD, nothing).is_cut
    nothing[7] = True
    assert LimitedSetpoint(facts.DEFAULT_POSITION_RAD, nothing).is_cut is True


def test_what_the_memory_holds_after_each_kind_of_state(make_state: MakeState) -> None:
    first = make_state(START_NS, last_command_key=3)
    memory, is_usable, stop = screen_state(StateMemory(), first, START_NS, LIMITS)
    assert (is_usable, stop) == (True, None)
    assert memory == StateMemory(first, START_NS, 0, 0, 0, START_NS, START_NS)
    again, is_usable, stop = screen_state(memory, first, START_NS, LIMITS)
    assert (is_usable, stop) == (False, None)
    assert again == memory._replace(rejected_in_row=1, rejected=1)
    # A state that causes a stop is not used, and what arrived last is known all the same.
    broken = make_state(START_NS + 3 * MS, load_nm=np.full(12, np.inf))
    after, is_usable, stop = screen_state(again, broken, START_NS + 3 * MS, LIMITS)
    assert stop == Stop(StopReason.STATE_NOT_FINITE, "load")
    assert not is_usable
    assert after == again._replace(arrived_robot_stamp_ns=START_NS + 3 * MS)
    older = again._replace(arrived_robot_stamp_ns=START_NS + 9 * MS)
    assert screen_state(older, broken, START_NS + 3 * MS, LIMITS)[0] == older
    # The same joints again, and no newer key: what changed last stays.
    same = make_state(START_NS + 6 * MS, position_rad=first.position_rad, last_command_key=3)
    last, is_usable, stop = screen_state(after, same, START_NS + 6 * MS, LIMITS)
    assert (is_usable, stop) == (True, None)
    assert last == StateMemory(same, START_NS + 6 * MS, 0, 1, 1, START_NS, START_NS)


@pytest.mark.parametrize("field", ["position_rad", "velocity_rad_s", "load_nm"])
def test_one_changed_value_of_any_kind_is_a_change(make_state: MakeState, field: str) -> None:
    first = make_state(START_NS, position_rad=facts.DEFAULT_POSITION_RAD)
    memory, _, _ = screen_state(StateMemory(), first, START_NS, LIMITS)
    changed = getattr(first, field).copy()
    changed[7] += 1e-12
    state = replace(first, robot_stamp_ns=START_NS + 3 * MS, **{field: changed})
    assert screen_state(memory, state, START_NS, LIMITS)[0].changed_robot_stamp_ns == START_NS + 3 * MS


def test_frozen_counts_from_the_last_change(make_state: MakeState) -> None:
    first = make_state(START_NS, position_rad=facts.DEFAULT_POSITION_RAD)
    memory, _, _ = screen_state(StateMemory(), first, START_NS, LIMITS)
    for stamp_ns, is_stop in ((START_NS + 40 * MS - 1, False), (START_NS + 40 * MS, True)):
        state = replace(first, robot_stamp_ns=stamp_ns)
        _, is_usable, stop = screen_state(memory, state, stamp_ns, LIMITS)
        assert is_usable is not is_stop
        assert stop == (Stop(StopReason.STATE_FROZEN, "", {"frozen_s": 0.04, "bound_s": 0.04}) if is_stop else None)


@pytest.mark.parametrize(("gap_ms", "missed"), [(3, 0), (4, 0), (5, 1), (6, 1), (9, 2), (300, 99)])
def test_states_that_never_came_are_counted(make_state: MakeState, gap_ms: int, missed: int) -> None:
    memory, _, _ = screen_state(StateMemory(missed=5), make_state(START_NS), START_NS, LIMITS)
    assert memory.missed == 5
    memory, _, _ = screen_state(memory, make_state(START_NS + gap_ms * MS), START_NS + gap_ms * MS, LIMITS)
    assert memory.missed == 5 + missed


def test_rejection_is_a_stop_from_the_tenth_on(make_state: MakeState) -> None:
    newest = make_state(START_NS)
    for in_row, is_stop in ((8, False), (9, True), (10, True)):
        memory = StateMemory(newest, START_NS, rejected_in_row=in_row, rejected=in_row)
        late = replace(newest, robot_stamp_ns=START_NS - 30 * MS)
        after, _, stop = screen_state(memory, late, START_NS, LIMITS)
        assert (after.rejected_in_row, after.rejected) == (in_row + 1, in_row + 1)
        values = {"in_row": in_row + 1.0, "bound": 10.0, "behind_s": 0.03}
        assert stop == (Stop(StopReason.STATE_REJECTED, "", values) if is_stop else None)


@pytest.mark.parametrize("field", ["position_rad", "velocity_rad_s", "load_nm"])
def test_each_array_has_twelve_values(make_state: MakeState, field: str) -> None:
    stop = judged(make_state(**{field: np.zeros(11)}))
    assert stop is not None
    assert stop.reason is StopReason.STATE_NOT_FINITE


def test_the_shape_that_was_found_is_told(make_state: MakeState) -> None:
    stop = judged(make_state(position_rad=np.zeros(11)))
    assert stop is not None
    assert stop.detail == "a state holds (11,) joint values; needed: 12"


@pytest.mark.parametrize("index", range(4))
@pytest.mark.parametrize(
    ("field", "name"),
    [
        ("odom_from_body_wxyz", "attitude"),
        ("linear_vel_of_body_in_odom_m_s", "body velocity"),
        ("position_of_body_in_odom_m", "body position"),
        ("position_rad", "position"),
        ("velocity_rad_s", "velocity"),
    ],
)
def test_every_component_is_looked_at(make_state: MakeState, field: str, name: str, index: int) -> None:
    values = getattr(make_state(), field).copy()
    values[index % len(values)] = np.nan
    assert judged(make_state(**{field: values})) == Stop(StopReason.STATE_NOT_FINITE, name)


def test_the_turning_rate_is_looked_at_too(make_state: MakeState) -> None:
    rate = np.array([0.0, 0.0, np.inf])
    assert judged(make_state(angular_vel_of_body_in_odom_rad_s=rate)) == Stop(StopReason.STATE_NOT_FINITE, "turn rate")


@pytest.mark.parametrize("axis", range(4))
@pytest.mark.parametrize(("length", "is_stop"), [(0.951, False), (1.049, False), (0.949, True), (1.051, True)])
def test_the_length_of_the_attitude(make_state: MakeState, axis: int, length: float, is_stop: bool) -> None:
    wxyz = np.zeros(4)
    wxyz[axis] = length
    # An attitude on its back is judged by other bounds, so only this one is looked at.
    stop = judged(make_state(odom_from_body_wxyz=wxyz))
    is_attitude = stop is not None and stop.reason is StopReason.STATE_ATTITUDE
    assert is_attitude == is_stop
    if stop is not None and is_stop:
        assert stop.values == {"norm_error": pytest.approx(abs(length - 1.0)), "bound": 0.05}


@pytest.mark.parametrize("axis", [1, 2])
@pytest.mark.parametrize(("tilt_rad", "is_stop"), [(0.7853, False), (-0.7853, False), (0.7855, True), (-0.7855, True)])
def test_tilt_about_either_axis(make_state: MakeState, axis: int, tilt_rad: float, is_stop: bool) -> None:
    wxyz = np.zeros(4)
    wxyz[0], wxyz[axis] = np.cos(tilt_rad / 2.0), np.sin(tilt_rad / 2.0)
    stop = judged(make_state(odom_from_body_wxyz=wxyz))
    values: dict[str, Any] = {"tilt_rad": pytest.approx(abs(tilt_rad)), "bound_rad": 0.785398}
    assert stop == (Stop(StopReason.TILT, "", values) if is_stop else None)


def test_tilt_of_a_long_and_of_a_turned_quaternion(make_state: MakeState) -> None:
    upside_down = judged(make_state(odom_from_body_wxyz=np.array([0.0, 1.04, 0.0, 0.0])))
    assert upside_down is not None
    assert upside_down.values["tilt_rad"] == pytest.approx(np.pi)
    half = np.sqrt(0.5)
    assert judged(make_state(odom_from_body_wxyz=np.array([half, 0.0, 0.0, half]))) is None
    both = judged(make_state(odom_from_body_wxyz=np.array([0.8, 0.36, 0.36, np.sqrt(1 - 0.64 - 2 * 0.1296)])))
    assert both is not None
    assert both.values["tilt_rad"] == pytest.approx(np.arccos(1.0 - 2.0 * 2.0 * 0.1296))


def test_a_collapsed_body_is_told_with_its_height(make_state: MakeState) -> None:
    stop = judged(make_state(position_rad=np.tile([0.0, 1.5, -2.7], 4)))
    assert stop is not None
    assert stop.reason is StopReason.BODY_LOW
    assert stop.values["bound_m"] == 0.25
    assert 0.0 < stop.values["height_m"] < 0.25


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("rest", "fast", "is_stop"), [(0.0, 40.0, False), (20.0, 40.0, False), (0.0, 40.1, True)])
def test_joint_velocity_counts_joint_by_joint(
    make_state: MakeState, sign: float, rest: float, fast: float, is_stop: bool
) -> None:
    velocity = np.full(12, rest)
    velocity[4] = sign * fast
    stop = judged(make_state(velocity_rad_s=velocity))
    values = {"velocity_rad_s": fast, "bound_rad_s": 40.0}
    assert stop == (Stop(StopReason.JOINT_VELOCITY, "fr_hy", values) if is_stop else None)


@pytest.mark.parametrize("joint", range(12))
@pytest.mark.parametrize("side", [-1, 1])
def test_a_joint_beyond_its_stop_by_more_than_the_margin(make_state: MakeState, joint: int, side: int) -> None:
    stops = facts.POSITION_LOW_RAD if side < 0 else facts.POSITION_HIGH_RAD
    for beyond_rad, is_stop in ((0.249, False), (0.251, True)):
        position = facts.DEFAULT_POSITION_RAD.copy()
        position[joint] = stops[joint] + side * beyond_rad
        stop = judged(make_state(position_rad=position))
        values: dict[str, Any] = {"beyond_rad": pytest.approx(0.251), "bound_rad": 0.25}
        assert stop == (Stop(StopReason.JOINT_POSITION, facts.JOINT_NAMES[joint], values) if is_stop else None)


# Ranges ------


@pytest.mark.parametrize(
    ("changes", "what", "values"),
    [
        ({"linear_vel_of_body_in_odom_m_s": np.array([0.0, 6.0, 8.1])}, "the body's velocity", (10.0797, 10.0)),
        ({"angular_vel_of_body_in_odom_rad_s": np.array([0.0, 0.0, -20.1])}, "its turn rate", (20.1, 20.0)),
        ({"load_nm": np.array([0.0] * 11 + [401.0])}, "a joint's load", (401.0, 400.0)),
        ({"load_nm": np.array([-401.0] + [0.0] * 11)}, "a joint's load", (401.0, 400.0)),
    ],
)
def test_what_no_spot_can_do_is_not_used(
    make_state: MakeState, changes: dict[str, Any], what: str, values: tuple[float, float]
) -> None:
    before = StateMemory(doubtful_in_row=DOUBTFUL_STATES - 1)
    memory, is_usable, stop = screen_state(before, make_state(**changes), START_NS, LIMITS)
    assert (memory.newest, is_usable) == (None, False)
    assert stop is not None
    assert (stop.reason, stop.detail) == (StopReason.SIGNAL_OUT_OF_RANGE, what)
    assert tuple(stop.values.values()) == pytest.approx(values, rel=1e-4)
    units = {"the body's velocity": "m_s", "its turn rate": "rad_s", "a joint's load": "nm"}
    assert all(key.endswith(units[what]) for key in stop.values)


def test_an_impact_on_a_joint_is_not_used_and_ends_nothing_unless_it_lasts(make_state: MakeState) -> None:
    memory, stops = StateMemory(), []
    loads = [500.0, 500.0, 0.0, 500.0, 500.0, 500.0]
    for i, load_nm in enumerate(loads):
        state = make_state(START_NS + 3 * i * MS, load_nm=np.array([0.0] * 11 + [load_nm]))
        memory, is_usable, stop = screen_state(memory, state, START_NS + 3 * i * MS, LIMITS)
        assert is_usable == (load_nm == 0.0)
        assert memory.arrived_robot_stamp_ns == state.robot_stamp_ns
        stops.append(stop is not None)
    assert stops == [False] * 5 + [True]
    assert memory.newest is not None
    assert memory.newest.robot_stamp_ns == START_NS + 6 * MS


def about_x(angle_rad: float) -> np.ndarray:
    return np.array([np.cos(0.5 * angle_rad), np.sin(0.5 * angle_rad), 0.0, 0.0])


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("periods", [1, 3])
def test_a_joint_moves_no_further_than_its_speed_allows(make_state: MakeState, sign: float, periods: int) -> None:
    """40 rad/s in 3 ms are 0.12 rad, and 0.1 rad are the sensors'."""
    first = make_state(START_NS)
    memory, _, _ = screen_state(StateMemory(), first, START_NS, LIMITS)
    memory = memory._replace(doubtful_in_row=DOUBTFUL_STATES - 1)
    later_ns, bound_rad = START_NS + 3 * periods * MS, 0.12 * periods + 0.1
    for moved_rad, is_leap in ((0.999 * bound_rad, False), (1.001 * bound_rad, True)):
        position = first.position_rad.copy()
        position[7] += sign * moved_rad
        after, is_usable, stop = screen_state(memory, make_state(later_ns, position_rad=position), later_ns, LIMITS)
        assert is_usable != is_leap
        assert after.doubtful_in_row == (DOUBTFUL_STATES if is_leap else 0)
        if is_leap:
            values: dict[str, Any] = {"moved_rad": pytest.approx(moved_rad), "bound_rad": pytest.approx(bound_rad)}
            assert stop == Stop(StopReason.SIGNAL_OUT_OF_RANGE, "position of hl_hy", values)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_body_turns_no_further_than_its_rate_allows(make_state: MakeState, sign: float) -> None:
    """20 rad/s in 3 ms are 0.06 rad, and 0.1 rad are the sensors'; a quaternion and its negative are one attitude."""
    first = make_state(START_NS, odom_from_body_wxyz=about_x(0.3))
    memory, _, _ = screen_state(StateMemory(), first, START_NS, LIMITS)
    memory = memory._replace(doubtful_in_row=DOUBTFUL_STATES - 1)
    later_ns = START_NS + 3 * MS
    for turned_rad, is_leap in ((0.0, False), (-0.159, False), (0.159, False), (0.161, True), (-0.161, True)):
        state = make_state(later_ns, odom_from_body_wxyz=sign * about_x(0.3 + turned_rad))
        _, is_usable, stop = screen_state(memory, state, later_ns, LIMITS)
        assert is_usable != is_leap
        if is_leap:
            values: dict[str, Any] = {"turned_rad": pytest.approx(0.161), "bound_rad": pytest.approx(0.16)}
            assert stop == Stop(StopReason.SIGNAL_OUT_OF_RANGE, "the attitude", values)


@pytest.mark.parametrize(
    "changes",
    [
        {"linear_vel_of_body_in_odom_m_s": np.array([0.0, 6.0, 8.0])},
        {"angular_vel_of_body_in_odom_rad_s": np.array([0.0, 0.0, -20.0])},
        {"load_nm": np.array([-400.0] + [400.0] * 11)},
    ],
)
def test_what_a_spot_might_just_do_is_used(make_state: MakeState, changes: dict[str, Any]) -> None:
    _, is_usable, stop = screen_state(StateMemory(), make_state(**changes), START_NS, LIMITS)
    assert is_usable
    assert stop is None


@pytest.mark.parametrize(
    ("changes", "names"),
    [
        ({"battery_charge_percent": float("nan")}, "charge"),
        ({"battery_voltage_v": float("inf")}, "voltage"),
        ({"battery_current_a": float("nan")}, "current"),
        ({"battery_temperature_c": (30.0, float("nan"))}, "battery temperature 2"),
        ({"motor_temperature_c": {"fl_hx": 20.0, "hr_kn": float("nan")}}, "hr_kn"),
        ({"battery_charge_percent": 100.1, "battery_voltage_v": 27.9}, "charge, voltage"),
        ({"battery_charge_percent": -0.1, "battery_voltage_v": 65.1}, "charge, voltage"),
        ({"battery_voltage_v": -55.0, "battery_current_a": 200.1}, "voltage, current"),
        (
            {"battery_current_a": -200.1, "battery_temperature_c": (200.1, -60.1)},
            "current, battery temperature 1, battery temperature 2",
        ),
        ({"motor_temperature_c": {"fl_hx": 310.0, "hr_kn": -61.0}}, "fl_hx, hr_kn"),
    ],
)
def test_what_is_no_number_is_unknown_and_unknown_is_not_good_for_long(
    make_slow: MakeSlow, changes: dict[str, Any], names: str
) -> None:
    temperatures = {"fl_hx": 20.0, "hr_kn": 20.0}
    good = make_slow(START_NS, battery_temperature_c=(30.0, 30.0), motor_temperature_c=temperatures)
    memory, stop = check_slow_state(BatteryMemory(), good, START_NS, LIMITS)
    assert (memory.since_ns, memory.charge_percent, memory.is_unknown, stop) == (START_NS, 80.0, False, None)
    for late_ns in (200 * MS, 3000 * MS):
        bad = replace(good, host_stamp_ns=START_NS + late_ns, **changes)
        assert check_slow_state(memory, bad, START_NS + late_ns, LIMITS) == (memory, None)
    assert check_slow_state(memory, replace(bad, **changes), START_NS + 3001 * MS, LIMITS) == (
        memory,
        Stop(StopReason.BATTERY_UNKNOWN, names, {"unknown_s": 3.001, "bound_s": 3.0}),
    )
    known_again = replace(good, host_stamp_ns=START_NS + 3001 * MS)
    after, stop = check_slow_state(memory, known_again, START_NS + 3001 * MS, LIMITS)
    assert (after.since_ns, stop) == (START_NS + 3001 * MS, None)


@pytest.mark.parametrize(("longest_s", "bound_s"), [(3.0, 1.0), (0.5, 0.5)])
def test_a_battery_that_was_never_known_is_waited_for_a_shorter_time(
    make_slow: MakeSlow, longest_s: float, bound_s: float
) -> None:
    slow = make_slow(START_NS, battery_charge_percent=float("nan"))
    memory, stop = watch(BatteryMemory(), slow, START_NS, longest_s)
    assert (memory.is_unknown, memory.since_ns, BatteryMemory().is_unknown, stop) == (True, START_NS, False, None)
    bound_ns = START_NS + round(bound_s * 1e9)
    assert watch(memory, slow, bound_ns, longest_s) == (memory, None)
    values = {"unknown_s": bound_s + 0.001, "bound_s": bound_s}
    assert watch(memory, slow, bound_ns + MS, longest_s)[1] == Stop(StopReason.BATTERY_UNKNOWN, "charge", values)


def test_a_poll_is_believed_once_and_what_is_wrong_with_one_is_said_each_time(make_slow: MakeSlow) -> None:
    good = make_slow(START_NS, battery_current_a=5.0)
    memory, stop = watch(BatteryMemory(has_discharged=True), good, START_NS, 3.0)
    assert stop is None
    assert memory.believed is good
    again, stop = watch(memory, good, START_NS + 60_000 * MS, 3.0)
    assert stop is None
    assert again is memory
    late_ns = START_NS + 10_000 * MS
    doubted = make_slow(late_ns, battery_charge_percent=-1.0)
    charging = make_slow(late_ns, battery_current_a=5.0)
    for wrong in (doubted, charging):
        after, first = watch(memory, wrong, late_ns, 3.0)
        _, second = watch(after, wrong, late_ns, 3.0)
        assert first is not None
        assert first == second


def test_what_cannot_be_true_is_neither_low_nor_hot(make_slow: MakeSlow) -> None:
    for changes in ({"battery_charge_percent": -0.1}, {"motor_temperature_c": {"fl_kn": 200.1}}):
        assert check_slow_state(BatteryMemory(), make_slow(START_NS, **changes), START_NS, LIMITS)[1] is None
    for changes, reason in (
        ({"battery_charge_percent": 0.0}, StopReason.BATTERY_LOW),
        ({"motor_temperature_c": {"fl_kn": 200.0}}, StopReason.MOTOR_HOT),
    ):
        stop = check_slow_state(BatteryMemory(), make_slow(START_NS, **changes), START_NS, LIMITS)[1]
        assert stop is not None
        assert stop.reason is reason


def test_the_ends_of_what_a_battery_does_are_believed_and_so_is_one_that_reports_neither_voltage_nor_current(
    make_slow: MakeSlow,
) -> None:
    for changes in (
        {"battery_charge_percent": 100.0, "battery_voltage_v": 28.0, "battery_current_a": -200.0},
        {"battery_voltage_v": 65.0, "battery_current_a": 200.0, "battery_temperature_c": (-60.0, 200.0)},
        {"battery_voltage_v": 0.0, "battery_current_a": 0.0},
    ):
        assert not watch(BatteryMemory(), make_slow(START_NS, **changes), START_NS, 3.0)[0].is_unknown


def test_an_empty_battery_is_low_and_not_unknown(make_slow: MakeSlow) -> None:
    _, stop = check_slow_state(BatteryMemory(), make_slow(START_NS, battery_charge_percent=0.0), START_NS, LIMITS)
    assert stop is not None
    assert stop.reason is StopReason.BATTERY_LOW


def test_a_battery_does_not_charge_for_long_while_the_motors_have_power(make_slow: MakeSlow) -> None:
    def ends_after(currents: list[float], **changes: Any) -> int | None:
        """Seconds, at one poll a second."""
        memory = BatteryMemory()
        for second, current_a in enumerate(currents):
            slow = make_slow(START_NS + second * 1000 * MS, battery_current_a=current_a, **changes)
            memory, stop = watch(memory, slow, slow.host_stamp_ns, 3.0)
            if stop is not None:
                values = {"charging_s": 10.0, "bound_s": 10.0}
                assert stop == Stop(
                    StopReason.BATTERY_UNKNOWN, "current: it charges though the motors have power", values
                )
                return second
        return None

    assert ends_after([-5.0, *[5.0] * 20]) == 11
    assert ends_after([-5.0, *[5.0] * 10, -1.0, *[5.0] * 10]) is None
    assert ends_after([-5.0, *[5.0] * 10, 0.0, *[5.0] * 11]) == 22
    assert ends_after([5.0] * 30) is None

    assert ends_after([-5.0, *[5.0] * 30], motors_powered=False) is None


# Policies ------


def contract(**changes: Any) -> PolicyContract:
    pair = StoredPair(observation=(0.0,) * 48, action=(0.0,) * 12)
    limits = {"velocity_command_low": (-1.0, -1.0, -1.0), "velocity_command_high": (1.0, 1.0, 1.0)}
    return PolicyContract.model_validate({"name": "p", "stored_pair": pair, **limits, **changes})


LOW_POSE_RAD = np.tile([0.0, 1.6, -2.6], 4)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"kp_nm_per_rad": (60.0,) * 11 + (301.0,)}, "kp_nm_per_rad = 301, allowed: up to 300"),
        ({"kd_nm_s_per_rad": (15.1,) * 12}, "kd_nm_s_per_rad = 15.1, allowed: up to 15"),
        ({"action_scale_rad": 1.1}, "action_scale_rad = 1.1, allowed: up to 1"),
        (
            {"kp_nm_per_rad": (300.0,) * 12, "action_scale_rad": 0.5},
            "torque of a unit action, N·m = 150, allowed: up to 113",
        ),
        ({"rate_hz": 9.0}, "rate_hz = 9, allowed: 10 to 200"),
        ({"rate_hz": 250.0}, "rate_hz = 250, allowed: 10 to 200"),
    ],
)
def test_a_contract_that_asks_for_too_much(changes: dict[str, Any], words: str) -> None:
    stop = check_policy(contract(**changes), facts.DEFAULT_POSITION_RAD, LIMITS)
    assert stop == Stop(StopReason.POLICY_OUT_OF_BOUNDS, words)


def test_a_contract_at_its_bounds_and_a_pose_that_lies() -> None:
    most = contract(kp_nm_per_rad=(300.0,) * 12, kd_nm_s_per_rad=(15.0,) * 12, action_scale_rad=0.376, rate_hz=200.0)
    assert check_policy(most, facts.DEFAULT_POSITION_RAD, LIMITS) is None
    assert check_policy(contract(rate_hz=10.0, action_scale_rad=1.0), facts.DEFAULT_POSITION_RAD, LIMITS) is None
    low = check_policy(contract(), LOW_POSE_RAD, LIMITS)
    assert low is not None
    height = body_height_m(LOW_POSE_RAD, LEVEL)
    assert low.detail == f"body height in the default pose = {height:.3f} m, allowed: from 0.25"
    two = check_policy(contract(rate_hz=5.0), LOW_POSE_RAD, LIMITS)
    assert two is not None
    assert two.detail == f"rate_hz = 5, allowed: 10 to 200; {low.detail}"


def test_the_hardest_joint_and_the_height_itself_decide() -> None:
    uneven = contract(kp_nm_per_rad=(301.0,) + (60.0,) * 11, kd_nm_s_per_rad=(1.0,) * 11 + (16.0,))
    stop = check_policy(uneven, facts.DEFAULT_POSITION_RAD, LIMITS)
    assert stop is not None
    assert stop.detail == "kp_nm_per_rad = 301, allowed: up to 300; kd_nm_s_per_rad = 16, allowed: up to 15"
    height_m = body_height_m(facts.DEFAULT_POSITION_RAD, LEVEL)
    at_it = LIMITS.model_copy(update={"body_height_m": height_m})
    assert check_policy(contract(), facts.DEFAULT_POSITION_RAD, at_it) is None


def test_a_policys_own_speed_bounds_the_step_too() -> None:
    assert with_speed_limit(LIMITS, 50.0, 10.0).setpoint_step_rad == pytest.approx(0.2)


def test_limits_that_were_read_are_the_limits() -> None:
    assert SafetyLimits.model_validate({}) == LIMITS
    assert SafetyLimits(policy_rate_hz=(50.0, 50.0)).policy_rate_hz == (50.0, 50.0)


def test_the_speed_of_set_points_bounds_their_step() -> None:
    """75 rad/s are 1.5 rad in 20 ms, 0.375 rad in 5 ms; at 10 Hz the step itself is the narrower bound."""
    for rate_hz, step_rad in ((50.0, 1.5), (200.0, 0.375), (10.0, 1.5)):
        assert with_speed_limit(LIMITS, rate_hz).setpoint_step_rad == pytest.approx(step_rad)
    assert with_speed_limit(LIMITS, 200.0).model_copy(update={"setpoint_step_rad": 1.5}) == LIMITS


@pytest.mark.parametrize("rates", [(0.5, 50.0), (60.0, 50.0), (10.0, 334.0)])
def test_two_rates_the_smaller_first(rates: tuple[float, float]) -> None:
    with pytest.raises(ValidationError, match="policy_rate_hz must be two rates, 1 Hz to 333 Hz, the smaller first"):
        SafetyLimits(policy_rate_hz=rates)
    assert SafetyLimits(policy_rate_hz=(1.0, 333.0)).policy_rate_hz == (1.0, 333.0)


@pytest.mark.parametrize(
    ("kp", "kd", "words"),
    [
        (1000.0, 50.0, None),
        (0.0, 0.0, None),
        (1000.1, 1.0, "its kp lies outside 0 to 1000"),
        (-0.1, 1.0, "its kp lies outside 0 to 1000"),
        (60.0, 50.1, "its kd lies outside 0 to 50"),
        (60.0, -0.1, "its kd lies outside 0 to 50"),
    ],
)
def test_the_last_gate_bounds_the_gains(kp: float, kd: float, words: str | None) -> None:
    gains = Gains(np.array([60.0] * 11 + [kp]), np.array([1.0] * 11 + [kd]))
    zeros = np.zeros(12)
    command = JointCommand(7, facts.DEFAULT_POSITION_RAD, zeros, zeros, gains, START_NS + 50 * MS)
    assert check_command(command, 6, START_NS) == words


# Ages ----------------------------------------------------------------------------------------------------------------


def test_ages_count_from_what_arrived_and_from_what_may_be_used(make_state: MakeState) -> None:
    usable = make_state(START_NS)
    memory = StateMemory(newest=usable, arrived_robot_stamp_ns=START_NS + 100 * MS)
    stop = check_age(memory, START_NS + 100 * MS, LIMITS)
    assert stop == Stop(StopReason.STATE_STALE, "", {"age_s": 0.1, "bound_s": 0.04})
    stop = check_age(memory, START_NS + 300 * MS, LIMITS)
    assert stop == Stop(StopReason.STATE_LOST, "", {"age_s": 0.2, "bound_s": 0.2})
    assert check_age(memory, START_NS + 40 * MS - 1, LIMITS) is None
    assert check_age(memory, START_NS + 40 * MS, LIMITS) is not None


def test_the_echo_counts_from_its_last_rise_or_from_the_start_of_control(make_state: MakeState) -> None:
    memory = StateMemory(newest=make_state(START_NS), echo_robot_stamp_ns=START_NS - 200 * MS)
    assert check_echo(memory, START_NS - 150 * MS + 1, LIMITS) is None
    stop = check_echo(memory, START_NS - 150 * MS, LIMITS)
    assert stop == Stop(StopReason.COMMAND_UNCONFIRMED, "", {"silent_s": 0.15, "bound_s": 0.15})
    stop = check_echo(memory, START_NS - 500 * MS, LIMITS)
    assert stop == Stop(StopReason.COMMAND_UNCONFIRMED, "", {"silent_s": 0.2, "bound_s": 0.15})


# Set-points ----------------------------------------------------------------------------------------------------------

POSE = facts.DEFAULT_POSITION_RAD


def moved(joint: int, by_rad: float) -> np.ndarray:
    request = POSE.copy()
    request[joint] += by_rad
    return request


@pytest.mark.parametrize("joint", range(12))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_step_is_cut_to_its_bound_joint_by_joint(joint: int, sign: float) -> None:
    limits = SafetyLimits(setpoint_step_rad=0.1)
    memory, limited, stop = limit_setpoint(SetpointMemory(POSE), moved(joint, sign * 0.1), STIFF, limits)
    assert not limited.cut.any()
    assert memory == SetpointMemory(memory.sent_rad)
    memory, limited, stop = limit_setpoint(SetpointMemory(POSE), moved(joint, sign * 0.11), STIFF, limits)
    assert stop is None
    np.testing.assert_allclose(limited.position_rad, moved(joint, sign * 0.1), atol=1e-15)
    assert limited.cut.tolist() == [j == joint for j in range(12)]
    assert (memory.step_ticks, memory.overshoot_ticks, memory.cut_ticks) == (1, 0, 1)
    assert memory.sent_rad is limited.position_rad


@pytest.mark.parametrize("joint", range(12))
@pytest.mark.parametrize("side", [-1, 1])
def test_a_request_beyond_a_stop_is_cut_to_the_stop(joint: int, side: int) -> None:
    stop_rad = (facts.POSITION_LOW_RAD if side < 0 else facts.POSITION_HIGH_RAD)[joint]
    for beyond_rad, overshoots in ((1e-9, 0), (0.999, 0), (1.001, 1)):
        request = POSE.copy()
        request[joint] = stop_rad + side * beyond_rad
        memory, limited, stop = limit_setpoint(SetpointMemory(), request, STIFF, LIMITS)
        assert stop is None
        assert limited.position_rad[joint] == stop_rad
        assert limited.cut.tolist() == [j == joint for j in range(12)]
        assert (memory.step_ticks, memory.overshoot_ticks, memory.cut_ticks) == (0, overshoots, 1)


@pytest.mark.parametrize(
    ("joint", "kp", "bound_rad"),
    # 45 N·m of a hip and 113.2 N·m of a knee, or 1 rad where that is more; nothing is softer than 1 N·m/rad.
    [(0, 60.0, 1.0), (0, 30.0, 1.5), (1, 30.0, 1.5), (2, 60.0, 1.8873), (2, 300.0, 1.0), (1, 0.0, 45.0)],
)
def test_a_request_may_ask_for_all_of_a_joints_torque_at_its_stop(joint: int, kp: float, bound_rad: float) -> None:
    before = SetpointMemory(None, overshoot_ticks=4)
    gains = np.where(np.arange(12) == joint, kp, 1000.0)
    for factor in (0.999, 1.001):
        request = POSE.copy()
        request[joint] = facts.POSITION_HIGH_RAD[joint] + factor * bound_rad
        request[9] = facts.POSITION_LOW_RAD[9] - 0.99
        _, limited, stop = limit_setpoint(before, request, gains, LIMITS)
        assert limited.position_rad[joint] == facts.POSITION_HIGH_RAD[joint]
        if factor < 1.0:
            assert stop is None
        else:
            values = {"beyond_rad": factor * bound_rad, "bound_rad": bound_rad}
            assert stop is not None
            assert (stop.detail, stop.values) == (facts.JOINT_NAMES[joint], pytest.approx(values, rel=1e-3))


def test_a_request_at_the_bound_of_overshoot_is_none() -> None:
    request = moved(3, 5.0)
    beyond_rad = float(request[3] - facts.POSITION_HIGH_RAD[3])
    for bound_rad, ticks in ((beyond_rad, 0), (float(np.nextafter(beyond_rad, 0.0)), 1)):
        limits = SafetyLimits(setpoint_overshoot_rad=bound_rad)
        assert limit_setpoint(SetpointMemory(), request, STIFF, limits)[0].overshoot_ticks == ticks


def test_the_first_request_may_lie_anywhere_within_the_stops() -> None:
    for request in (facts.POSITION_LOW_RAD, facts.POSITION_HIGH_RAD, POSE):
        memory, limited, stop = limit_setpoint(SetpointMemory(cut_ticks=3), request, STIFF, LIMITS)
        assert limited.position_rad is request
        assert memory.sent_rad is request
        assert (memory.step_ticks, memory.overshoot_ticks, memory.cut_ticks, stop) == (0, 0, 3, None)
        assert not limited.cut.any()


def test_a_set_point_at_the_stops_may_be_left_by_a_step_and_no_more() -> None:
    limits = SafetyLimits(setpoint_step_rad=0.2)
    sent = facts.POSITION_HIGH_RAD.copy()
    _, limited, _ = limit_setpoint(SetpointMemory(sent), facts.POSITION_LOW_RAD.copy(), STIFF, limits)
    np.testing.assert_allclose(limited.position_rad, np.maximum(sent - 0.2, facts.POSITION_LOW_RAD))
    _, limited, _ = limit_setpoint(SetpointMemory(sent), sent + 5.0, STIFF, limits)
    np.testing.assert_array_equal(limited.position_rad, sent)


def test_a_request_beyond_a_stop_that_lies_exactly_a_step_away_is_no_step() -> None:
    stop_rad = float(facts.POSITION_HIGH_RAD[3])
    limits = SafetyLimits(setpoint_step_rad=0.5)
    for sent_rad, steps in ((stop_rad - 0.5, 0), (stop_rad - 0.5000001, 1)):
        memory, _, _ = limit_setpoint(SetpointMemory(moved(3, sent_rad - POSE[3])), moved(3, 9.0), STIFF, limits)
        assert memory.step_ticks == steps


def test_counts_in_a_row_and_what_the_stops_tell() -> None:
    limits = SafetyLimits(setpoint_step_rad=0.1, setpoint_step_ticks=3, setpoint_overshoot_ticks=3)
    far = moved(5, -9.0)
    for ticks, is_stop in ((1, False), (2, True), (7, True)):
        before = SetpointMemory(POSE, step_ticks=ticks, cut_ticks=4)
        memory, _, stop = limit_setpoint(before, moved(3, 0.2), STIFF, limits)
        assert (memory.step_ticks, memory.cut_ticks) == (ticks + 1, 5)
        assert stop == (Stop(StopReason.SETPOINT_STEP, "fr_hx", {"bound_rad": 0.1}) if is_stop else None)
        before = SetpointMemory(None, overshoot_ticks=ticks)
        memory, _, stop = limit_setpoint(before, far, STIFF, limits)
        assert memory.overshoot_ticks == ticks + 1
        beyond_rad = facts.POSITION_LOW_RAD[5] - far[5]
        values: dict[str, Any] = {"beyond_rad": pytest.approx(beyond_rad), "bound_rad": 1.0}
        assert stop == (Stop(StopReason.SETPOINT_OVERSHOOT, "fr_kn", values) if is_stop else None)


def test_a_request_that_is_no_number_names_its_joints_and_changes_no_memory() -> None:
    request = POSE.copy()
    request[[0, 11]] = np.nan, -np.inf
    before = SetpointMemory(POSE + 0.01, step_ticks=2, overshoot_ticks=1, cut_ticks=7)
    memory, limited, stop = limit_setpoint(before, request, STIFF, LIMITS)
    assert memory is before
    assert limited.position_rad is before.sent_rad
    assert not limited.cut.any()
    assert stop == Stop(StopReason.POLICY_NOT_FINITE, "fl_hx, hr_kn")


# Slow state ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "stop"),
    [
        ({"host_stamp_ns": START_NS - 3000 * MS}, None),
        (
            {"host_stamp_ns": START_NS - 3001 * MS, "estopped": True},
            Stop(StopReason.LINK_LOST, "", {"age_s": 3.001, "bound_s": 3.0}),
        ),
        ({"battery_charge_percent": 8.0}, None),
        (
            {"battery_charge_percent": 7.5},
            Stop(StopReason.BATTERY_LOW, "", {"charge_percent": 7.5, "bound_percent": 8.0}),
        ),
        ({"motor_temperature_c": {"fl_kn": 75.0, "hr_hx": -10.0}}, None),
        (
            {"motor_temperature_c": {"fl_kn": 20.0, "hr_hx": 75.5}},
            Stop(StopReason.MOTOR_HOT, "hr_hx", {"temperature_c": 75.5, "bound_c": 75.0}),
        ),
        (
            {"system_faults": ("a", "critical: b", "critical: c")},
            Stop(StopReason.SYSTEM_FAULT, "critical: b, critical: c"),
        ),
        ({"behavior_faults": ("fall (1)", "x (2)")}, Stop(StopReason.BEHAVIOR_FAULT, "fall (1), x (2)")),
    ],
)
def test_the_slow_state_at_its_bounds(make_slow: MakeSlow, changes: dict[str, object], stop: Stop | None) -> None:
    assert check_slow_state(BatteryMemory(), make_slow(**changes), START_NS, LIMITS)[1] == stop


def test_of_several_causes_the_one_that_needs_most_is_told(make_slow: MakeSlow) -> None:
    worst: dict[str, object] = {
        "estopped": True,
        "behavior_faults": ("fall",),
        "motors_powered": False,
        "battery_charge_percent": 1.0,
        "motor_temperature_c": {"fl_kn": 99.0},
        "system_faults": ("critical: x",),
    }
    told = []
    for name, healthy in (
        ("estopped", False),
        ("behavior_faults", ()),
        ("motors_powered", True),
        ("battery_charge_percent", 50.0),
        ("motor_temperature_c", {}),
        ("system_faults", ()),
    ):
        _, stop = check_slow_state(BatteryMemory(), make_slow(**worst), START_NS, LIMITS)
        assert stop is not None
        told.append(stop.reason.label)
        worst[name] = healthy
    assert told == ["estopped", "behavior_fault", "motors_off", "battery_low", "motor_hot", "system_fault"]
    assert check_slow_state(BatteryMemory(), make_slow(**worst), START_NS, LIMITS)[1] is None


# The last gate -------------------------------------------------------------------------------------------------------


def command(**changes: object) -> JointCommand:
    zeros = np.zeros(12)
    fields: dict[str, object] = {
        "key": 7,
        "position_rad": POSE,
        "velocity_rad_s": zeros,
        "load_nm": zeros,
        "gains": Gains.policy(),
        "end_robot_stamp_ns": START_NS + 50 * MS,
    }
    return JointCommand(**{**fields, **changes})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("ahead_ns", "is_fine"), [(-1, False), (0, False), (1, True), (100 * MS, True), (100 * MS + 1000, False)]
)
def test_end_times_at_the_gate(ahead_ns: int, is_fine: bool) -> None:
    wrong = check_command(command(end_robot_stamp_ns=START_NS + ahead_ns), 6, START_NS)
    assert (wrong is None) == is_fine


@pytest.mark.parametrize(("last_key", "is_fine"), [(6, True), (7, False), (8, False), (0, True)])
def test_keys_at_the_gate(last_key: int, is_fine: bool) -> None:
    assert (check_command(command(), last_key, START_NS) is None) == is_fine


@pytest.mark.parametrize("joint", range(12))
@pytest.mark.parametrize("side", [-1, 1])
def test_stops_at_the_gate(joint: int, side: int) -> None:
    stops = facts.POSITION_LOW_RAD if side < 0 else facts.POSITION_HIGH_RAD
    position = POSE.copy()
    position[joint] = stops[joint]
    assert check_command(command(position_rad=position), 6, START_NS) is None
    position[joint] += side * 1e-12
    assert check_command(command(position_rad=position), 6, START_NS) is not None


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_no_number_passes_the_gate(value: float) -> None:
    bad = np.zeros(12)
    bad[11] = value
    good = np.full(12, 60.0)
    changes: list[dict[str, object]] = [
        {"position_rad": bad},
        {"velocity_rad_s": bad},
        {"load_nm": bad},
        {"gains": Gains(bad, good)},
        {"gains": Gains(good, bad)},
    ]
    for change in changes:
        assert check_command(command(**change), 6, START_NS) == "it holds a value that is no number"


def test_a_set_point_says_whether_anything_was_cut() -> None:
    pose = np.zeros(12)
    assert LimitedSetpoint(pose).is_cut is False
    assert LimitedSetpoint(pose, np.zeros(12, dtype=np.bool_)).is_cut is False
    assert LimitedSetpoint(pose, np.arange(12) == 3).is_cut is True
    with pytest.raises(ValueError, match="read-only"):
        LimitedSetpoint(pose).cut[0] = True


def test_loads_of_both_laws_are_blended_by_their_weights() -> None:
    hold = Setpoint(np.zeros(12), np.full(12, 8.0), Gains.policy())
    policy = Setpoint(np.zeros(12), np.full(12, -4.0), Gains.policy())
    np.testing.assert_allclose(blend(hold, policy, 0.25).load_nm, 0.25 * 8.0 - 0.75 * 4.0)


def test_the_way_back_takes_the_time_that_it_is_given() -> None:
    pose, other = np.zeros(12), np.full(12, 0.1)
    config = HandoverConfig(ramp_in_s=4.0, ramp_out_s=4.0)
    hold = hold_setpoint(pose, pose)
    for mode, share in ((Mode.RAMPING_IN, 0.25), (Mode.RAMPING_OUT, 0.25)):
        asked = asked_setpoint(
            mode,
            1.0,
            hold=hold,
            policy_rad=other,
            policy_gains=Gains.policy(),
            measured_rad=pose,
            config=config,
        )
        weight = hold_weight_in(share) if mode is Mode.RAMPING_IN else hold_weight_out(share)
        np.testing.assert_array_equal(
            asked.position_rad, blend(hold, policy_setpoint(other, Gains.policy()), weight).position_rad
        )


def test_exit_codes_of_the_service_stay() -> None:
    assert StopReason.OPERATOR_GONE.exit_code == 13
    assert StopReason.SERVICE_LOST.exit_code == 14


def test_the_joint_that_goes_furthest_beyond_what_it_may_is_named() -> None:
    """At 20 N·m/rad a hip of 45 N·m may ask for 2.25 rad beyond its stop, a stiff joint for 1.0."""
    soft = STIFF.copy()
    soft[3] = 20.0
    request = facts.DEFAULT_POSITION_RAD.copy()
    request[3], request[5] = facts.POSITION_HIGH_RAD[3] + 2.2, facts.POSITION_HIGH_RAD[5] + 1.1
    before = SetpointMemory(None, overshoot_ticks=LIMITS.setpoint_overshoot_ticks)
    _, _, stop = limit_setpoint(before, request, soft, LIMITS)
    assert stop is not None
    assert (stop.reason, stop.detail) == (StopReason.SETPOINT_OVERSHOOT, "fr_kn")


@pytest.mark.parametrize(("before", "after", "leaps"), [(90, 80, 0), (90, 79.9, 1), (20, 30.1, 1)])
def test_the_charge_of_a_battery_does_not_leap(make_slow: MakeSlow, before: float, after: float, leaps: int) -> None:
    memory, stop = watch(BatteryMemory(), make_slow(START_NS, battery_charge_percent=float(before)), START_NS, 3.0)
    assert stop is None
    later_ns = START_NS + 3001 * MS
    later, stop = watch(memory, make_slow(later_ns, battery_charge_percent=float(after)), later_ns, 3.0)
    assert later.charge_percent == pytest.approx(before if leaps else after)
    assert (stop is not None) == bool(leaps)
    if stop is not None:
        words = f"charge, which leaps from {before} to {after:.0f} %"
        assert (stop.reason, stop.detail) == (StopReason.BATTERY_UNKNOWN, words)


def test_temperatures_that_are_no_longer_reported_are_unknown(make_slow: MakeSlow) -> None:
    all_of_them = make_slow(START_NS, motor_temperature_c={"fl_hx": 30.0, "fl_hy": 31.0}, battery_temperature_c=(25.0,))
    memory, stop = watch(BatteryMemory(), all_of_them, START_NS, 3.0)
    assert (memory.temperatures, stop) == (3, None)
    assert watch(memory, all_of_them, START_NS, 3.0)[1] is None
    fewer = make_slow(START_NS, motor_temperature_c={"fl_hx": 30.0}, battery_temperature_c=())
    assert watch(memory, fewer, START_NS, 3.0) == (memory, None)
    values = {"unknown_s": 4.0, "bound_s": 3.0}
    stop = watch(memory, fewer, START_NS + 4000 * MS, 3.0)[1]
    assert stop == Stop(StopReason.BATTERY_UNKNOWN, "2 temperatures", values)
    assert watch(memory._replace(temperatures=1), fewer, START_NS + 4000 * MS, 3.0)[1] is None
