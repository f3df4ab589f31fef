"""Strangers: whatever a message may hold, in whatever mode, nothing unsafe is sent and the run ends with a reason."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from spot_log.write.sink import MemorySink
from spot_model.io.velocity_sequence import standing_sequence
from spot_model.policy.policy import policy_from_bytes
from spot_model.robot import facts
from spot_model.robot.state import RobotState, SlowState
from spot_runtime.config import RunConfig
from spot_runtime.control.loop import ControlLoop
from spot_runtime.control.modes import Mode
from spot_tools.sources import ScriptedSource
from tests.spot_runtime.conftest import START_NS, HandMadeRobot, make_slow

POLICY = policy_from_bytes((Path(__file__).parents[2] / "fuzz" / "seeds" / "policy.onnx").read_bytes(), source="seed")
CONFIG = RunConfig.model_validate(
    {"handover": {"ramp_in_s": 0.1, "settle_s": 0.3, "damping_s": 0.2}, "control": {"warm_up": False}}
)
NUMBERS = st.one_of(
    st.floats(width=64),
    st.sampled_from([0.0, -0.0, np.nan, np.inf, -np.inf, 1e-308, 5e-324, 1e300, 57.29578, np.pi, 1e6]),
)


def values(count: int) -> st.SearchStrategy[np.ndarray]:
    whole = arrays.arrays(np.float64, count, elements=NUMBERS)
    other = arrays.arrays(np.float64, st.sampled_from([0, 1, 11, 13, 19]), elements=NUMBERS)
    return st.one_of(whole, whole, other) if count == 12 else whole


STAMPS = st.one_of(st.integers(-(2**62), 2**62), st.integers(START_NS - 10**9, START_NS + 10**9), st.just(0))
FIELDS: dict[str, st.SearchStrategy[Any]] = {
    "robot_stamp_ns": STAMPS,
    "host_stamp_ns": STAMPS,
    "position_rad": values(12),
    "velocity_rad_s": values(12),
    "load_nm": values(12),
    "position_of_body_in_odom_m": values(3),
    "odom_from_body_wxyz": values(4),
    "linear_vel_of_body_in_odom_m_s": values(3),
    "angular_vel_of_body_in_odom_rad_s": values(3),
    "foot_contact": arrays.arrays(np.bool_, 4),
    "last_command_key": st.integers(-(2**31), 2**31),
}
CHANGES = st.fixed_dictionaries({}, optional=FIELDS)
SLOW = st.fixed_dictionaries(
    {},
    optional={
        "battery_charge_percent": NUMBERS,
        "battery_voltage_v": NUMBERS,
        "battery_current_a": NUMBERS,
        "battery_temperature_c": st.lists(NUMBERS, max_size=3).map(tuple),
        "motor_temperature_c": st.dictionaries(st.sampled_from(facts.JOINT_NAMES), NUMBERS, max_size=3),
        "motors_powered": st.booleans(),
        "estopped": st.booleans(),
    },
)


def changed(state: RobotState, changes: dict[str, Any]) -> RobotState:
    return replace(state, **changes)


@settings(max_examples=80, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck))
@given(
    begin=st.integers(0, 150),
    message=st.lists(CHANGES, min_size=1, max_size=3),
    lasts=st.sampled_from([1, 2, 30, 1000]),
    slow=SLOW,
)
def test_whatever_a_message_holds(begin: int, message: list[dict[str, Any]], lasts: int, slow: dict[str, Any]) -> None:
    count = 0

    def mutate(state: RobotState) -> list[RobotState]:
        nonlocal count
        count += 1
        if begin <= count < begin + lasts:
            return [changed(state, changes) for changes in message]
        return [state]

    robot = HandMadeRobot(mutate=mutate)
    sick: SlowState = make_slow(**slow)
    loop = ControlLoop(robot, POLICY, ScriptedSource(standing_sequence(0.5)), CONFIG, MemorySink(), wall_s=lambda: 0.0)
    for cycle in range(1500):
        if loop.is_done:
            break
        if cycle == begin:
            robot.slow = sick
        loop.cycle()
    assert loop.is_done, f"still {loop.mode.value}"
    assert loop.stop is not None
    assert loop.mode in (Mode.RELEASED, Mode.STANDING)
    is_damped = False
    for command in robot.sent:
        assert np.isfinite(command.position_rad).all()
        assert (command.position_rad >= facts.POSITION_LOW_RAD).all()
        assert (command.position_rad <= facts.POSITION_HIGH_RAD).all()
        assert np.isfinite(command.load_nm).all()
        assert 0.0 <= command.gains.kp_nm_per_rad.min() <= command.gains.kp_nm_per_rad.max() <= 1000.0
        is_damped = is_damped or not command.gains.kp_nm_per_rad.any()
        assert not (is_damped and command.gains.kp_nm_per_rad.any()), "stiff after damping"
    assert loop.stop.reason.label != "internal_error", loop.stop.sentence()
