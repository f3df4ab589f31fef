"""A simulated run as a log, by the runtime's own writer; nothing in it but the signals depends on the robot.

A *stream* has every state message, receipts and the policy's ticks. An *import* is what other people's recordings
offer: 50 to 60 states a second at uneven steps, no receipts, no ticks, no policy, no contacts, no battery.
"""

from __future__ import annotations

from collections.abc import Set as AbstractSet
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from spot_log.format import codec
from spot_log.format.records import EventRecord, RunHeader, Severity
from spot_log.write.run_writer import RunWriter
from spot_log.write.sink import TOPICS
from spot_model.policy.policy import Policy
from spot_model.robot.facts import JOINT_NAMES, LEG_NAMES, STATE_PERIOD_NS
from spot_model.robot.state import Measured
from spot_protos import log_pb2
from withheld.plan import Detail, Signal
from withheld.simulator.recorder import RunArrays
from withheld.simulator.sensors import PACKET_NS, PACKETS

END_AHEAD_NS: Final = 50_000_000
POLL_STATES: Final = 56
"""States between two polls of the battery: 6 Hz."""
FLUSH_STATES: Final = 1500
IMPORT_STATES: Final = (5, 6, 7)
"""States between two that an import has."""
STALE_KEY: Final = 40_000
"""Last command of the run before, echoed until the first of this run has arrived."""
VERSION: Final = "0.1.0"
ACTIVE, RAMPING = "active", "ramping_in"


@dataclass(frozen=True)
class LogSetting:
    """What a log says beside its signals."""

    run_id: str
    sequence: str
    repeat: int
    started_host_ns: int
    skew_ns: int
    """Robot clock less host clock."""
    first_state_ns: int
    """From the run's start to state 0."""
    detail: Detail = "stream"
    echoes_last_run: bool = False
    """Whether the first states still echo the last command of another run."""
    outcome: str = "completed"


def write_log(
    run: RunArrays,
    policy: Policy,
    setting: LogSetting,
    missing: AbstractSet[Signal],
    rng: np.random.Generator,
    path: Path,
) -> None:
    """Write one log to ``path``; ``rng`` draws how long the host's program takes, and the polls' noise."""
    header = RunHeader(
        run_id=setting.run_id,
        started_host_stamp_ns=setting.started_host_ns,
        robot_id="spot",
        adapter="bosdyn",
        command_sequence=setting.sequence,
        repeat=setting.repeat,
        software_version=VERSION,
        foot_names=LEG_NAMES,
    )
    if setting.detail == "stream":
        header = replace(
            header,
            policy_name=policy.contract.name,
            policy_sha256=policy.sha256,
            policy_contract_json=policy.contract.to_json(),
        )
    writer = RunWriter(path, header, for_viewers=False)
    records = _Records(run, policy, setting, missing, rng)
    counts = dict.fromkeys(TOPICS, 0)

    def add(topic: str, record: Any) -> None:
        writer.add(record, counts[topic])
        counts[topic] += 1

    n_states = len(run.position_rad)
    has_ticks = setting.detail == "stream"
    kept = np.ones(n_states, dtype=np.bool_)
    if not has_ticks:
        at = np.cumsum(rng.choice(IMPORT_STATES, n_states // min(IMPORT_STATES)))
        kept = np.isin(np.arange(n_states), at)
    tick_of = {int(state): number for number, state in enumerate(run.tick_state)}
    add("event", records.event("run_started", setting.sequence, -1))
    if has_ticks:
        add("event", records.event("mode", "ready → ramping_in", 0))
    for state in range(n_states):
        number = tick_of.get(state)
        if kept[state]:
            add("state", records.state(state))
        if run.deliveries.is_sent[state] and (has_ticks or number is not None):
            add("command", records.command(state))
        if number is not None and has_ticks:
            if number and run.is_active[number] and not run.is_active[number - 1]:
                add("event", records.event("mode", "ramping_in → active", state))
            add("tick", records.tick(number))
        if state % POLL_STATES == POLL_STATES - 1 and not {"battery", "temperature"} <= missing:
            add("slow_state", records.slow_state(state))
        if state % FLUSH_STATES == FLUSH_STATES - 1:
            writer.flush()
    if setting.outcome == "completed":
        add("event", records.event("completed", "completed: the command sequence is done", n_states - 1))
    else:
        add("event", records.event("stop", setting.outcome, n_states - 1))
    writer.close(dict.fromkeys(TOPICS, 0), setting.outcome)


class _Records:
    """Records of one run, built from whole columns at a time."""

    def __init__(
        self,
        run: RunArrays,
        policy: Policy,
        setting: LogSetting,
        missing: AbstractSet[Signal],
        rng: np.random.Generator,
    ) -> None:
        self._run, self._setting, self._missing = run, setting, missing
        m, k = len(run.position_rad), len(run.tick_state)
        gains = policy.gains()
        self._kp, self._kd = gains.kp_nm_per_rad.tolist(), gains.kd_nm_s_per_rad.tolist()
        self._zeros = [0.0] * len(JOINT_NAMES)
        first = setting.started_host_ns + setting.skew_ns + setting.first_state_ns
        stamp = first + STATE_PERIOD_NS * np.arange(m, dtype=np.int64)
        self._first = first
        self._stamp: list[int] = stamp.tolist()
        way, has_own = run.deliveries, run.echoed >= 0
        self._host: list[int] = (stamp - setting.skew_ns + way.up_ns).tolist()
        self._sent: list[int] = (first + way.sent_ns).tolist()
        stale_key, stale_ns = (STALE_KEY, first - 2_000_000_000) if setting.echoes_last_run else (0, 0)
        echo = np.where(has_own, run.echoed + 1, stale_key)
        arrived = np.where(has_own, first + way.arrival_ns[np.maximum(run.echoed, 0)], stale_ns)
        if "receipts" in missing:
            echo, arrived = np.zeros_like(echo), np.zeros_like(arrived)
        self._echo: list[int] = echo.tolist()
        self._arrived: list[int] = arrived.tolist()
        self._state: dict[str, list[Any]] = {
            field.name: getattr(run, field.name).tolist() for field in fields(Measured)
        }
        for signal, name in (("load", "load_nm"), ("contact", "foot_contact")):
            if signal in missing:
                del self._state[name]
        self._force, self._turn = run.imu_acceleration_m_s2.tolist(), run.imu_turn_rad_s.tolist()
        # The unit's attitude comes with the other sign: the same rotation.
        self._unit = (-run.odom_from_body_wxyz).tolist()
        self._requested = np.repeat(run.requested_rad, np.diff([*run.tick_state, m]), axis=0).tolist()
        self._setpoint = run.setpoint_rad.tolist()
        self._age_s = 1e-4 + 4e-5 * rng.standard_gamma(2.0, k)
        self._compute_s = 2.2e-4 + 3e-5 * rng.standard_gamma(2.0, k)
        self._poll_noise = rng.standard_normal((m // POLL_STATES + 1, 2 + len(JOINT_NAMES)))

    def state(self, i: int) -> log_pb2.State:
        """Number i of the state stream."""
        packets = []
        if "imu" not in self._missing:
            packets = [
                log_pb2.ImuPacket(
                    robot_stamp_ns=self._stamp[i] - PACKET_NS * (PACKETS - 1 - j),
                    acceleration_of_imu_in_link_m_s2=force,
                    angular_vel_of_link_in_link_rad_s=turn,
                    odom_from_link_wxyz=self._unit[i],
                )
                for j, (force, turn) in enumerate(zip(self._force[i], self._turn[i], strict=True))
            ]
        return log_pb2.State(
            robot_stamp_ns=self._stamp[i],
            host_stamp_ns=self._host[i],
            last_command_key=self._echo[i],
            last_command_robot_stamp_ns=self._arrived[i],
            imu=packets,
            **{name: column[i] for name, column in self._state.items()},
        )

    def command(self, i: int) -> log_pb2.Command:
        """The command that answers state i."""
        return log_pb2.Command(
            key=i + 1,
            host_stamp_ns=self._sent[i] - self._setting.skew_ns,
            robot_stamp_ns=self._sent[i],
            state_robot_stamp_ns=self._stamp[i],
            end_robot_stamp_ns=self._sent[i] + END_AHEAD_NS,
            requested_position_rad=self._requested[i],
            position_rad=self._setpoint[i],
            velocity_rad_s=self._zeros,
            load_nm=self._zeros,
            kp_nm_per_rad=self._kp,
            kd_nm_s_per_rad=self._kd,
        )

    def tick(self, number: int) -> log_pb2.Tick:
        """One policy tick."""
        run, state = self._run, int(self._run.tick_state[number])
        return log_pb2.Tick(
            index=number,
            robot_stamp_ns=self._stamp[state],
            host_stamp_ns=self._host[state] + round(self._age_s[number] * 1e9),
            mode=ACTIVE if run.is_active[number] else RAMPING,
            observation=run.observation[number].tolist(),
            action=run.action[number].tolist(),
            velocity_command=run.velocity_command[number].tolist(),
            state_age_s=float(self._age_s[number]),
            inference_s=0.3 * float(self._compute_s[number]),
            compute_s=float(self._compute_s[number]),
            command_key=state + 1,
            skipped=0,
        )

    def slow_state(self, i: int) -> log_pb2.SlowState:
        """A poll shortly before state i; what it found is rounded as the robot rounds it."""
        run, noise = self._run, self._poll_noise[i // POLL_STATES]
        message = log_pb2.SlowState(
            robot_stamp_ns=self._stamp[i], host_stamp_ns=self._host[i], motors_powered=True, estopped=False
        )
        has_battery = "battery" not in self._missing
        message.battery_charge_percent = round(float(run.battery_percent[i]), 1) if has_battery else float("nan")
        message.battery_voltage_v = round(float(run.battery_v[i] + 0.02 * noise[0]), 2) if has_battery else float("nan")
        message.battery_current_a = -round(float(run.battery_a[i] + 0.1 * noise[1]), 2) if has_battery else float("nan")
        if "temperature" not in self._missing:
            warm = np.round(run.winding_c[i] + 0.3 * noise[2:], 1).tolist()
            message.motor_temperature_c.update(dict(zip(JOINT_NAMES, warm, strict=True)))
        return message

    def event(self, name: str, text: str, state: int) -> log_pb2.Event:
        """An event at a state, or at the run's start (-1)."""
        host = self._host[state] if state >= 0 else self._setting.started_host_ns
        robot = self._stamp[state] if state >= 0 else 0
        return codec.event_to_proto(EventRecord(host, robot, Severity.INFO, name, text))
