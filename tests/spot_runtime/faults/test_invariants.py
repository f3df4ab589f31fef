"""Whatever happens in whatever order: the invariants of what is sent, against the core and against the fake robot."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from proof.faults.attempts import all_of, inject
from proof.faults.rows import judge, keep_invariants, left_alone
from proof.rig import CALM, Rig, rig
from spot_log.write.sink import MemorySink
from spot_model.io.velocity_sequence import standing_sequence
from spot_model.policy.policy import Policy, policy_from_bytes
from spot_model.robot import facts
from spot_model.robot.state import RobotState
from spot_runtime.config import RunConfig
from spot_runtime.control.loop import ControlLoop
from spot_runtime.control.modes import Mode
from spot_runtime.hal.base import JointControl
from spot_runtime.stops import Stop, StopReason
from spot_tools.sources import ScriptedSource

from .test_matrix import BRISK_HANDOVER, brisk

REPOSITORY = Path(__file__).parents[3]
MS = 1_000_000
CONFIG = RunConfig.model_validate(
    {
        "handover": {"ramp_in_s": 0.1, "settle_s": 0.3, "ramp_out_s": 0.1, "soft_stop_s": 0.05, "damping_s": 0.3},
        "control": {"warm_up": False},
    }
)
SEED_POLICY = (REPOSITORY / "tests" / "fuzz" / "seeds" / "policy.onnx").read_bytes()


class Runs(RuleBasedStateMachine):
    """A loop on a robot written by hand, to which anything may happen at any time."""

    robot_class: Any = None
    policy: Policy

    @initialize()
    def begin(self) -> None:
        self.robot = self.robot_class()
        self.robot.activates = False
        self.sink = MemorySink()
        source = ScriptedSource(standing_sequence(600.0))
        self.loop = ControlLoop(self.robot, self.policy, source, CONFIG, self.sink, wall_s=lambda: 0.0)
        self.change: Any = lambda state: [state]
        self.robot.mutate = self._mutate
        self.pose_rad: np.ndarray | None = None
        self.checked = 0
        self.damped_at: int | None = None
        self.released_at: int | None = None

    def _mutate(self, state: RobotState) -> list[RobotState]:
        states: list[RobotState] = self.change(state)
        return states

    # What may happen -------------------------------------------------------------------------------------------------

    @rule(cycles=st.integers(1, 60))
    def time_passes(self, cycles: int) -> None:
        for _ in range(cycles):
            self._cycle()

    @rule()
    def control_is_granted(self) -> None:
        self.robot.activates = True
        if self.robot.control is JointControl.PENDING:
            self.robot.control = JointControl.ACTIVE

    @rule(granted=st.booleans())
    def joint_control_changes_by_itself(self, granted: bool) -> None:
        if self.robot.sent and self.robot.control in (JointControl.PENDING, JointControl.ACTIVE):
            self.robot.control = JointControl.ACTIVE if granted else JointControl.FAILED

    @rule(cycles=st.integers(1, 80))
    def states_are_missing(self, cycles: int) -> None:
        self._for(cycles, lambda _: [])

    @rule(
        name=st.sampled_from(["position_rad", "velocity_rad_s", "load_nm", "odom_from_body_wxyz"]),
        value=st.sampled_from([np.nan, np.inf, -np.inf, 1e300, -1e300, 50.0]),
        index=st.integers(0, 3),
    )
    def a_value_is_wrong(self, name: str, value: float, index: int) -> None:
        def wrong(state: RobotState) -> list[RobotState]:
            values = getattr(state, name).copy()
            values[index] = value
            return [replace(state, **{name: values})]

        self._for(2, wrong)

    @rule(shift_ms=st.integers(-2000, 2000))
    def stamps_are_wrong(self, shift_ms: int) -> None:
        self._for(5, lambda state: [replace(state, robot_stamp_ns=state.robot_stamp_ns + shift_ms * MS)])

    @rule(copies=st.integers(2, 12))
    def states_come_in_heaps(self, copies: int) -> None:
        self._for(3, lambda state: [state] * copies)

    @rule(offset_rad=st.floats(-0.3, 0.3))
    def the_robot_moves(self, offset_rad: float) -> None:
        def moved(state: RobotState) -> list[RobotState]:
            return [replace(state, position_rad=state.position_rad + offset_rad)]

        self._for(3, moved)

    @rule(joints=st.integers(0, 19))
    def another_robot_answers(self, joints: int) -> None:
        self._for(1, lambda state: [replace(state, position_rad=np.zeros(joints))])

    @rule(
        changes=st.sampled_from(
            [
                {"estopped": True},
                {"motors_powered": False},
                {"behavior_faults": ("fall",)},
                {"battery_charge_percent": 2.0},
                {"motor_temperature_c": {"fl_kn": 99.0}},
                {"system_faults": ("critical: x",)},
                {},
            ]
        )
    )
    def the_slow_state_changes(self, changes: dict[str, object]) -> None:
        self.robot.slow = replace(self.robot.slow, **changes)

    @rule(reason=st.sampled_from(list(StopReason)))
    def somebody_stops_it(self, reason: StopReason) -> None:
        self.loop.ask_stop(Stop(reason))

    @rule(reason=st.sampled_from([StopReason.LEASE_LOST, StopReason.LINK_LOST, StopReason.COMMAND_REFUSED]))
    def the_adapter_reports(self, reason: StopReason) -> None:
        self.robot.waiting.append(Stop(reason))

    @rule(silent=st.booleans())
    def the_echo_stops(self, silent: bool) -> None:
        self.robot.echoes = not silent

    @precondition(lambda self: self.loop.mode is Mode.READY)
    @rule()
    def it_gets_into_motion(self) -> None:
        self.control_is_granted()
        self.time_passes(80)

    # What must hold --------------------------------------------------------------------------------------------------

    @invariant()
    def what_was_sent_is_safe(self) -> None:
        sent, at_ns = self.robot.sent, self.robot.sent_at_ns
        for i in range(self.checked, len(sent)):
            command = sent[i]
            assert command.key == i + 1
            assert 0 < command.end_robot_stamp_ns - at_ns[i] <= 100 * MS
            assert np.isfinite(command.position_rad).all()
            assert (command.position_rad >= facts.POSITION_LOW_RAD).all()
            assert (command.position_rad <= facts.POSITION_HIGH_RAD).all()
            assert np.abs(command.load_nm).max() <= CONFIG.safety.feedforward_nm
            assert not command.velocity_rad_s.any()
            if not command.gains.kp_nm_per_rad.any() and self.damped_at is None:
                self.damped_at = i
            if self.damped_at is not None:
                assert not command.gains.kp_nm_per_rad.any(), "stiff after damping"
        if self.checked == 0 and sent:
            assert self.pose_rad is not None
            np.testing.assert_allclose(sent[0].position_rad, self.pose_rad)
        self.checked = len(sent)
        if self.released_at is not None:
            assert len(sent) == self.released_at, "something was sent after release"

    @invariant()
    def every_end_has_a_reason(self) -> None:
        if self.loop.mode in (Mode.DAMPING, Mode.RELEASED, Mode.SOFT_STOP, Mode.RAMPING_OUT, Mode.STANDING):
            assert self.loop.stop is not None
            told = [event for event in self.sink.events if event.name in ("stop", "completed")]
            assert told
            assert told[0].text

    def teardown(self) -> None:
        if not hasattr(self, "loop"):
            return
        self.loop.ask_stop(Stop(StopReason.OPERATOR_DAMP))
        for _ in range(400):
            self._cycle()
        self.what_was_sent_is_safe()
        assert self.loop.is_done, f"still {self.loop.mode.value}"

    def _for(self, cycles: int, change: Any) -> None:
        self.change = change
        for _ in range(cycles):
            self._cycle()
        self.change = lambda state: [state]

    def _cycle(self) -> None:
        before = len(self.robot.sent)
        self.loop.cycle()
        if before == 0 and self.robot.sent:
            newest = self.loop.newest
            assert newest is not None
            self.pose_rad = np.clip(newest.position_rad, facts.POSITION_LOW_RAD, facts.POSITION_HIGH_RAD)
        if self.loop.mode is Mode.RELEASED and self.released_at is None:
            self.released_at = len(self.robot.sent)


def test_the_invariants_hold_against_the_core(robot: Any) -> None:
    from hypothesis.stateful import run_state_machine_as_test

    class Here(Runs):
        robot_class = type(robot)
        policy = policy_from_bytes(SEED_POLICY, source="seed")

    run_state_machine_as_test(
        Here,
        settings=settings(
            max_examples=60,
            stateful_step_count=25,
            deadline=None,
            derandomize=True,
            database=None,
            suppress_health_check=list(HealthCheck),
        ),
    )


# Against the fake ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def fake(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    folder = tmp_path_factory.mktemp("invariants")
    with rig(folder, REPOSITORY / "policies" / "walk.onnx", scenario=brisk(folder)) as started:
        started.calm = {**CALM, "handover": BRISK_HANDOVER}
        yield started


FAULTS = st.sampled_from(
    [
        ("state_gap", {}),
        ("state_delay", {"delay_s": 0.02}),
        ("state_jitter", {"mean_s": 0.01}),
        ("state_drops", {"probability": 0.5}),
        ("duplicated_states", {"probability": 1.0}),
        ("back_dated_states", {"probability": 0.5, "shift_s": 0.05}),
        ("command_delay", {"delay_s": 0.03}),
        ("command_drops", {"probability": 0.7}),
        ("frozen_sensors", {}),
        ("nan_sensor", {"signal": "velocity"}),
        ("bad_quaternion", {"scale": 2.0}),
        ("clock_jump", {"jump_s": 0.03}),
        ("clock_jump", {"jump_s": -0.3}),
        ("low_battery", {"percent": 5.0}),
        ("weak_motor", {"gain": 0.0}),
        ("behavior_fault", {"cause": "hardware"}),
        ("power_loss", {}),
        ("push", {"forward_m_s": 2.0, "up_m_s": -2.0}),
        ("malformed_states", {"kind": "cut"}),
        ("token_expired", {}),
        ("lease_stolen", {"owner": "tablet"}),
        ("estop_pressed", {}),
        ("state_stream_closed", {}),
    ]
)


@settings(max_examples=5, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck))
@given(
    faults=st.lists(st.tuples(FAULTS, st.sampled_from([0.01, 0.05, 0.5, 0.0])), min_size=1, max_size=3),
    at_s=st.floats(0.0, 1.2),
)
def test_the_invariants_hold_against_the_fake(
    fake: Rig, faults: list[tuple[tuple[str, dict[str, Any]], float]], at_s: float
) -> None:
    acts = all_of(*(inject(name, s, **parameters) for (name, parameters), s in faults))
    try:
        drive = fake.drive(lambda hal: acts(fake, hal), at_s=at_s, seconds=2.0)
        finding = judge(drive, drive.summary.outcome)
        keep_invariants(drive.log, finding)
        assert drive.summary.outcome != "internal_error", drive.summary.sentence
        if drive.summary.exit_code:
            assert drive.summary.sentence
        fake.step(4.0)
        left_alone(fake, finding)
        assert finding.problems == []
    finally:
        fake.restore()
