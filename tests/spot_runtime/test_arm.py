"""A Spot with an arm: held stowed while the legs are controlled, refused where it is out, missed where it is lost."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bosdyn.api import robot_command_pb2, robot_state_pb2

from spot_log.tools.log_info import log_info
from spot_model.robot import facts
from spot_model.robot.arm import (
    ARM_JOINT_NAMES,
    ARM_KD_NM_S_PER_RAD,
    ARM_KP_NM_PER_RAD,
    STOWED_RAD,
)
from spot_model.robot.state import Gains, JointCommand, RobotState
from spot_runtime.hal.errors import HalError
from spot_runtime.hal.spot.arm import AWAY_RAD, AWAY_STATES, NO_ARM, Arm, polled_arm_rad, refuse_arm_out
from spot_runtime.hal.spot.command_stream import CommandEncoder
from spot_runtime.stops import Stop, StopReason
from tests.spot_runtime.conftest import START_NS, make_state
from tests.spot_runtime.test_on_the_fake_robot import Fake, running, standing_policy

__all__ = ["standing_policy"]

OUT_RAD = [0.0, -0.9, 1.8, 0.0, -0.9, 0.0, -1.0]
LOAD_NM = [0.0, 4.0, -3.0, 0.0, 1.0, 0.0, -0.5]
"""Of the joints as the states report it."""


def arm_state(position_rad: Any = STOWED_RAD, load_nm: Any = LOAD_NM) -> RobotState:
    return make_state(arm_position_rad=list(position_rad), arm_load_nm=list(load_nm))


def held(*states: RobotState) -> tuple[Arm, deque[Stop]]:
    problems: deque[Stop] = deque()
    arm = Arm(problems)
    arm.watch(list(states) or [arm_state()])
    assert arm.take_hold()
    return arm, problems


def share_of_stand(share: float) -> Gains:
    return Gains(share * facts.STAND_KP_NM_PER_RAD, facts.STAND_KD_NM_S_PER_RAD)


def test_set_points_are_where_the_arm_was_with_the_load_it_carried_and_the_gripper_closed() -> None:
    pose = STOWED_RAD + np.array([0.02, -0.01, 0.01, 0.1, 0.05, -0.2, -0.04])
    arm, _ = held(arm_state(load_nm=np.zeros(7)), arm_state(pose, 2.0 * np.array(LOAD_NM)))
    command = arm.command(Gains.stand())
    assert command.position_rad == pytest.approx([*np.clip(pose, -3.14159, 3.14159)[:6], 0.0])
    assert command.load_nm == pytest.approx(LOAD_NM)
    assert command.velocity_rad_s == [0.0] * 7


def test_the_arm_gets_as_stiff_as_the_legs_have_been_and_is_damped_where_they_are() -> None:
    arm, _ = held()
    for share, stiffness in ((0.1, 0.1), (0.5, 0.5), (1.0, 1.0)):
        command = arm.command(share_of_stand(share))
        assert command.kp_nm_per_rad == pytest.approx((stiffness * ARM_KP_NM_PER_RAD).tolist())
        assert command.kd_nm_s_per_rad == ARM_KD_NM_S_PER_RAD.tolist()
    assert arm.command(Gains.policy()).kp_nm_per_rad == ARM_KP_NM_PER_RAD.tolist()  # though the policy is softer
    zeros = np.zeros(12)
    damped = arm.command(Gains(zeros, zeros + 6.0))
    assert (damped.kp_nm_per_rad, damped.load_nm) == ([0.0] * 7, [0.0] * 7)
    assert damped.kd_nm_s_per_rad == ARM_KD_NM_S_PER_RAD.tolist()


def test_commands_have_nineteen_values_with_an_arm_and_twelve_without() -> None:
    for arm, n in ((held()[0], 19), (held(make_state())[0], 12)):
        encoder = CommandEncoder("test", 20.0, arm)
        for share in (0.1, 0.1, 1.0):
            zeros = np.zeros(12)
            command = JointCommand(1, facts.DEFAULT_POSITION_RAD, zeros, zeros, share_of_stand(share), START_NS)
            sent = robot_command_pb2.JointControlStreamRequest.FromString(encoder.encode(command, START_NS))
            joints = sent.joint_command
            fields = (joints.position, joints.velocity, joints.load, joints.gains.k_q_p, joints.gains.k_qd_p)
            assert {len(field) for field in fields} == {n}
            assert joints.position[:12] == pytest.approx(facts.DEFAULT_POSITION_RAD)
            assert joints.gains.k_q_p[12:] == pytest.approx((share * ARM_KP_NM_PER_RAD)[: n - 12])
            assert joints.load[12:] == pytest.approx(LOAD_NM[: n - 12])
    assert held(make_state())[0].command(Gains.stand()) is NO_ARM


def test_an_arm_that_is_out_is_refused_by_its_joints_angles_and_what_is_allowed() -> None:
    state = robot_state_pb2.RobotState()
    for name, at_rad in zip((*ARM_JOINT_NAMES, "arm0_hr0"), (*OUT_RAD, 0.0), strict=True):
        state.kinematic_state.joint_states.add(name=name.replace("_", ".")).position.value = at_rad
    with pytest.raises(HalError, match=r"arm0_sh1 at -0.90 rad \(allowed: -3.3 to -2.8\).*arm0_f1x.*stow it") as found:
        refuse_arm_out(polled_arm_rad(state))
    assert "arm0_sh0" not in str(found.value)
    refuse_arm_out(polled_arm_rad(robot_state_pb2.RobotState()))


@pytest.mark.parametrize("joint", [0, 1, 2, 4, 6])
@pytest.mark.parametrize("off_rad", [-0.7, 0.7, np.nan])
def test_joint_control_does_not_begin_with_an_arm_that_is_out(joint: int, off_rad: float) -> None:
    problems: deque[Stop] = deque()
    arm, pose = Arm(problems), STOWED_RAD.copy()
    pose[joint] += off_rad
    arm.watch([arm_state(pose)])
    assert not arm.take_hold()
    assert problems[0].reason is StopReason.ACTIVATION_FAILED
    assert ARM_JOINT_NAMES[joint] in problems[0].detail
    with pytest.raises(HalError, match="not stowed"):
        arm.refuse_out()


def test_joints_of_an_arm_that_vanish_are_a_stop_told_once_and_are_held_on() -> None:
    arm, problems = held()
    states = [make_state(), make_state(), arm_state(), make_state()]
    assert arm.watch(states) == states
    assert [problem.reason for problem in problems] == [StopReason.ARM_LOST]
    assert arm.command(Gains.stand()).position_rad == STOWED_RAD.tolist()


def test_an_arm_that_moves_away_is_a_stop() -> None:
    pose = STOWED_RAD + np.array([0.0, 1.1 * AWAY_RAD, 0.0, 0.0, 0.0, 0.0, 0.0])
    arm, problems = held()
    arm.watch([arm_state(pose)] * (AWAY_STATES - 1) + [arm_state()])
    assert not problems  # one odd value is none
    arm.let_go()
    arm.watch([arm_state(pose)] * AWAY_STATES)
    assert not problems  # the vendor's own motion
    arm.watch([arm_state()])
    assert arm.take_hold()
    arm.watch([arm_state(pose)] * AWAY_STATES)
    assert problems[0].reason is StopReason.ARM_AWAY
    assert "arm0_sh1 is at -2.81 rad, held at -3.14; allowed: within 0.3 rad" in problems[0].sentence()


# On the fake robot ---------------------------------------------------------------------------------------------------


WITH_ARM = "model: {robot: spot_with_arm}\n"
Start = Callable[[str], Fake]


@pytest.fixture
def start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, standing_policy: bytes) -> Iterator[Start]:
    with ExitStack() as stack:

        def start(scenario: str) -> Fake:
            address, admin = stack.enter_context(running(tmp_path, scenario))
            return Fake(address, admin, tmp_path, monkeypatch, standing_policy)

        yield start


def test_a_run_with_the_arm_stowed(start: Start, monkeypatch: pytest.MonkeyPatch) -> None:
    sent = []
    encode = CommandEncoder.encode

    def noting(encoder: CommandEncoder, command: JointCommand, stamp_ns: int) -> bytes:
        sent.append(encode(encoder, command, stamp_ns))
        return sent[-1]

    monkeypatch.setattr(CommandEncoder, "encode", noting)
    fake = start(WITH_ARM)
    summary, log = fake.drive(seconds=1.0)
    assert (summary.outcome, summary.exit_code) == ("completed", 0), summary.sentence
    joints = [robot_command_pb2.JointControlStreamRequest.FromString(wire).joint_command for wire in sent]
    assert {len(command.position) for command in joints} == {19}
    assert np.ptp([command.position[12:] for command in joints], axis=0).max() == 0.0
    stiffness = np.array([command.gains.k_q_p[12] for command in joints]) / ARM_KP_NM_PER_RAD[0]
    assert stiffness[0] == pytest.approx(0.1, rel=0.05)
    assert (np.diff(stiffness) >= 0.0).all()
    assert stiffness[-1] == 1.0
    assert len(log.arm) == len(log.states)
    assert (log.arm.robot_stamp_ns == log.states.robot_stamp_ns).all()
    assert np.abs(log.arm.position_rad - STOWED_RAD).max() < 0.02
    assert log_info(log).arm_joints == 7
    assert log.states.position_rad.shape[1] == 12


def test_an_arm_that_is_out_on_the_robot(start: Start) -> None:
    summary, log = start(f"{WITH_ARM}arm: {{position_rad: {OUT_RAD}}}\n").drive()
    assert summary.outcome == "robot_error"
    assert "arm0_el0 at 1.80 rad (allowed: 2.8 to 3.3)" in summary.sentence
    assert len(log.commands) == 0


def test_an_arm_that_is_lost_in_a_run(start: Start) -> None:
    fake = start(WITH_ARM)
    summary, log = fake.drive(during=lambda: fake.inject("malformed_states", kind="no_arm"), seconds=3.0)
    assert (summary.outcome, summary.exit_code) == ("arm_lost", 54), summary.sentence
    assert "0 of the arm's joints come, before it were 7" in summary.sentence
    assert (log.commands.kp_nm_per_rad[-1] == 0.0).all()
    assert fake.status().motor_power.lower().endswith("off")
