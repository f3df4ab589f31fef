"""Logs with a hidden truth: closed-loop runs on the plant, recorded as the runtime would, without touching the disk."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from spot_log.format.records import RunHeader
from spot_log.read.run import ImuTable, Run, SlowTable, run_of_columns
from spot_model.effects.base import CommandEffect, Effect, SoftwareEffect
from spot_model.io.velocity_sequence import VelocitySequence, Waypoint
from spot_model.plant.closed_loop import StartState
from spot_model.plant.delay import Delay, LogNormalDelay
from spot_model.plant.plant import Plant, PlantOptions, ServoCommand
from spot_model.policy.contract import PolicyContract, StoredPair
from spot_model.policy.observation import build_observation
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.mjcf import MjcfOptions, default_height_m
from spot_model.robot.rotation import rotate_inverse_wxyz, rotate_wxyz
from spot_model.robot.state import Gains
from trainer.signals.policy_ticks import Script

from .scripted_gait import ScriptedGait

Array = NDArray[np.float64]

TICK_STATES = (7, 7, 6)
"""State messages between two ticks of a 50 Hz policy on a 3 ms stream."""
START_NS = 1_700_000_000_000_000_000
POLL_STATES = 33
"""State messages between two polls of the slow state."""


class Actor(Protocol):
    """What a log needs of a policy."""

    def act(self, observation: NDArray[Any]) -> NDArray[np.float32]:
        """Observations (n, 48) to actions (n, 12)."""
        ...

    def setpoint_rad(self, action: NDArray[Any]) -> Array:
        """Set-points of an action, canonical order."""
        ...

    def gains(self) -> Gains:
        """Servo gains."""
        ...


@dataclass(frozen=True)
class Noise:
    """Standard deviations of white noise on what is logged."""

    position_rad: float = 3e-4
    velocity_rad_s: float = 0.03
    load_nm: float = 0.4
    body_velocity_m_s: float = 0.015
    body_angular_velocity_rad_s: float = 0.01
    imu_acceleration_m_s2: float = 0.15
    imu_turn_rad_s: float = 0.008


QUIET = Noise(1e-9, 1e-9, 1e-9, 1e-9, 1e-9, 1e-9, 1e-9)


@dataclass(frozen=True)
class Battery:
    """The supply: open voltage, resistance, power of all but the motors, copper loss of a motor."""

    open_voltage_v: float = 55.0
    resistance_ohm: float = 0.045
    idle_power_w: float = 150.0
    copper_w_per_nm2: float = 0.02


@dataclass(frozen=True)
class Truth:
    """How the logs are made."""

    effects: tuple[Effect, ...] = ()
    mjcf: MjcfOptions = field(
        default_factory=lambda: MjcfOptions(
            timestep_s=0.0015,
            integrator="implicitfast",
            cone="elliptic",
            contact_solref=(0.012, 1.1),
            collision="feet",
            link_torque_sensors=True,
        )
    )
    """Time step, integrator, cone and contact other than the nominal plant's."""
    noise: Noise = Noise()
    battery: Battery = Battery()
    transport: Delay = LogNormalDelay(floor_s=0.0036, median_s=0.0014, sigma=0.2)
    """Delay of every command, beside the command effects; its mean is that of the nominal model of these tests."""
    imu_is_tilted: bool = True
    """Whether a tilted inertial unit's own packets are tilted, too."""


def walk_sequence(duration_s: float = 4.0) -> VelocitySequence:
    """Forward, faster, then slower and a little sideways; within what the scripted gait can do."""
    points = ((0.0, 0.0, 0.0), (0.25, 2.3, 0.0), (0.6, 1.2, 0.2), (0.8, -0.5, 0.0), (1.0, -0.5, 0.0))
    return VelocitySequence(
        name="planted_walk",
        duration_s=duration_s,
        waypoints=tuple(
            Waypoint(time_s=share * duration_s, v_x_m_s=x, v_y_m_s=y, ramp=share > 0.0) for share, x, y in points
        ),
    )


def planted_runs(
    truth: Truth,
    n_runs: int = 2,
    *,
    sequence: VelocitySequence | None = None,
    actor: Callable[[], Actor] = ScriptedGait,
    seed: int = 1,
) -> list[Run]:
    """Run one command sequence ``n_runs`` times; runs differ by start, noise and what effects draw.

    Args:
        truth: What is hidden.
        n_runs: Repeats.
        sequence: What the operator asks for; default :func:`walk_sequence`.
        actor: Makes the policy, or what stands in for it.
        seed: Of all that is drawn.
    """
    return _Recorder(truth, n_runs, sequence or walk_sequence(), actor(), seed).runs()


def contract_json() -> str:
    """The contract of the scripted gait, as a log's header has it; its stored pair is empty."""
    return PolicyContract(
        name="scripted",
        velocity_command_low=(-1.0, -1.0, -1.0),
        velocity_command_high=(3.0, 1.0, 1.0),
        stored_pair=StoredPair(observation=(0.0,) * 48, action=(0.0,) * 12),
    ).to_json()


class _Recorder:
    def __init__(self, truth: Truth, n: int, sequence: VelocitySequence, actor: Actor, seed: int) -> None:
        self.truth, self.n, self.sequence, self.actor = truth, n, sequence, actor
        self.rng = np.random.default_rng(seed)
        contract = actor.contract if isinstance(actor, Policy) else None
        self.order = actor.policy_from_canonical if isinstance(actor, Policy) else np.arange(facts.N_JOINTS)
        self.default_rad = actor.default_position_rad if isinstance(actor, Policy) else facts.DEFAULT_POSITION_RAD
        self.contract_json = contract.to_json() if contract else contract_json()
        own = [e for e in truth.effects if not isinstance(e, (CommandEffect, SoftwareEffect))]
        self.channel = [e for e in truth.effects if isinstance(e, CommandEffect)]
        self.software = [e for e in truth.effects if isinstance(e, SoftwareEffect)]
        self.plant = Plant(own, n, PlantOptions(mjcf=truth.mjcf, n_threads=1, seed=seed))
        pose = facts.DEFAULT_POSITION_RAD + 0.03 * self.rng.standard_normal((n, facts.N_JOINTS))
        self.plant.reset(joint_position_rad=pose, position_of_body_in_world_m=(0.0, 0.0, default_height_m() + 0.01))
        self.gravity = self.plant.physics.gravity()
        self.substeps = round(facts.STATE_PERIOD_NS * 1e-9 / truth.mjcf.timestep_s)
        self.step_ns = facts.STATE_PERIOD_NS // self.substeps
        self.states: dict[str, list[Any]] = {}
        self.ticks: dict[str, list[Any]] = {}
        self.commands: dict[str, list[Any]] = {}
        self.slow: dict[str, list[Any]] = {}
        self.now_ns = START_NS
        self.key = np.zeros(n, dtype=np.int64)
        self.received_ns = np.zeros(n, dtype=np.int64)
        self.active = pose
        self.waiting: list[tuple[int, Array, Array]] = []
        self.latest_s = np.full(n, -np.inf)
        self.power_w = np.zeros(n)
        self.imu = np.zeros((3, n, 6))
        self._moved = (self._velocity(), self.plant.world_from_body_wxyz)

    def runs(self) -> list[Run]:
        last_action = np.zeros((self.n, facts.N_JOINTS), dtype=np.float32)
        n_ticks = round(self.sequence.duration_s * facts.POLICY_RATE_HZ)
        for tick in range(n_ticks):
            command = self.sequence.at(tick / facts.POLICY_RATE_HZ)
            for message in range(TICK_STATES[tick % 3]):
                state = self._state()
                if message == 0:
                    last_action = self._tick(tick, state, command, last_action)
                for step in range(self.substeps):
                    self._step(step)
        return [self._run(i) for i in range(self.n)]

    def _state(self) -> dict[str, Array]:
        self._receive()
        noise, rng, plant = self.truth.noise, self.rng, self.plant

        def noisy(value: Array, sigma: float | Array) -> Array:
            return np.asarray(value + sigma * rng.standard_normal(value.shape))

        reading, estimate = plant.reading, plant.estimate
        attitude = estimate.world_from_body_wxyz
        imu = self.imu.copy()
        if self.truth.imu_is_tilted:
            # Against the vertical, as the estimate is.
            true = plant.outside.in_odom(plant.world_from_body_wxyz)
            imu = np.concatenate(
                [rotate_inverse_wxyz(attitude, rotate_wxyz(true, part)) for part in np.split(imu, 2, axis=2)], axis=2
            )
        state = {
            "robot_stamp_ns": np.full(self.n, self.now_ns),
            "position_rad": noisy(reading.position_rad, noise.position_rad),
            "velocity_rad_s": noisy(reading.velocity_rad_s, noise.velocity_rad_s),
            "load_nm": noisy(reading.load_nm, noise.load_nm),
            "position_of_body_in_odom_m": plant.position_of_body_in_world_m - np.array([0.0, 0.0, 0.33]),
            "odom_from_body_wxyz": attitude,
            "linear_vel_of_body_in_odom_m_s": noisy(
                rotate_wxyz(attitude, estimate.linear_vel_of_body_in_body_m_s), noise.body_velocity_m_s
            ),
            "angular_vel_of_body_in_odom_rad_s": noisy(
                rotate_wxyz(attitude, estimate.angular_vel_of_body_in_body_rad_s), noise.body_angular_velocity_rad_s
            ),
            "foot_contact": estimate.foot_contact > 0.5,
            "last_command_key": self.key.copy(),
            "last_command_robot_stamp_ns": self.received_ns.copy(),
            "imu": np.moveaxis(noisy(imu, np.repeat([noise.imu_acceleration_m_s2, noise.imu_turn_rad_s], 3)), 0, 1),
        }
        _append(self.states, state)
        if len(self.states["robot_stamp_ns"]) % POLL_STATES == 1:
            self._poll()
        return state

    def _tick(self, index: int, state: dict[str, Array], command: Array, last: NDArray[np.float32]) -> Any:
        observation = build_observation(
            world_from_body_wxyz=state["odom_from_body_wxyz"],
            linear_vel_of_body_in_world_m_s=state["linear_vel_of_body_in_odom_m_s"],
            angular_vel_of_body_in_world_rad_s=state["angular_vel_of_body_in_odom_rad_s"],
            velocity_command=np.tile(command, (self.n, 1)),
            position_rad=state["position_rad"][:, self.order],
            velocity_rad_s=state["velocity_rad_s"][:, self.order],
            last_action=last,
            default_position_rad=self.default_rad,
        ).astype(np.float32)
        action = self.actor.act(observation)
        sent = self.actor.setpoint_rad(action)
        for effect in self.software:
            sent = effect.setpoint_rad(sent)
        issued_s = np.full(self.n, 1e-9 * (self.now_ns - START_NS))
        arrival = issued_s + self.truth.transport.sample(self.rng, self.n)
        for channel in self.channel:
            arrival = np.broadcast_to(channel.arrival_s(arrival, self.rng), (self.n,))
        arrival = np.maximum(arrival, self.latest_s)
        self.latest_s = np.where(np.isfinite(arrival), arrival, self.latest_s)
        self.waiting.append((index + 1, arrival, sent))
        gains = self.actor.gains()
        shape = (self.n, facts.N_JOINTS)
        stamp = np.full(self.n, self.now_ns)
        _append(
            self.commands,
            {
                "key": np.full(self.n, index + 1),
                "robot_stamp_ns": stamp + 1_000_000,
                "state_robot_stamp_ns": stamp,
                "end_robot_stamp_ns": stamp + 100_000_000,
                "requested_position_rad": sent,
                "position_rad": sent,
                "velocity_rad_s": np.zeros(shape),
                "load_nm": np.zeros(shape),
                "kp_nm_per_rad": np.broadcast_to(gains.kp_nm_per_rad, shape),
                "kd_nm_s_per_rad": np.broadcast_to(gains.kd_nm_s_per_rad, shape),
            },
        )
        _append(
            self.ticks,
            {
                "index": np.full(self.n, index),
                "robot_stamp_ns": stamp,
                "observation": observation,
                "action": action,
                "velocity_command": np.tile(command, (self.n, 1)),
                "command_key": np.full(self.n, index + 1),
            },
        )
        return action

    def _receive(self) -> None:
        """Commands that have arrived by now; servos follow them from the next physics step on."""
        now_s = 1e-9 * (self.now_ns - START_NS)
        for number, arrival_s, setpoint in self.waiting:
            due = (arrival_s <= now_s + 1e-9) & (self.key < number)
            self.active = np.where(due[:, None], setpoint, self.active)
            arrival_ns = START_NS + np.round(np.where(np.isfinite(arrival_s), arrival_s, 0.0) * 1e9).astype(np.int64)
            self.received_ns = np.where(due, arrival_ns, self.received_ns)
            self.key = np.where(due, number, self.key)
        self.waiting = [w for w in self.waiting if np.any(np.isfinite(w[1]) & (self.key < w[0]))]

    def _step(self, step: int) -> None:
        self._receive()
        gains = self.actor.gains()
        self.plant.command(
            ServoCommand(
                position_rad=self.active, kp_nm_per_rad=gains.kp_nm_per_rad, kd_nm_s_per_rad=gains.kd_nm_s_per_rad
            )
        )
        self.plant.advance()
        self.now_ns += self.step_ns
        self._supply()
        self._feel(step)

    def _supply(self) -> None:
        torque, velocity = self.plant.applied_torque_nm, self.plant.joint_velocity_rad_s
        battery = self.truth.battery
        power = np.maximum(torque * velocity, 0.0).sum(axis=1) + battery.copper_w_per_nm2 * (torque**2).sum(axis=1)
        self.power_w += (self.plant.timestep_s / 0.05) * (power + battery.idle_power_w - self.power_w)

    def _velocity(self) -> Array:
        plant = self.plant
        return np.concatenate([plant.linear_vel_of_body_in_world_m_s, plant.angular_vel_of_body_in_body_rad_s], axis=1)

    def _feel(self, step: int) -> None:
        """Inertial packets 2, 1 and 0 ms before the next state: specific force of the step that holds the instant."""
        before, _ = self._moved
        velocity, attitude = self._velocity(), self.plant.world_from_body_wxyz
        force = (velocity[:, :3] - before[:, :3]) / self.plant.timestep_s - self.gravity
        packet = np.concatenate([rotate_inverse_wxyz(attitude, force), velocity[:, 3:]], axis=1)
        for i, age_s in enumerate((0.002, 0.001, 0.0)):
            if step == self.substeps - 1 - int(age_s / self.plant.timestep_s + 1e-6):
                self.imu[i] = packet
        self._moved = (velocity, attitude)

    def _poll(self) -> None:
        battery = self.truth.battery
        v0, r = battery.open_voltage_v, battery.resistance_ohm
        current = self.power_w / v0
        for _ in range(8):
            current = self.power_w / (v0 - r * current)
        _append(
            self.slow,
            {
                "robot_stamp_ns": np.full(self.n, self.now_ns),
                "battery_voltage_v": v0 - r * current,
                "battery_current_a": -current,
            },
        )

    def _run(self, i: int) -> Run:
        s, c, t, b = ({k: np.array([row[i] for row in v]) for k, v in d.items()} for d in self._tables())
        n = len(s["robot_stamp_ns"])
        imu = s.pop("imu")
        stamps = s["robot_stamp_ns"][:, None] - np.array([2_000_000, 1_000_000, 0])
        table = ImuTable(
            state_index=np.repeat(np.arange(n), 3),
            robot_stamp_ns=stamps.ravel(),
            acceleration_of_imu_in_link_m_s2=imu[..., :3].reshape(-1, 3),
            angular_vel_of_link_in_link_rad_s=imu[..., 3:].reshape(-1, 3),
            odom_from_link_wxyz=np.repeat(s["odom_from_body_wxyz"], 3, axis=0),
        )
        header = RunHeader(
            run_id=f"planted-{i}",
            started_host_stamp_ns=START_NS,
            command_sequence=self.sequence.name,
            repeat=i,
            policy_contract_json=self.contract_json,
        )
        run = run_of_columns(
            Path(f"planted_{i}.mcap"),
            header,
            states={"host_stamp_ns": s["robot_stamp_ns"] + 1_000_000, "imu": table, **s},
            commands={"host_stamp_ns": c["robot_stamp_ns"], **c},
            ticks={"host_stamp_ns": t["robot_stamp_ns"] + 1_000_000, "mode": np.full(len(t["index"]), "policy"), **t},
        )
        return replace(run, slow_states=SlowTable.of(len(b["robot_stamp_ns"]), {"joints": facts.N_JOINTS}, **b))

    def _tables(self) -> Sequence[dict[str, list[Any]]]:
        return self.states, self.commands, self.ticks, self.slow


def _append(table: dict[str, list[Any]], row: dict[str, Any]) -> None:
    for name, value in row.items():
        table.setdefault(name, []).append(np.array(value))


POLICY = Path(__file__).parents[2] / "policies" / "baseline.onnx"


def scripts(n_ticks: int = 110) -> list[Script]:
    """One standing start of each of two sequences."""
    start = StartState(
        position_rad=np.asarray(facts.DEFAULT_POSITION_RAD),
        velocity_rad_s=np.zeros(12),
        world_from_body_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
        linear_vel_of_body_in_world_m_s=np.zeros(3),
        angular_vel_of_body_in_world_rad_s=np.zeros(3),
        last_action=np.zeros(12, dtype=np.float32),
    )
    commands = {"a": np.array([0.6, 0.0, 0.0]), "b": np.zeros(3)}
    return [Script(name, 1, start, np.tile(command, (n_ticks, 1))) for name, command in commands.items()]
