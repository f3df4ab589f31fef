"""The mode machine and the table of stops."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from spot_log.format.records import Severity
from spot_runtime.config import HandoverConfig
from spot_runtime.control.modes import TAKE_HOLD_S, Mode, ModeInputs, next_mode
from spot_runtime.control.set_point import FIRST_STIFFNESS
from spot_runtime.session.robot_session import control_end
from spot_runtime.session.summary import Outcome
from spot_runtime.stops import Ending, Reaction, Stop, StopReason, ending_after

CONFIG = HandoverConfig()
HAND_BACK, DAMP, EXPIRE, ESTOP = Reaction
REACTIONS = st.sampled_from(Reaction)


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
        ModeInputs(0.1, held_s=math.nextafter(TAKE_HOLD_S, 0.0)),
        ModeInputs(0.1, held_s=TAKE_HOLD_S),
        ModeInputs(CONFIG.ramp_in_s - 0.001),
        ModeInputs(CONFIG.ramp_in_s),
        ModeInputs(late),
        ModeInputs(late, reaction=HAND_BACK),
        ModeInputs(CONFIG.soft_stop_s, reaction=HAND_BACK),
        ModeInputs(CONFIG.soft_stop_s + CONFIG.soft_stop_settle_s, reaction=HAND_BACK),
        ModeInputs(CONFIG.ramp_out_s, reaction=HAND_BACK),
        ModeInputs(late, reaction=HAND_BACK),
    ) == [
        Mode.READY,
        Mode.ACTIVATING,
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
    assert next_mode(mode, ModeInputs(0.0, reaction=DAMP), CONFIG) is Mode.DAMPING
    assert next_mode(mode, ModeInputs(0.0, reaction=ESTOP), CONFIG) is Mode.DAMPING
    assert next_mode(mode, ModeInputs(0.0, reaction=EXPIRE), CONFIG) is Mode.RELEASED


def test_what_each_mode_does() -> None:
    assert {mode.value for mode in Mode if not mode.sends} == {"ready", "released"}
    assert {mode.value for mode in Mode if mode.runs_policy} == {"ramping_in", "active", "soft_stop", "ramping_out"}
    assert all(mode.sends in (True, False) and mode.runs_policy in (True, False) for mode in Mode)


@given(REACTIONS)
def test_before_joint_control_every_stop_means_that_nothing_is_ever_sent(reaction: Reaction) -> None:
    assert next_mode(Mode.READY, ModeInputs(0.0, reaction), CONFIG) is Mode.RELEASED


@given(st.floats(0.0, 1e6), st.one_of(st.none(), REACTIONS), st.booleans(), st.floats(0.0, 1e6))
def test_nothing_leads_back_from_release(
    in_mode_s: float, reaction: Reaction | None, is_asked: bool, held_s: float
) -> None:
    assert next_mode(Mode.RELEASED, ModeInputs(in_mode_s, reaction, is_asked, held_s), CONFIG) is Mode.RELEASED


@given(st.floats(0.0, 1e6), REACTIONS, st.floats(0.0, 1e6))
def test_damping_ends_in_release_alone(in_mode_s: float, reaction: Reaction, held_s: float) -> None:
    following = next_mode(Mode.DAMPING, ModeInputs(in_mode_s, reaction, False, held_s), CONFIG)
    is_over = in_mode_s >= CONFIG.damping_s or reaction is EXPIRE
    assert following is (Mode.RELEASED if is_over else Mode.DAMPING)


def test_damping_ends_at_its_time() -> None:
    for in_mode_s, mode in ((CONFIG.damping_s, Mode.RELEASED), (math.nextafter(CONFIG.damping_s, 0.0), Mode.DAMPING)):
        assert next_mode(Mode.DAMPING, ModeInputs(in_mode_s, DAMP), CONFIG) is mode


@given(st.sampled_from([m for m in Mode if m.sends]), REACTIONS)
def test_a_stopped_run_never_becomes_active_again(mode: Mode, reaction: Reaction) -> None:
    for in_mode_s in (0.0, 1.0, 10.0, 100.0) * 5:
        mode_after = next_mode(mode, ModeInputs(in_mode_s, reaction, True, 100.0), CONFIG)
        assert mode_after is not Mode.ACTIVE or mode is Mode.ACTIVE
        assert mode_after is not Mode.RAMPING_IN
        mode = mode_after
    assert mode in (Mode.STANDING, Mode.RELEASED)


def test_the_first_thing_that_goes_wrong_stays_the_cause_and_the_reaction_only_grows() -> None:
    done, tilt, stale, lost = (
        Stop(StopReason.COMPLETED),
        Stop(StopReason.TILT),
        Stop(StopReason.STATE_STALE),
        Stop(StopReason.STATE_LOST),
    )
    ending = ending_after(None, done)
    assert (ending.cause, ending.reaction) == (done, HAND_BACK)
    ending = ending_after(ending, tilt)
    assert (ending.cause, ending.reaction) == (tilt, DAMP)
    assert ending_after(ending, stale) is ending
    assert ending_after(ending, done) is ending
    ending = ending_after(ending, lost)
    assert (ending.cause, ending.reaction) == (tilt, EXPIRE)
    assert ending_after(ending, stale) is ending


def test_a_body_that_tilts_later_is_kept_beside_the_cause() -> None:
    stale, tilt, later, done = (
        Stop(StopReason.STATE_STALE),
        Stop(StopReason.TILT, values={"tilt_rad": 0.8}),
        Stop(StopReason.TILT, values={"tilt_rad": 1.2}),
        Stop(StopReason.COMPLETED),
    )
    ending = ending_after(ending_after(None, stale), tilt)
    assert ending == Ending(stale, DAMP, later=(tilt,))
    assert ending_after(ending, later) is ending
    assert ending_after(ending_after(None, Stop(StopReason.STATE_LOST)), tilt).reaction is EXPIRE
    lost = ending_after(ending, Stop(StopReason.STATE_LOST))
    assert lost == Ending(stale, EXPIRE, later=(tilt,))
    # What gave way is no cause beside which anything is kept, and a tilt that is the cause is not told twice.
    assert ending_after(ending_after(None, done), tilt) == Ending(tilt, DAMP)
    assert ending_after(Ending(tilt, DAMP), later) == Ending(tilt, DAMP)


def test_an_e_stop_is_told_whatever_came_before() -> None:
    empty, tilt, pressed = (
        Stop(reason) for reason in (StopReason.BATTERY_LOW, StopReason.TILT, StopReason.OPERATOR_ESTOP)
    )
    ending = ending_after(ending_after(None, empty), pressed)
    assert ending == Ending(empty, ESTOP, later=(pressed,))
    assert ending_after(ending, pressed) is ending
    assert ending_after(ending, tilt) == Ending(empty, ESTOP, later=(pressed, tilt))
    end = control_end(ending)
    outcome = Outcome().after_stop(end.stop)
    for stop in end.later:
        outcome = outcome.after_stop(stop)
    assert outcome.label == "battery_low"
    assert "then the operator pressed the e-stop" in outcome.sentence


def test_no_final_word_says_what_did_not_happen() -> None:
    assert Stop(StopReason.OPERATOR_DAMP).sentence().startswith("damping was asked for;")
    for reason in (StopReason.STATE_STALE, StopReason.CLOCK_JUMPED):
        assert "in real time, give a fake robot --lock-step" in Stop(reason).sentence()


def test_only_an_end_that_somebody_wanted_gives_way() -> None:
    done, asked, twice, empty, silent = (
        Stop(reason)
        for reason in (
            StopReason.COMPLETED,
            StopReason.OPERATOR_STOP,
            StopReason.OPERATOR_DAMP,
            StopReason.BATTERY_LOW,
            StopReason.STATE_STALE,
        )
    )
    assert ending_after(ending_after(None, empty), twice) == Ending(empty, DAMP)
    assert ending_after(ending_after(None, empty), silent) == Ending(empty, DAMP)
    assert ending_after(ending_after(None, done), empty) == Ending(empty, HAND_BACK)
    assert ending_after(ending_after(None, asked), empty) == Ending(empty, HAND_BACK)
    assert ending_after(ending_after(None, asked), twice) == Ending(twice, DAMP)
    assert ending_after(ending_after(None, twice), silent) == Ending(twice, DAMP)
    wanted = ending_after(None, done)
    assert ending_after(wanted, asked) is wanted
    wishes = {"completed", "operator_stop", "operator_damp", "operator_estop"}
    assert {reason.label for reason in StopReason if not reason.is_fault} == wishes


def test_every_stop_but_a_completed_run_has_an_exit_code_of_its_own() -> None:
    codes = [reason.exit_code for reason in StopReason if reason.exit_code]
    assert len(codes) == len(set(codes))
    assert {r for r in StopReason if r.exit_code == 0} == {StopReason.COMPLETED}
    assert all(0 < code < 126 for code in codes)


TABLE = {
    # reason: reaction, exit code, urgent
    "completed": (HAND_BACK, 0, False),
    "operator_stop": (HAND_BACK, 10, False),
    "operator_damp": (DAMP, 11, False),
    "operator_estop": (ESTOP, 12, False),
    "operator_gone": (HAND_BACK, 13, False),
    "service_lost": (HAND_BACK, 14, False),
    "unguarded": (HAND_BACK, 15, False),
    "state_stale": (DAMP, 20, False),
    "state_lost": (EXPIRE, 21, False),
    "state_not_finite": (DAMP, 22, False),
    "state_frozen": (DAMP, 23, False),
    "state_rejected": (DAMP, 24, False),
    "state_attitude": (DAMP, 25, False),
    "tilt": (DAMP, 26, False),
    "joint_velocity": (DAMP, 27, False),
    "joint_position": (DAMP, 28, False),
    "arm_lost": (DAMP, 54, False),
    "arm_away": (DAMP, 55, False),
    "body_low": (DAMP, 29, False),
    "policy_not_finite": (DAMP, 30, False),
    "setpoint_step": (DAMP, 31, False),
    "setpoint_overshoot": (DAMP, 32, False),
    "ticks_skipped": (DAMP, 33, False),
    "signal_frozen": (DAMP, 34, False),
    "signals_contradict": (DAMP, 35, False),
    "signal_out_of_range": (DAMP, 37, False),
    "policy_out_of_bounds": (DAMP, 38, False),
    "position_refused": (HAND_BACK, 39, False),
    "command_unconfirmed": (DAMP, 40, False),
    "command_refused": (EXPIRE, 41, False),
    "activation_failed": (EXPIRE, 42, False),
    "clock_jumped": (DAMP, 43, False),
    "process_paused": (DAMP, 16, False),
    "lease_lost": (EXPIRE, 44, False),
    "estopped": (EXPIRE, 45, False),
    "motors_off": (EXPIRE, 46, False),
    "behavior_fault": (DAMP, 47, False),
    "link_lost": (DAMP, 48, False),
    "hand_back_failed": (DAMP, 49, False),
    "battery_low": (HAND_BACK, 50, True),
    "motor_hot": (HAND_BACK, 51, True),
    "system_fault": (HAND_BACK, 52, True),
    "battery_unknown": (HAND_BACK, 53, False),
    "log_failed": (HAND_BACK, 60, False),
    "computer_short": (DAMP, 61, False),
    "internal_error": (DAMP, 70, False),
}
"""What each reason does: changed on purpose alone."""


def test_every_reason_does_what_the_table_says() -> None:
    told = {r.label: (r.reaction, r.exit_code, r.is_urgent) for r in StopReason}
    assert told == TABLE
    assert [r.level for r in (HAND_BACK, DAMP, EXPIRE, ESTOP)] == [0, 1, 2, 3]


def test_a_stop_says_what_happened_with_figures_and_what_to_do() -> None:
    stop = Stop(StopReason.JOINT_VELOCITY, "fr_kn", {"velocity_rad_s": 41.0, "bound_rad_s": 40.0})
    assert stop.sentence() == (
        "a joint is measured too fast: fr_kn (velocity_rad_s = 41, bound_rad_s = 40); check policy, ground and sensors"
    )


@pytest.mark.parametrize(
    ("reason", "name", "severity"),
    [
        (StopReason.COMPLETED, "completed", Severity.INFO),
        (StopReason.OPERATOR_STOP, "stop", Severity.INFO),
        (StopReason.OPERATOR_DAMP, "stop", Severity.ERROR),
        (StopReason.OPERATOR_ESTOP, "stop", Severity.ERROR),
        (StopReason.TILT, "stop", Severity.ERROR),
    ],
)
def test_an_end_that_an_operator_wanted_is_no_error(reason: StopReason, name: str, severity: Severity) -> None:
    event = Stop(reason).event_name
    assert (event.label, event.severity) == (name, severity)


def test_the_operator_is_told_how_to_begin_again() -> None:
    assert "'spot-rl ctl arm'" in Stop(StopReason.OPERATOR_STOP).sentence()


def test_joint_control_takes_hold_by_an_eighth_a_policy_period() -> None:
    rise = (1.0 / FIRST_STIFFNESS) ** (0.02 / TAKE_HOLD_S)
    assert rise == pytest.approx(1.0 + 1.0 / 8.0, abs=0.01)
