"""The fake robot's arm: in states and polls, following its servos, and refused commands for the legs alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bosdyn.api import robot_state_pb2
from bosdyn.client.frame_helpers import BODY_FRAME_NAME, HAND_FRAME_NAME, get_a_tform_b

from fake_robot.services.reports.state_message import fill_state
from spot_model.errors import BadInputError
from spot_model.robot.arm import ARM_JOINT_NAMES, ARM_KD_NM_S_PER_RAD, ARM_KP_NM_PER_RAD, ARM_LOW_RAD, STOWED_RAD

WITH_ARM: dict[str, Any] = {"model": {"robot": "spot_with_arm"}}
OUT_RAD = [0.0, -0.9, 1.8, 0.0, -0.9, 0.0, -1.0]


def arm_request(driver: Any, arm_rad: Any, *, kp: float = 1.0) -> Any:
    request = driver.request()
    command = request.joint_command
    command.position.extend(list(arm_rad))
    command.velocity.extend([0.0] * 7)
    command.load.extend([0.0] * 7)
    command.gains.k_q_p.extend((kp * ARM_KP_NM_PER_RAD).tolist())
    command.gains.k_qd_p.extend(ARM_KD_NM_S_PER_RAD.tolist())
    return request


def controlled_arm(make: Any) -> Any:
    driver = make(**WITH_ARM)
    driver.stand_up()
    driver.open()
    driver.robot.submit(driver.stream, arm_request(driver, STOWED_RAD))
    driver.robot.enter_joint_control()
    return driver


def ask(driver: Any, arm_rad: Any, seconds: float, **gains: float) -> np.ndarray:
    """Measured angles after some time of this set-point."""
    for _ in range(round(seconds / 0.03)):
        driver.robot.submit(driver.stream, arm_request(driver, arm_rad, **gains))
        driver.run(0.03)
    return np.asarray(driver.robot.snapshot().arm[0])


def test_states_have_nineteen_joints_and_a_robot_without_an_arm_twelve(make: Any) -> None:
    for keys, n in ((WITH_ARM, 19), ({}, 12)):
        driver = make(**keys)
        subscription = driver.robot.subscribe_state()
        driver.run(0.03)
        joints = robot_state_pb2.RobotStateStreamResponse.FromString(subscription.get(1.0)).joint_states
        assert {len(values) for values in (joints.position, joints.velocity, joints.load)} == {n}
        assert joints.position[12:] == pytest.approx(STOWED_RAD[: n - 12], abs=0.01)


@pytest.mark.parametrize(("arm_rad", "stow", "opened"), [(STOWED_RAD, 1, 0.0), (OUT_RAD, 2, 64.0)])
def test_a_poll_tells_of_the_arm(make: Any, arm_rad: Any, stow: int, opened: float) -> None:
    state = robot_state_pb2.RobotState()
    robot = make(**WITH_ARM, arm={"position_rad": list(arm_rad)}).robot
    fill_state(state, robot.snapshot(), is_wifi_on=True, are_payload_ports_on=True)
    names = [joint.name for joint in state.kinematic_state.joint_states]
    assert names[12:] == [name.replace("_", ".") for name in ARM_JOINT_NAMES]
    assert state.manipulator_state.stow_state == stow
    assert state.manipulator_state.gripper_open_percentage == pytest.approx(opened, abs=1.0)
    hand = get_a_tform_b(state.kinematic_state.transforms_snapshot, BODY_FRAME_NAME, HAND_FRAME_NAME)
    if stow == 1:
        assert (hand.x, hand.y, hand.z) == pytest.approx((0.357 + 0.1956, 0.0, 0.263), abs=0.01)


def test_joints_follow_their_servos_to_their_stops_and_are_held_without_a_command(make: Any) -> None:
    driver = controlled_arm(make)
    goal = STOWED_RAD + np.array([0.0, 0.0, 0.0, 0.0, 0.5, 0.0, -9.0])
    reached = ask(driver, goal, 1.2)
    assert reached == pytest.approx([*goal[:6], ARM_LOW_RAD[6]], abs=0.02)
    driver.robot.stand()
    driver.run(1.0)
    assert driver.robot.snapshot().arm[0] == pytest.approx(reached, abs=0.02)


def test_a_joint_without_stiffness_stays_where_it_is_left(make: Any) -> None:
    driver = controlled_arm(make)
    assert ask(driver, STOWED_RAD + np.eye(7)[4], 0.6, kp=0.0) == pytest.approx(STOWED_RAD, abs=0.01)


def test_a_command_for_the_legs_alone_is_refused(make: Any) -> None:
    driver = make(**WITH_ARM)
    driver.open()
    driver.robot.submit(driver.stream, driver.request())
    assert "position has 12 values; allowed: 19, one a joint (with an arm)" in driver.stream.failure.message


def test_a_start_beyond_a_stop_is_refused(make: Any) -> None:
    with pytest.raises(BadInputError, match="position_rad of arm0_el0 = -1; allowed: 0 to"):
        make(**WITH_ARM, arm={"position_rad": [0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0]})


def test_the_feet_carry_the_arm(make: Any) -> None:
    driver = make(**WITH_ARM)
    driver.stand_up()
    assert driver.robot.truth().foot_force_n.sum() == pytest.approx((31.6 + 7.47) * 9.81, rel=0.02)
