"""Whatever the robot does: once its motors are to be cut, they are cut."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from fake_robot.network.requests import Velocity, VelocityPlan, WalkLimits
from fake_robot.network.status import EstopLevel, Mode, MotorPower
from fake_robot.robot.modes import MotionRefusedError

QUICK = {
    "power": {"power_on_s": 0.05, "power_off_s": 0.05},
    "motion": {"stand_s": 0.6, "sit_s": 0.6, "damping_s": 0.3},
    "joint_control": {"on_command_expiry": "freeze_torque", "freeze_torque_s": 0.3},
}
FAR_NS = 1 << 62
FORWARD: Velocity = (0.3, 0.0, 0.0)


def walk(driver: Any) -> None:
    driver.robot.walk(VelocityPlan(FORWARD, True, (4.0, 4.0, 2.0), WalkLimits(FAR_NS, (-1.0,) * 3, (1.0,) * 3)))


def place_feet(driver: Any) -> None:
    feet = driver.robot.snapshot().foot_position_in_body_m[:, :2]
    driver.robot.place_feet(feet + driver.robot.snapshot().position_of_body_in_odom_m[:2] + (0.06, 0.0), 0.02)


def expire(driver: Any) -> None:
    driver.open()
    driver.robot.enter_joint_control()
    driver.hold(0.063)
    driver.run(0.15)


def control(driver: Any) -> None:
    driver.open()
    driver.robot.enter_joint_control()
    driver.hold(0.063)


FROM_A_STAND: dict[Mode, Callable[[Any], None]] = {
    Mode.STANDING: lambda _: None,
    Mode.STANDING_UP: lambda driver: driver.robot.stand(),
    Mode.WALKING: walk,
    Mode.STEPPING: place_feet,
    Mode.SITTING_DOWN: lambda driver: driver.robot.sit(),
    Mode.FROZEN: expire,
    Mode.JOINT_CONTROL: control,
    Mode.DAMPING: lambda driver: driver.robot.inject("behavior_fault", {"cause": "hardware"}, None),
    Mode.RIGHTING: lambda driver: driver.robot.selfright(),
}
CUTS: dict[str, Callable[[Any], None]] = {
    "settle": lambda driver: driver.robot.set_estop_level(EstopLevel.SETTLE_THEN_CUT),
    "cut": lambda driver: driver.robot.set_estop_level(EstopLevel.CUT),
    "power_off": lambda driver: driver.robot.power_off(),
    "safe_power_off": lambda driver: driver.robot.safe_power_off(),
    "give_up": lambda driver: driver.robot._simulation.modes.give_up("the battery is critically low"),
}
COMMANDS: dict[str, Callable[[Any], None]] = {
    "none": lambda _: None,
    "stand": lambda driver: driver.robot.stand(),
    "walk": walk,
    "place_feet": place_feet,
    "sit": lambda driver: driver.robot.sit(),
    "freeze": lambda driver: driver.robot.freeze(),
    "selfright": lambda driver: driver.robot.selfright(),
    "joint_control": lambda driver: driver.robot.enter_joint_control(),
    "stop_motion": lambda driver: driver.robot.stop_motion(),
    "safe_power_off": lambda driver: driver.robot.safe_power_off(),
    "power_on": lambda driver: driver.robot.power_on(),
    "fault": lambda driver: driver.robot.inject("behavior_fault", {"cause": "hardware"}, None),
}


def in_mode(make: Callable[..., Any], mode: Mode) -> Any:
    driver = make(**QUICK)
    if mode is Mode.LIMP:
        driver.robot.power_on()
        return driver
    driver.robot.power_on()
    driver.run(0.1)
    if mode is not Mode.SITTING:
        driver.robot.stand()
        driver.run(1.0)
        FROM_A_STAND[mode](driver)
        driver.run(0.012)
    assert driver.robot.snapshot().mode is mode
    return driver


def run_until_off(driver: Any) -> None:
    for _ in range(300):
        driver.run(0.03)
        if driver.robot.snapshot().motor_power is MotorPower.OFF:
            break
    snapshot = driver.robot.snapshot()
    assert (snapshot.mode, snapshot.motor_power) == (Mode.LIMP, MotorPower.OFF)


@pytest.mark.parametrize("cut", CUTS)
@pytest.mark.parametrize("mode", Mode, ids=lambda mode: mode.value)
def test_every_cut_ends_with_the_motors_off_in_every_mode(make: Callable[..., Any], mode: Mode, cut: str) -> None:
    driver = in_mode(make, mode)
    CUTS[cut](driver)
    if cut == "give_up" and mode is Mode.LIMP:
        driver.run(0.1)  # it takes its place once they have power
        CUTS[cut](driver)
    run_until_off(driver)


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("mode", Mode, ids=lambda mode: mode.value)
def test_no_command_outlives_a_pressed_estop(make: Callable[..., Any], mode: Mode, command: str) -> None:
    driver = in_mode(make, mode)
    driver.robot.set_estop_level(EstopLevel.SETTLE_THEN_CUT)
    driver.run(0.06)
    try:
        COMMANDS[command](driver)
    except MotionRefusedError:
        assert command not in {"none", "safe_power_off", "fault"}
    run_until_off(driver)


def test_a_frozen_robot_with_a_fault_stays_where_it_is_when_it_is_told_to_stop(make: Callable[..., Any]) -> None:
    driver = in_mode(make, Mode.DAMPING)
    driver.robot.freeze()
    driver.robot.stop_motion()
    assert driver.robot.snapshot().mode is Mode.FROZEN
