"""Claim: a policy tick fits 300 µs at the pace of a real run; this shows what its pieces cost, hot.

Usage: python benchmarks/loop_pieces.py [POLICY]
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from spot_model.policy.policy import TickMemory, load_policy
from spot_model.robot import facts
from spot_model.robot.state import Gains, JointCommand, RobotState
from spot_runtime.control.safety.commands import SetpointMemory, check_command, limit_setpoint
from spot_runtime.control.safety.states import StateMemory, screen_state
from spot_runtime.control.set_point import blend, hold_setpoint, policy_setpoint
from spot_runtime.hal.spot.command_stream import CommandEncoder
from spot_runtime.safety_limits import SafetyLimits

ZEROS = np.zeros(facts.N_JOINTS)
LIMITS = SafetyLimits()


def state_at(index: int) -> RobotState:
    """A robot that stands and trembles a little."""
    stamp_ns = 1_700_000_000_000_000_000 + index * facts.STATE_PERIOD_NS
    position = facts.DEFAULT_POSITION_RAD + 1e-6 * (index % 7)
    level, still = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
    feet = np.ones(facts.N_LEGS, dtype=np.bool_)
    return RobotState(position, ZEROS, ZEROS, still, level, still, still, feet, stamp_ns, stamp_ns, index, 0)


def report(name: str, piece: Callable[[int], object], repeats: int = 3000) -> None:
    """Print the median and the 99th percentile of one piece."""
    times_us = []
    for index in range(repeats):
        begin = time.perf_counter()
        piece(index)
        times_us.append((time.perf_counter() - begin) * 1e6)
    print(f"{name:<28} p50 {np.percentile(times_us, 50):6.1f} µs   p99 {np.percentile(times_us, 99):6.1f} µs")


def main(path: str) -> None:
    """Measure all pieces."""
    policy = load_policy(Path(path))
    states = [state_at(i) for i in range(3000)]
    memory = StateMemory()
    encoder = CommandEncoder("benchmark", 40.0)
    hold, target = (
        hold_setpoint(facts.DEFAULT_POSITION_RAD, ZEROS),
        policy_setpoint(facts.DEFAULT_POSITION_RAD, Gains.policy()),
    )

    def screen(index: int) -> None:
        nonlocal memory
        memory, _, _ = screen_state(memory, states[index], states[index].robot_stamp_ns, LIMITS)

    def command(index: int) -> JointCommand:
        return JointCommand(index + 1, facts.DEFAULT_POSITION_RAD, ZEROS, ZEROS, target.gains, 50_000_000)

    report("screen a state", screen)
    report("observe, infer, set-point", lambda i: policy.tick(TickMemory(), states[i], np.zeros(3)))
    report("blend two servo laws", lambda _: blend(hold, target, 0.5))
    report(
        "limit set-points",
        lambda _: limit_setpoint(
            SetpointMemory(facts.DEFAULT_POSITION_RAD), facts.DEFAULT_POSITION_RAD, target.gains.kp_nm_per_rad, LIMITS
        ),
    )
    report("last gate", lambda i: check_command(command(i), i, 0))
    report("encode a command", lambda i: encoder.encode(command(i), 0))


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "policies/walk.onnx")
