"""The loop on a robot written by hand: a good run, and every way in which it may end."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from spot_log.write.sink import MemorySink
from spot_model.io.velocity_sequence import VelocitySequence, Waypoint, standing_sequence
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.state import Gains, RobotState, SlowState
from spot_runtime.config import RunConfig
from spot_runtime.control.loop import ControlLoop
from spot_runtime.control.modes import TAKE_HOLD_S, Mode
from spot_runtime.hal.base import JointControl
from spot_runtime.sources import Wanted
from spot_runtime.stops import Stop, StopReason
from spot_tools.sources import ScriptedSource
from tests.spot_runtime.conftest import STAND_LOAD_NM

MS = 1_000_000
CONFIG = RunConfig()


def make_loop(
    robot: Any, policy: Policy, *, sequence: VelocitySequence | None = None, config: RunConfig = CONFIG
) -> tuple[ControlLoop, MemorySink]:
    sink = MemorySink()
    source = ScriptedSource(sequence or standing_sequence(2.0))
    return ControlLoop(robot, policy, source, config, sink, wall_s=lambda: 0.0), sink


def drive(loop: ControlLoop, cycles: int = 5000) -> None:
    for _ in range(cycles):
        if loop.is_done:
            return
        loop.cycle()
    raise AssertionError(f"the loop is still {loop.mode.value} after {cycles} cycles")


def drive_until(loop: ControlLoop, mode: Mode) -> None:
    for _ in range(5000):
        if loop.mode is mode:
            return
        loop.cycle()
    raise AssertionError(f"the loop never became {mode.value}")


def modes_of(sink: MemorySink) -> list[str]:
    return [event.text.split(" → ")[1] for event in sink.events if event.name == "mode"]


# A good run ----------------------------------------------------------------------------------------------------------


def test_a_good_run_from_stand_to_stand(robot: Any, zero_policy: Policy) -> None:
    loop, sink = make_loop(robot, zero_policy)
    drive(loop)
    assert modes_of(sink) == ["activating", "ramping_in", "active", "soft_stop", "ramping_out", "standing"]
    assert loop.stop is not None
    assert loop.stop.reason is StopReason.COMPLETED
    assert robot.calls == ["begin_joint_control", "end_joint_control"]
    assert sink.events[-2].name == "mode"


def test_the_first_set_point_is_the_measured_pose_held_softly_with_the_measured_load(
    robot: Any, zero_policy: Policy
) -> None:
    robot.activates = False
    loop, _ = make_loop(robot, zero_policy)
    drive_until(loop, Mode.ACTIVATING)
    first = robot.sent[0]
    np.testing.assert_allclose(first.position_rad, facts.DEFAULT_POSITION_RAD, atol=1e-5)
    np.testing.assert_allclose(first.load_nm, STAND_LOAD_NM)
    np.testing.assert_allclose(first.gains.kp_nm_per_rad, 0.1 * Gains.stand().kp_nm_per_rad)
    # Nothing becomes firmer before the robot confirms that these commands drive its joints.
    for _ in range(50):
        loop.cycle()
    assert loop.mode is Mode.ACTIVATING
    np.testing.assert_allclose(robot.sent[-1].gains.kp_nm_per_rad, 0.1 * Gains.stand().kp_nm_per_rad)


@pytest.mark.parametrize(("swings_s", "outcome"), [(0.7, None), (1.5, StopReason.SIGNALS_CONTRADICT)])
def test_a_body_that_still_swings_is_taken_over_once_it_rests_and_refused_if_it_does_not(
    robot: Any, zero_policy: Policy, swings_s: float, outcome: StopReason | None
) -> None:
    begin_ns = robot.now_ns
    still = np.zeros(3)

    def swinging(state: RobotState) -> list[RobotState]:
        is_over = state.robot_stamp_ns - begin_ns > swings_s * 1e9
        speed = still if is_over else np.array([0.0, 0.5, 0.0])
        load = state.load_nm if is_over else 1.3 * state.load_nm
        return [replace(state, linear_vel_of_body_in_odom_m_s=speed, load_nm=load)]

    robot.mutate = swinging
    loop, _ = make_loop(robot, zero_policy)
    while loop.mode is Mode.READY:
        loop.cycle()
    if outcome is not None:
        assert (loop.mode, loop.stop and loop.stop.reason) == (Mode.RELEASED, outcome)
        assert not robot.sent
        return
    assert loop.mode is Mode.ACTIVATING
    # What the joints carried meanwhile is no part of the feed-forward torque.
    np.testing.assert_allclose(robot.sent[0].load_nm, STAND_LOAD_NM, rtol=0.05)
    assert (robot.now_ns - begin_ns) / 1e9 > swings_s + 0.9 * CONFIG.handover.settle_s


def test_stiffness_rises_from_the_robots_confirmation_to_the_stands_within_the_time_of_taking_hold(
    robot: Any, zero_policy: Policy
) -> None:
    robot.activates = False
    loop, _ = make_loop(robot, zero_policy)
    drive_until(loop, Mode.ACTIVATING)
    for _ in range(20):
        loop.cycle()
    begin_ns, robot.control, first = robot.now_ns, JointControl.ACTIVE, len(robot.sent)
    drive_until(loop, Mode.RAMPING_IN)
    assert (robot.now_ns - begin_ns) / 1e9 == pytest.approx(TAKE_HOLD_S, abs=0.0061)
    shares = np.array([command.gains.kp_nm_per_rad / Gains.stand().kp_nm_per_rad for command in robot.sent[first:]])
    assert (np.diff(shares, axis=0) >= 0.0).all()
    # A command is as stiff as at the policy's last tick: 20 ms of 400.
    assert (shares[1:] / shares[:-1]).max() < 1.0 / 0.1**0.055
    assert shares[-1].min() > 0.1**0.06


def test_a_pose_that_is_not_held_firmly_yet_does_not_become_firmer_as_it_is_handed_back(
    robot: Any, zero_policy: Policy
) -> None:
    loop, sink = make_loop(robot, zero_policy)
    robot.takes_back = False
    drive_until(loop, Mode.ACTIVATING)
    for _ in range(60):
        loop.cycle()
    soft = robot.sent[-1].gains.kp_nm_per_rad
    robot.waiting.append(Stop(StopReason.MOTOR_HOT))
    drive_until(loop, Mode.STANDING)
    for _ in range(30):
        loop.cycle()
    assert modes_of(sink) == ["activating", "standing"]
    np.testing.assert_allclose(robot.sent[-1].gains.kp_nm_per_rad, soft, rtol=0.13)
    assert (soft < 0.5 * Gains.stand().kp_nm_per_rad).all()


def test_every_command_keeps_the_invariants(robot: Any, zero_policy: Policy) -> None:
    loop, sink = make_loop(robot, zero_policy)
    drive(loop)
    keys = [command.key for command in robot.sent]
    assert keys == list(range(1, len(keys) + 1))
    for command, now_ns in zip(robot.sent, robot.sent_at_ns, strict=True):
        assert command.end_robot_stamp_ns - now_ns == 50 * MS
        assert (command.position_rad >= facts.POSITION_LOW_RAD).all()
        assert (command.position_rad <= facts.POSITION_HIGH_RAD).all()
        assert not command.velocity_rad_s.any()
    assert [record.command for record in sink.commands] == robot.sent


def test_commands_change_smoothly_during_the_hand_over(robot: Any, make_policy: Callable[..., Policy]) -> None:
    """The torque at the measured pose moves by less than 2 N·m from one command to the next, all the way."""
    policy = make_policy(bias=np.tile([0.2, -0.5, -0.8], 4))
    loop, _ = make_loop(robot, policy)
    drive(loop)
    pose = facts.DEFAULT_POSITION_RAD
    torques = np.array([c.gains.kp_nm_per_rad * (c.position_rad - pose) + c.load_nm for c in robot.sent])
    assert np.abs(np.diff(torques, axis=0)).max() < 2.0
    assert np.abs(torques[-1] - torques[0]).max() < 0.1


def test_the_policy_alone_drives_in_the_active_mode(robot: Any, make_policy: Callable[..., Policy]) -> None:
    policy = make_policy(bias=np.full(12, 0.5))
    loop, _ = make_loop(robot, policy)
    drive_until(loop, Mode.ACTIVE)
    for _ in range(10):
        loop.cycle()
    last = robot.sent[-1]
    np.testing.assert_allclose(last.position_rad, facts.DEFAULT_POSITION_RAD + 0.2 * 0.5, atol=1e-7)
    np.testing.assert_array_equal(last.gains.kp_nm_per_rad, np.full(12, 60.0))
    np.testing.assert_array_equal(last.gains.kd_nm_s_per_rad, np.full(12, 1.5))
    assert not last.load_nm.any()


def test_the_policy_ticks_at_50_hz_and_every_state_is_answered(robot: Any, zero_policy: Policy) -> None:
    loop, sink = make_loop(robot, zero_policy, sequence=standing_sequence(10.0))
    drive(loop, 7_500)
    ticks = [t for t in sink.ticks if t.mode == "active"]
    span_s = (ticks[-1].robot_stamp_ns - ticks[0].robot_stamp_ns) / 1e9
    assert (len(ticks) - 1) / span_s == pytest.approx(50.0, abs=0.02)
    assert {t.skipped for t in sink.ticks} == {0}
    gaps_ns = np.diff(robot.sent_at_ns)
    assert gaps_ns.max() == 3 * MS


def test_velocity_commands_reach_the_policy_within_its_range(robot: Any, zero_policy: Policy) -> None:
    too_fast = VelocitySequence(name="f", duration_s=1.0, waypoints=(Waypoint(time_s=0.0, v_x_m_s=9.0, v_y_m_s=0.3),))
    loop, sink = make_loop(robot, zero_policy, sequence=too_fast)
    drive(loop)
    active = [t.velocity_command.tolist() for t in sink.ticks if t.mode == "active"]
    assert active[1:-1] == [[1.5, 0.3, 0.0]] * (len(active) - 2)
    fading = [t.velocity_command[0] for t in sink.ticks if t.mode == "soft_stop"]
    assert fading == sorted(fading, reverse=True)
    assert fading[-1] == 0.0
    assert "command_clipped" in [e.name for e in sink.events]


# Ways to end ---------------------------------------------------------------------------------------------------------


def stopped_by(
    robot: Any, policy: Policy, mutate: Callable[[RobotState], list[RobotState]], cycles: int = 400
) -> tuple[ControlLoop, MemorySink]:
    """Drive to the active mode, then change the states, and drive to the end."""
    loop, sink = make_loop(robot, policy, sequence=standing_sequence(100.0))
    drive_until(loop, Mode.ACTIVE)
    robot.mutate = mutate
    for _ in range(cycles):
        loop.cycle()
    drive(loop)
    return loop, sink


def nan_state(state: RobotState) -> list[RobotState]:
    return [replace(state, position_rad=np.full(12, np.nan))]


def on_its_side(state: RobotState) -> list[RobotState]:
    return [replace(state, odom_from_body_wxyz=np.array([0.7, 0.714142842854285, 0.0, 0.0]))]


def tipping(rad_s: float) -> Callable[[RobotState], list[RobotState]]:
    angles = itertools.count(0.003 * rad_s, 0.003 * rad_s)

    def mutate(state: RobotState) -> list[RobotState]:
        half = 0.5 * next(angles)
        return [replace(state, odom_from_body_wxyz=np.array([np.cos(half), np.sin(half), 0.0, 0.0]))]

    return mutate


def frozen(state: RobotState) -> list[RobotState]:
    return [replace(state, position_rad=facts.DEFAULT_POSITION_RAD)]


def back_dated(state: RobotState) -> list[RobotState]:
    return [replace(state, robot_stamp_ns=1_700_000_000_000_000_000)]


def from_the_future(state: RobotState) -> list[RobotState]:
    return [replace(state, robot_stamp_ns=state.robot_stamp_ns + 1_000 * MS)]


def unanswered(state: RobotState) -> list[RobotState]:
    return [replace(state, last_command_key=1)]


@pytest.mark.parametrize(
    ("mutate", "reason", "within_ms"),
    [
        (nan_state, StopReason.STATE_NOT_FINITE, 3),
        (tipping(19.0), StopReason.TILT, 42),  # 45° are 0.785 rad
        (on_its_side, StopReason.SIGNAL_OUT_OF_RANGE, 9),  # within 3 ms: no body turns so quickly
        (frozen, StopReason.STATE_FROZEN, 48),
        (back_dated, StopReason.STATE_REJECTED, 42),
        (from_the_future, StopReason.CLOCK_JUMPED, 3),
        (unanswered, StopReason.COMMAND_UNCONFIRMED, 156),
        (lambda _: [], StopReason.STATE_STALE, 42),
    ],
)
def test_bad_states_end_in_damping_then_in_silence(
    robot: Any, zero_policy: Policy, mutate: Any, reason: StopReason, within_ms: int
) -> None:
    begin_ns = 0

    def noted(state: RobotState) -> list[RobotState]:
        nonlocal begin_ns
        begin_ns = begin_ns or state.robot_stamp_ns
        changed: list[RobotState] = mutate(state)
        return changed

    loop, sink = stopped_by(robot, zero_policy, noted)
    first = next(event for event in sink.events if event.name == "stop")
    assert first.text.startswith(reason.label)
    assert modes_of(sink)[-2:] == ["damping", "released"]
    assert robot.calls[-1] == "release"
    damped = [(c, t) for c, t in zip(robot.sent, robot.sent_at_ns, strict=True) if not c.gains.kp_nm_per_rad.any()]
    assert damped[0][1] - begin_ns <= within_ms * MS
    assert all(np.isfinite(c.position_rad).all() for c, _ in damped)
    assert all((c.gains.kd_nm_s_per_rad == 8.0).all() for c, _ in damped)
    # Nothing but damping follows the first damping command.
    assert robot.sent[-len(damped) :] == [c for c, _ in damped]
    assert loop.stop is not None
    assert loop.stop.reason.exit_code != 0


def test_damping_goes_on_by_the_clock_when_no_state_comes_then_falls_silent(robot: Any, zero_policy: Policy) -> None:
    loop, sink = stopped_by(robot, zero_policy, lambda _: [])
    assert loop.stop is not None
    assert loop.stop.reason is StopReason.STATE_STALE
    silence = next(t for e, t in ((e, e.robot_stamp_ns) for e in sink.events) if e.text.endswith("released"))
    damped_ns = [t for c, t in zip(robot.sent, robot.sent_at_ns, strict=True) if not c.gains.kp_nm_per_rad.any()]
    assert np.diff(damped_ns).max() == 3 * MS
    assert silence - damped_ns[0] <= 165 * MS


@pytest.mark.parametrize("gap_messages", [3, 6])
def test_a_short_gap_changes_nothing(robot: Any, zero_policy: Policy, gap_messages: int) -> None:
    loop, sink = make_loop(robot, zero_policy)
    drive_until(loop, Mode.ACTIVE)
    left = gap_messages

    def gap(state: RobotState) -> list[RobotState]:
        nonlocal left
        left -= 1
        return [] if left >= 0 else [state]

    robot.mutate = gap
    drive(loop)
    assert loop.stop is not None
    assert loop.stop.reason is StopReason.COMPLETED
    assert sum(t.skipped for t in sink.ticks) == 0


@pytest.mark.parametrize(
    ("changes", "reason", "last_mode"),
    [
        ({"estopped": True}, StopReason.ESTOPPED, "released"),
        ({"motors_powered": False}, StopReason.MOTORS_OFF, "released"),
        ({"behavior_faults": ("fall",)}, StopReason.BEHAVIOR_FAULT, "released"),
        ({"battery_charge_percent": 3.0}, StopReason.BATTERY_LOW, "standing"),
    ],
)
def test_the_slow_state_ends_a_run(
    robot: Any,
    zero_policy: Policy,
    make_slow: Callable[..., SlowState],
    changes: dict[str, object],
    reason: StopReason,
    last_mode: str,
) -> None:
    loop, sink = make_loop(robot, zero_policy, sequence=standing_sequence(100.0))
    drive_until(loop, Mode.ACTIVE)
    robot.slow = make_slow(**changes)
    drive(loop)
    assert loop.stop is not None
    assert loop.stop.reason is reason
    assert modes_of(sink)[-1] == last_mode


@pytest.mark.parametrize("mode", [Mode.ACTIVATING, Mode.ACTIVE, Mode.STANDING])
def test_a_process_that_stood_still_does_not_take_its_set_points_up_again(
    robot: Any, zero_policy: Policy, mode: Mode
) -> None:
    loop, sink = make_loop(robot, zero_policy, sequence=standing_sequence(0.1))
    robot.activates, robot.takes_back = mode is not Mode.ACTIVATING, False
    drive_until(loop, mode)
    robot.now_ns += 2_000 * MS  # what came meanwhile was received before the loop ran again
    sent = len(robot.sent)
    drive(loop)
    assert loop.stop is not None
    assert loop.stop.reason is StopReason.TICKS_SKIPPED
    assert modes_of(sink)[-2:] == ["damping", "released"]
    assert not any(command.gains.kp_nm_per_rad.any() for command in robot.sent[sent:])


def test_a_policy_that_gives_no_number_never_reaches_the_robot(robot: Any, make_policy: Callable[..., Policy]) -> None:
    """The network divides by nothing: an observation far outside makes it overflow."""
    weight = np.zeros((48, 12))
    weight[9] = 3e38
    policy = make_policy(weight=weight, velocity_command_high=(1.5, 0.5, 1.0))
    loud = VelocitySequence(name="loud", duration_s=5.0, waypoints=(Waypoint(time_s=0.0, v_x_m_s=1.5),))
    loop, sink = make_loop(robot, policy, sequence=loud)
    drive(loop)
    assert loop.stop is not None
    assert loop.stop.reason in (StopReason.POLICY_NOT_FINITE, StopReason.SETPOINT_OVERSHOOT)
    assert all(np.isfinite(c.position_rad).all() for c in robot.sent)
    assert modes_of(sink)[-1] == "released"


@pytest.mark.parametrize("mode", [Mode.ACTIVATING, Mode.RAMPING_IN, Mode.ACTIVE, Mode.SOFT_STOP, Mode.RAMPING_OUT])
def test_the_operator_may_stop_in_every_mode(robot: Any, zero_policy: Policy, mode: Mode) -> None:
    loop, sink = make_loop(robot, zero_policy)
    robot.activates = mode is not Mode.ACTIVATING
    drive_until(loop, mode)
    loop.ask_stop(Stop(StopReason.OPERATOR_STOP))
    drive(loop)
    assert modes_of(sink)[-1] == "standing"


def test_a_second_signal_damps_at_once(robot: Any, zero_policy: Policy) -> None:
    loop, _ = make_loop(robot, zero_policy, sequence=standing_sequence(100.0))
    drive_until(loop, Mode.ACTIVE)
    loop.ask_stop(Stop(StopReason.OPERATOR_STOP))
    loop.cycle()
    loop.ask_stop(Stop(StopReason.OPERATOR_DAMP))
    loop.cycle()
    assert loop.mode is Mode.DAMPING
    assert not robot.sent[-1].gains.kp_nm_per_rad.any()


def test_a_defect_of_this_program_ends_in_damping(robot: Any, zero_policy: Policy) -> None:
    class Broken:
        name = "broken"

        def sample(self, active_s: float, host_stamp_ns: int) -> Wanted:
            raise KeyError("nowhere")

        def close(self) -> None: ...

    sink = MemorySink()
    loop = ControlLoop(robot, zero_policy, Broken(), CONFIG, sink)
    drive(loop)
    assert loop.stop is not None
    assert loop.stop.reason is StopReason.INTERNAL_ERROR
    assert "KeyError" in loop.stop.detail
    assert modes_of(sink)[-2:] == ["damping", "released"]


def test_joint_control_that_is_never_granted_ends_the_run(robot: Any, zero_policy: Policy) -> None:
    robot.activates = False
    loop, _ = make_loop(robot, zero_policy)
    drive(loop)
    assert loop.stop is not None
    assert loop.stop.reason is StopReason.ACTIVATION_FAILED
    assert loop.stop.values["bound_s"] == 3.0


def test_a_stand_that_never_takes_over_ends_in_damping(robot: Any, zero_policy: Policy) -> None:
    robot.takes_back = False
    loop, sink = make_loop(robot, zero_policy)
    drive(loop)
    assert loop.stop is not None
    assert loop.stop.reason is StopReason.HAND_BACK_FAILED
    assert modes_of(sink)[-2:] == ["damping", "released"]


def test_a_link_too_slow_for_the_bounds_is_refused_with_the_key_that_would_have_to_change(
    robot: Any, zero_policy: Policy
) -> None:
    """Every state is 45 ms old when it comes; 40 ms are allowed."""
    robot.mutate = lambda state: [replace(state, robot_stamp_ns=state.robot_stamp_ns - 45 * MS)]
    loop, sink = make_loop(robot, zero_policy)
    drive(loop)
    assert robot.sent == []
    assert modes_of(sink) == ["released"]
    assert loop.stop is not None
    assert loop.stop.reason is StopReason.STATE_STALE
    assert loop.stop.values == {"age_s": 0.045, "bound_s": 0.04}
    assert "a slow one: safety.state_age_damp_s" in loop.stop.sentence()


def test_a_link_just_within_the_bounds_is_used(robot: Any, zero_policy: Policy) -> None:
    robot.mutate = lambda state: [replace(state, robot_stamp_ns=state.robot_stamp_ns - 36 * MS)]
    loop, _ = make_loop(robot, zero_policy)
    drive(loop)
    assert loop.stop is not None
    assert loop.stop.reason is StopReason.COMPLETED


def test_a_robot_that_sends_no_state_is_not_driven(robot: Any, zero_policy: Policy) -> None:
    robot.mutate = lambda _: []
    loop, _ = make_loop(robot, zero_policy)
    drive(loop)
    assert loop.stop is not None
    assert loop.stop.reason is StopReason.STATE_LOST
    assert robot.sent == []


def test_what_the_robot_reports_beside_the_streams_ends_the_run(robot: Any, zero_policy: Policy) -> None:
    loop, _ = make_loop(robot, zero_policy, sequence=standing_sequence(100.0))
    drive_until(loop, Mode.ACTIVE)
    sent = len(robot.sent)
    robot.waiting.append(Stop(StopReason.LEASE_LOST, "tablet"))
    drive(loop)
    assert len(robot.sent) == sent
    assert loop.stop is not None
    assert "tablet" in loop.stop.sentence()


def test_lost_ticks_are_counted_and_too_many_are_a_stop(robot: Any, zero_policy: Policy) -> None:
    loop, sink = make_loop(robot, zero_policy, sequence=standing_sequence(100.0))
    drive_until(loop, Mode.ACTIVE)

    def slow(state: RobotState) -> list[RobotState]:
        return [state] if (state.robot_stamp_ns // (3 * MS)) % 12 == 0 else []

    robot.mutate = slow
    drive(loop)
    assert loop.stop is not None
    assert loop.stop.reason is StopReason.TICKS_SKIPPED
    assert sum(t.skipped for t in sink.ticks) >= 10
