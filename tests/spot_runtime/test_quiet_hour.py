"""Nothing happens for long: no doubt may arise of a robot that stands, whatever its sensors and estimators are like."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from spot_model.robot import facts
from spot_model.robot.state import Gains, JointCommand
from spot_runtime.control.safety.signals import check
from spot_runtime.control.safety.states import StateMemory, screen_state
from spot_runtime.safety_limits import SafetyLimits
from tests.spot_runtime.resting_robot import QuietRobot

QUIET_MINUTES = 4.0
"""All robots together."""
SEEDS = range(12)
LIMITS = SafetyLimits()
ZERO = np.zeros(12)


def doubts_of(robot: QuietRobot, seconds: float, situation: check.Situation) -> Counter[str]:
    """How often each thing is doubted of a robot that stands, under the vendor or by a held command of a policy."""
    found: Counter[str] = Counter()
    screening, memory = StateMemory(), check.SignalMemory()
    held_rad = robot.stand.position_rad + robot.stand.load_nm / facts.POLICY_KP_NM_PER_RAD
    memory = check.asked(memory, JointCommand(0, held_rad, ZERO, ZERO, Gains.policy(), 1))
    for state in robot.states(seconds):
        screening, is_usable, stop = screen_state(screening, state, state.robot_stamp_ns, LIMITS)
        found.update([stop.sentence()] if stop else [])
        if is_usable:
            memory, doubts = check.check_signals(memory, [state], situation)
            found.update(doubt.stop.detail for doubt in doubts)
    return found


@pytest.mark.parametrize("seed", SEEDS)
def test_nothing_is_doubted_while_nothing_happens(seed: int) -> None:
    situation = check.Situation(is_standing=seed % 2 == 0, is_driven=seed % 2 == 1)
    found = doubts_of(QuietRobot(seed), 60.0 * QUIET_MINUTES / len(SEEDS), situation)
    assert not found, found.most_common(3)
