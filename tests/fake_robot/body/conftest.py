"""Robots in lock-step with a fixed clock, and a driver for their joint-control streams."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from bosdyn.api import robot_command_pb2, robot_state_pb2

from fake_robot.robot.robot import Robot
from fake_robot.scenario.scenario import Scenario, scenario_from_data
from spot_model.robot import facts

NS = 1_000_000_000
MS = 1_000_000


@dataclass
class Driver:
    """A robot, its state stream, and one command stream."""

    robot: Robot
    failures: int = 0
    key: int = 0
    stream: Any = None
    states: Any = None
    seen: list[Any] = field(default_factory=list)

    def run(self, seconds: float) -> None:
        self.robot.advance(round(seconds * NS))

    def stand_up(self) -> None:
        self.robot.power_on()
        self.run(2.1)
        self.robot.stand()
        self.run(2.0)

    def open(self) -> None:
        def failed() -> None:
            self.failures += 1

        self.stream = self.robot.open_command_stream(failed)

    def request(self, position_rad: Any = None, *, ahead_s: float = 0.06, gains: bool = True) -> Any:
        """A valid request for the present joint positions, or others, under the vendor's stand gains."""
        self.key += 1
        request = robot_command_pb2.JointControlStreamRequest()
        command = request.joint_command
        end_ns = self.robot.clock.now_ns() + round(ahead_s * NS)
        command.end_time.seconds, command.end_time.nanos = divmod(end_ns, NS)
        position = self.robot.truth().joint_position_rad if position_rad is None else np.asarray(position_rad)
        command.position.extend(position.tolist())
        command.velocity.extend([0.0] * 12)
        command.load.extend([0.0] * 12)
        command.user_command_key = self.key
        if gains:
            command.gains.k_q_p.extend(facts.STAND_KP_NM_PER_RAD.tolist())
            command.gains.k_qd_p.extend(facts.STAND_KD_NM_S_PER_RAD.tolist())
        return request

    def send(self, position_rad: Any = None, *, ahead_s: float = 0.06) -> None:
        self.robot.submit(self.stream, self.request(position_rad, ahead_s=ahead_s))

    def hold(self, seconds: float, position_rad: Any = None, *, every_s: float = 0.021) -> None:
        """Send the same set-points again and again while robot time passes."""
        position = self.robot.truth().joint_position_rad if position_rad is None else position_rad
        for _ in range(round(seconds / every_s)):
            self.send(position)
            self.run(every_s)

    def messages(self) -> list[Any]:
        """What has come on the state stream since the last call."""
        got = []
        while (wire := self.states.get(0.0)) is not None:
            got.append(robot_state_pb2.RobotStateStreamResponse.FromString(wire))
        return got


@pytest.fixture
def make() -> Callable[..., Driver]:
    """Build a driver: ``make(terrain={...})`` changes the default scenario."""

    def build(**changes: Any) -> Driver:
        clock = {"start_unix_s": 1_700_000_000, **changes.pop("clock", {})}
        scenario = scenario_from_data({"time_mode": "lock_step", "clock": clock, **changes})
        robot = Robot(scenario)
        return Driver(robot, states=robot.subscribe_state())

    return build


@pytest.fixture
def standing(make: Callable[..., Driver]) -> Callable[..., Driver]:
    """Like ``make``, but the robot stands."""

    def build(**changes: Any) -> Driver:
        driver = make(**changes)
        driver.stand_up()
        return driver

    return build


@pytest.fixture
def controlled(standing: Callable[..., Driver]) -> Callable[..., Driver]:
    """Like ``standing``, but in joint control, and following its first command."""

    def build(**changes: Any) -> Driver:
        driver = standing(**changes)
        driver.open()
        driver.robot.enter_joint_control()
        driver.hold(0.063)
        return driver

    return build


@pytest.fixture
def scenario() -> Scenario:
    return Scenario()
