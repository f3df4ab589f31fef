"""Claim: 20 s of the fake robot in joint control, without its network, cost about a second of one processor.

Run: python benchmarks/fake_robot_step.py
"""

from __future__ import annotations

import json
import time

import numpy as np
from bosdyn.api import robot_command_pb2

from fake_robot.robot.robot import Robot
from fake_robot.scenario.scenario import Scenario
from spot_model.robot import facts
from spot_model.robot.stamps import NS_PER_S

TICK_NS = 20_000_000
N_TICKS = 1000


def request(robot: Robot, key: int, position_rad: np.ndarray) -> robot_command_pb2.JointControlStreamRequest:
    """A command for the next 60 ms under the vendor's stand gains."""
    message = robot_command_pb2.JointControlStreamRequest()
    command = message.joint_command
    command.end_time.seconds, command.end_time.nanos = divmod(robot.clock.now_ns() + 60_000_000, NS_PER_S)
    command.position.extend(position_rad.tolist())
    command.velocity.extend([0.0] * facts.N_JOINTS)
    command.load.extend([0.0] * facts.N_JOINTS)
    command.gains.k_q_p.extend(facts.STAND_KP_NM_PER_RAD.tolist())
    command.gains.k_qd_p.extend(facts.STAND_KD_NM_S_PER_RAD.tolist())
    command.user_command_key = key
    return message


def main() -> None:
    """Stand up, bob up and down for 20 s of robot time, print the cost as JSON."""
    robot = Robot(Scenario(time_mode="lock_step"))
    robot.power_on()
    robot.advance(round(2.1 * NS_PER_S))
    robot.stand()
    robot.advance(2 * NS_PER_S)
    robot.enter_joint_control()
    stream = robot.open_command_stream(lambda: None)
    pose = robot.truth().joint_position_rad
    direction = np.tile([0.0, 1.0, -2.0], facts.N_LEGS)
    wall_s, cpu_s, states = time.perf_counter(), time.process_time(), robot.states_sent
    for tick in range(N_TICKS):
        stream.submit(request(robot, tick + 1, pose + 0.05 * np.sin(0.12 * tick) * direction))
        robot.advance(TICK_NS)
    failure = stream.failure()
    if failure is not None:
        raise SystemExit(f"joint control ended: {failure.message}")
    wall_s, cpu_s, states = time.perf_counter() - wall_s, time.process_time() - cpu_s, robot.states_sent - states
    robot_s = N_TICKS * TICK_NS / NS_PER_S
    print(
        json.dumps(
            {
                "robot_s": robot_s,
                "wall_s": round(wall_s, 3),
                "cpu_s": round(cpu_s, 3),
                "cpu_us_per_state": round(cpu_s / states * 1e6, 1),
                "times_real_time": round(robot_s / wall_s, 1),
            }
        )
    )


if __name__ == "__main__":
    main()
