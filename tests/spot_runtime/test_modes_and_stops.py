"""The mode machine and the table of stops."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from spot_runtime.config import HandoverConfig
from spot_runtime.modes import Mode, ModeInputs, next_mode
from spot_runtime.stops import Reaction, Stop, StopReason, stops_table, stronger

CONFIG = HandoverConfig()
HAND_BACK, DAMP, EXPIRE = Stop(StopReason.COMPLETED), Stop(StopReason.TILT), Stop(StopReason.LEASE_LOST)
REASONS = st.sampled_from(StopReason)


def walk(mode: Mode, *inputs: ModeInputs) -> list[Mode]:
    modes = []
    for each in inputs:
        mode = next_mode(mode, each, CONFIG)
        modes.append(mode)
    return modes


def test_the_way_of_a_good_run() -> None:
    late = 100.0
    assert walk(
        Mode.READY,
        ModeInputs(0.0),
        ModeInputs(0.3, is_activation_asked=True),
        ModeInputs(late),
        ModeInputs(0.1, is_active=True),
        ModeInputs(CONFIG.ramp_in_s - 0.001),
        ModeInputs(CONFIG.ramp_in_s),
        ModeInputs(late),
        ModeInputs(late, stop=HAND_BACK),
        ModeInputs(CONFIG.soft_stop_s, stop=HAND_BACK),
        ModeInputs(CONFIG.soft_stop_s + CONFIG.soft_stop_settle_s, stop=HAND_BACK),
        ModeInputs(CONFIG.ramp_out_s, stop=HAND_BACK),
        ModeInputs(late, stop=HAND_BACK),
    ) == [
        Mode.READY,
        Mode.ACTIVATING,
        Mode.ACTIVATING,
        Mode.RAMPING_IN,
        Mode.RAMPING_IN,
        Mode.ACTIVE,
        Mode.ACTIVE,
        Mode.SOFT_STOP,
        Mode.SOFT_STOP,
        Mode.RAMPING_OUT,
        Mode.STANDING,
        Mode.STANDING,
    ]


@pytest.mark.parametrize("mode", [m for m in Mode if m.sends and m is not Mode.DAMPING])
def test_from_every_mode_that_sends_damping_and_silence_are_one_step_away(mode: Mode) -> None:
    assert next_mode(mode, ModeInputs(0.0, stop=DAMP), CONFIG) is Mode.DAMPING
    assert next_mode(mode, ModeInputs(0.0, stop=EXPIRE), CONFIG) is Mode.RELEASED


@given(REASONS)
def test_before_joint_control_every_stop_means_that_nothing_is_ever_sent(reason: StopReason) -> None:
    assert next_mode(Mode.READY, ModeInputs(0.0, stop=Stop(reason)), CONFIG) is Mode.RELEASED


@given(st.floats(0.0, 1e6), st.one_of(st.none(), REASONS), st.booleans(), st.booleans())
def test_nothing_leads_back_from_release(
    in_mode_s: float, reason: StopReason | None, is_asked: bool, is_active: bool
) -> None:
    stop = None if reason is None else Stop(reason)
    assert next_mode(Mode.RELEASED, ModeInputs(in_mode_s, stop, is_asked, is_active), CONFIG) is Mode.RELEASED


@given(st.floats(0.0, 1e6), REASONS, st.booleans())
def test_damping_ends_in_release_alone(in_mode_s: float, reason: StopReason, is_active: bool) -> None:
    following = next_mode(Mode.DAMPING, ModeInputs(in_mode_s, Stop(reason), False, is_active), CONFIG)
    is_over = in_mode_s >= CONFIG.damping_s or reason.reaction is Reaction.EXPIRE
    if reason.reaction is Reaction.HAND_BACK and in_mode_s < CONFIG.damping_s:
        assert following is Mode.DAMPING
    else:
        assert following is (Mode.RELEASED if is_over else Mode.DAMPING)


@given(st.sampled_from([m for m in Mode if m.sends]), REASONS)
def test_a_stopped_run_never_becomes_active_again(mode: Mode, reason: StopReason) -> None:
    for in_mode_s in (0.0, 1.0, 10.0, 100.0) * 5:
        mode_after = next_mode(mode, ModeInputs(in_mode_s, Stop(reason), True, True), CONFIG)
        assert mode_after is not Mode.ACTIVE or mode is Mode.ACTIVE
        assert mode_after is not Mode.RAMPING_IN
        mode = mode_after
    assert mode in (Mode.STANDING, Mode.RELEASED)


def test_a_stronger_stop_replaces_a_weaker_one_and_no_other() -> None:
    assert stronger(None, HAND_BACK) is HAND_BACK
    assert stronger(HAND_BACK, DAMP) is DAMP
    assert stronger(DAMP, HAND_BACK) is DAMP
    assert stronger(DAMP, Stop(StopReason.STATE_STALE)) is DAMP
    assert stronger(EXPIRE, DAMP) is EXPIRE
    assert stronger(DAMP, None) is DAMP


def test_every_stop_but_a_completed_run_has_an_exit_code_of_its_own() -> None:
    codes = [reason.exit_code for reason in StopReason if reason.exit_code]
    assert len(codes) == len(set(codes))
    assert {r for r in StopReason if r.exit_code == 0} == {StopReason.COMPLETED, StopReason.RECORDING_OVER}
    assert all(0 < code < 126 for code in codes)


def test_a_stop_says_what_happened_with_figures_and_what_to_do() -> None:
    stop = Stop(StopReason.JOINT_VELOCITY, "fr_kn", {"velocity_rad_s": 41.0, "bound_rad_s": 40.0})
    assert stop.sentence() == (
        "a joint moves too fast: fr_kn (velocity_rad_s = 41, bound_rad_s = 40); check policy and ground"
    )


def test_the_table_has_a_row_for_every_reason() -> None:
    rows = stops_table().splitlines()
    assert len(rows) == 2 + len(StopReason)
    assert all(f"`{reason.label}` | {reason.exit_code} |" in stops_table() for reason in StopReason)
