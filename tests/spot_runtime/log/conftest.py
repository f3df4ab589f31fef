"""A made-up run whose every figure is known, for the tests of the log, its reader and its pages."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from bosdyn.api import robot_state_pb2

from spot_log.format.records import (
    CommandRecord,
    EventRecord,
    RunHeader,
    Severity,
    TickRecord,
    WireState,
)
from spot_log.write.run_writer import RunWriter
from spot_log.write.sink import LogSink
from spot_model.robot.facts import DEFAULT_POSITION_RAD, JOINT_NAMES
from spot_model.robot.state import Gains, JointCommand, SlowState
from tests.spot_runtime.file_sink import FileSink

START_HOST_NS = 1_750_000_000_000_000_000
ROBOT_MINUS_HOST_NS = -199_190_000_000
STATE_PERIOD_NS = 3_000_000
MS = 1_000_000


@dataclass(frozen=True)
class SyntheticRun:
    """States every 3 ms, a tick and a command every 7, 7, 6 states, a slow state every 0.2 s, three events."""

    duration_s: float = 2.0
    command_delay_ms: int = 4
    state_latency_ms: int = 1
    answer_ms: int = 1
    fall_at_s: float | None = None
    has_arm: bool = False

    @property
    def n_states(self) -> int:
        return round(self.duration_s / 3e-3)

    @property
    def header(self) -> RunHeader:
        return RunHeader(
            run_id="synthetic-1",
            started_host_stamp_ns=START_HOST_NS,
            robot_id="fake-spot",
            adapter="bosdyn",
            policy_name="walk",
            policy_sha256="ab" * 32,
            policy_contract_json='{"rate_hz": 50}',
            config_json='{"robot": "fake"}',
            command_sequence="forward",
            repeat=3,
            labels={"payload": "none", "surface": "lab floor"},
            software_version="0.1.0",
            software_revision="abc",
        )

    def robot_ns(self, i: int) -> int:
        return START_HOST_NS + ROBOT_MINUS_HOST_NS + i * STATE_PERIOD_NS

    def received_ns(self, i: int) -> int:
        return START_HOST_NS + i * STATE_PERIOD_NS + self.state_latency_ms * MS

    @property
    def tick_states(self) -> list[int]:
        """Index of the state of each tick."""
        edges = np.cumsum([0] + [7, 7, 6] * (self.n_states // 20 + 1))
        return [int(i) for i in edges if i < self.n_states]

    def wave(self, i: int) -> np.ndarray:
        phase = np.tile([0.0, 0.7, 1.4], 4) + np.repeat([0.0, np.pi, np.pi, 0.0], 3)
        return np.sin(2 * np.pi * 2.0 * i * 3e-3 + phase)

    def position_rad(self, i: int) -> np.ndarray:
        return (DEFAULT_POSITION_RAD + 0.2 * self.wave(i)).astype(np.float32).astype(np.float64)

    def message(self, i: int) -> robot_state_pb2.RobotStateStreamResponse:
        message = robot_state_pb2.RobotStateStreamResponse()
        arm = [0.5] * 7 if self.has_arm else []
        joints = message.joint_states
        joints.acquisition_timestamp.FromNanoseconds(self.robot_ns(i))
        joints.position.extend([*self.position_rad(i), *arm])
        joints.velocity.extend([*(2.5 * self.wave(i + 40)), *arm])
        joints.load.extend([*(20.0 * self.wave(i + 20)), *arm])
        for k in range(3):
            packet = message.inertial_state.packets.add()
            packet.timestamp.FromNanoseconds(self.robot_ns(i) - (2 - k) * MS)
            packet.acceleration_rt_odom_in_link_frame.z = 9.81
            packet.angular_velocity_rt_odom_in_link_frame.x = 0.1 * k
            packet.odom_rot_link.w = 1.0
        kinematics = message.kinematic_state
        t_s = i * 3e-3
        tilt_rad = 0.02
        if self.fall_at_s is not None and t_s >= self.fall_at_s:
            tilt_rad = min(1.5, 0.02 + 5.0 * (t_s - self.fall_at_s))
        kinematics.odom_tform_body.position.x = 0.8 * t_s
        kinematics.odom_tform_body.position.z = 0.19
        kinematics.odom_tform_body.rotation.w = np.cos(tilt_rad / 2)
        kinematics.odom_tform_body.rotation.x = np.sin(tilt_rad / 2)
        kinematics.velocity_of_body_in_odom.linear.x = 0.8
        kinematics.velocity_of_body_in_odom.angular.z = 0.05
        swings = self.wave(i)[[0, 3, 6, 9]] > 0.6
        message.contact_states.extend([2 if swing else 1 for swing in swings])
        newest = [k for k, s in enumerate(self.tick_states) if self.arrival_robot_ns(s) <= self.robot_ns(i)]
        if newest:
            message.last_command.user_command_key = newest[-1] + 1
            message.last_command.received_timestamp.FromNanoseconds(self.arrival_robot_ns(self.tick_states[newest[-1]]))
        return message

    def sent_host_ns(self, state: int) -> int:
        return self.received_ns(state) + self.answer_ms * MS

    def arrival_robot_ns(self, state: int) -> int:
        return self.sent_host_ns(state) + ROBOT_MINUS_HOST_NS + self.command_delay_ms * MS

    def command(self, k: int, state: int) -> CommandRecord:
        requested = DEFAULT_POSITION_RAD + 0.25 * self.wave(state + 2)
        sent = requested.copy()
        if k % 10 == 9:
            sent[2] = requested[2] - 0.01
        command = JointCommand(
            key=k + 1,
            position_rad=sent,
            velocity_rad_s=np.zeros(12),
            load_nm=np.zeros(12),
            gains=Gains.policy(),
            end_robot_stamp_ns=self.sent_host_ns(state) + ROBOT_MINUS_HOST_NS + 50 * MS,
        )
        host_ns = self.sent_host_ns(state)
        return CommandRecord(command, requested, host_ns, host_ns + ROBOT_MINUS_HOST_NS, self.robot_ns(state))

    def tick(self, k: int, state: int) -> TickRecord:
        return TickRecord(
            index=k,
            robot_stamp_ns=self.robot_ns(state),
            host_stamp_ns=self.received_ns(state) + 500_000,
            mode="active",
            observation=np.arange(48, dtype=np.float32) * 0.01,
            action=np.full(12, 0.25, dtype=np.float32),
            velocity_command=np.array([1.0, 0.0, 0.1]),
            state_age_s=0.0005,
            inference_s=0.0001,
            compute_s=0.0003,
            command_key=k + 1,
            skipped=1 if k == 5 else 0,
        )

    def slow_state(self, j: int) -> SlowState:
        stamp_ns = START_HOST_NS + j * 200 * MS
        return SlowState(
            robot_stamp_ns=stamp_ns + ROBOT_MINUS_HOST_NS,
            host_stamp_ns=stamp_ns,
            motors_powered=True,
            estopped=False,
            battery_charge_percent=80.0 - 0.1 * j,
            battery_voltage_v=54.0 - 0.01 * j,
            battery_current_a=-8.0,
            battery_temperature_c=(31.0, 32.0),
            motor_temperature_c={name: 40.0 + i + 0.1 * j for i, name in enumerate(JOINT_NAMES)},
            behavior_faults=("fall",) if j == 3 else (),
        )

    @property
    def events(self) -> list[EventRecord]:
        def at(ms: int) -> tuple[int, int]:
            return START_HOST_NS + ms * MS, START_HOST_NS + ms * MS + ROBOT_MINUS_HOST_NS

        return [
            EventRecord(*at(0), Severity.INFO, "mode", "active: the policy follows the velocity command", {}),
            EventRecord(*at(500), Severity.WARNING, "state_age", "a state was late", {"age_ms": 12.5, "bound_ms": 10}),
            EventRecord(*at(900), Severity.ERROR, "limit", "a set-point was clamped", {"joint": 2.0}),
        ]

    def feed(self, sink: LogSink) -> dict[str, int]:
        """Give everything to a sink, in order of time; return how many of each topic."""
        events = list(self.events)
        n_ticks = n_slow = n_events = 0
        tick_of_state = {s: k for k, s in enumerate(self.tick_states)}
        for i in range(self.n_states):
            if i * 3 >= n_slow * 200:
                sink.put(self.slow_state(n_slow))
                n_slow += 1
            while events and events[0].host_stamp_ns <= self.received_ns(i):
                sink.put(events.pop(0))
                n_events += 1
            sink.put(WireState(self.message(i).SerializeToString(), self.received_ns(i)))
            if i in tick_of_state:
                k = tick_of_state[i]
                sink.put(self.tick(k, i))
                sink.put(self.command(k, i))
                n_ticks += 1
        return {
            "state": self.n_states,
            "command": n_ticks,
            "tick": n_ticks,
            "slow_state": n_slow,
            "event": n_events,
        }

    def write(self, path: Path, *, flush_every: int = 300, outcome: str = "completed") -> Path:
        """Write the log in this process, a chunk every ``flush_every`` messages."""
        sink = FileSink(RunWriter(path, self.header), flush_every)
        self.feed(sink)
        sink.writer.close({}, outcome)
        return path


@pytest.fixture(scope="session")
def synthetic_run() -> type[SyntheticRun]:
    """The class of made-up runs."""
    return SyntheticRun


@pytest.fixture(scope="session")
def synthetic_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of the made-up run with its standard figures, 2 s long. Not to be changed."""
    return SyntheticRun().write(tmp_path_factory.mktemp("log") / "run.mcap")
