"""Closed-loop runs of a model under the logs' policy and commands, as logs: for shrink, traces, map and synthesis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.odometry import LegOdometry
from spot_log.format.records import RunHeader
from spot_log.read.run import CommandTable, ImuTable, Run, SlowTable, StateTable, TickTable
from spot_model.effects.base import CommandEffect, Effect, SoftwareEffect
from spot_model.io.model_file import RobotModel
from spot_model.plant.plant import Plant, PlantOptions, ServoCommand
from spot_model.plant.start import StartState, standing_height_m
from spot_model.policy.observation import build_observation
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.mjcf import MjcfOptions
from spot_model.robot.rotation import rotate_wxyz

Array = NDArray[np.float64]

SUBSTEPS: Final = 2
"""Physics steps between two states."""
START_NS: Final = 1_000_000_000_000
TICK_STATES: Final = (7, 7, 6)
"""States between two ticks of a 50 Hz policy on a 3 ms stream."""


@dataclass(frozen=True)
class Script:
    """One run to make: how it starts and what it is told."""

    sequence: str
    repeat: int
    start: StartState
    velocity_command: Array
    """One a policy tick, shape (n_ticks, 3)."""


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviations of white noise on what the policy sees and the log holds."""

    position_rad: float = 3e-4
    velocity_rad_s: float = 0.03
    load_nm: float = 0.4
    linear_vel_m_s: float = 0.015
    angular_vel_rad_s: float = 0.01


@dataclass(frozen=True)
class Surroundings:
    """What a closed loop depends on and no model of a robot holds: the ground, and the robot's own state estimator."""

    contact_time_constant_s: float = MjcfOptions().contact_solref[0]
    contact_damping_ratio: float = MjcfOptions().contact_solref[1]
    odometry_time_s: float = 0.0
    """In which standing legs pull the reported velocity; 0 for one that is true. See :mod:`diagnosis.odometry`."""


def simulate(
    model: RobotModel, policy: Policy, scripts: Sequence[Script], rng: np.random.Generator, noise: SensorNoise,
    *, surroundings: Sequence[Surroundings] | None = None, only_ticks: bool = False,
    tell: Callable[[float], None] | None = None,
) -> list[Run]:  # fmt: skip
    """Run all scripts in one batch.

    Args:
        model: With which effects.
        policy: What controls.
        scripts: How each run starts and what it is told.
        rng: Draws the sensors' noise and the delays.
        noise: Of the sensors.
        surroundings: Of each run; the simulator's own by default. Effects come on top.
        only_ticks: Keep no state between the policy's ticks, and no loads of the links: enough to compare gaits.
        tell: Called with the share that is done.

    Raises:
        ValueError: There are no scripts.
    """
    if not scripts:
        raise ValueError("no script to simulate")
    simulation = _Simulation(model.effects, policy, scripts, rng, noise, only_ticks)
    if surroundings is not None:
        simulation.surround(surroundings)
    return simulation.runs(tell or (lambda _: None))


class _Simulation:
    def __init__(
        self,
        effects: Sequence[Effect],
        policy: Policy,
        scripts: Sequence[Script],
        rng: np.random.Generator,
        noise: SensorNoise,
        only_ticks: bool,
    ) -> None:
        self.policy, self.scripts, self.rng, self.noise, self.n = policy, scripts, rng, noise, len(scripts)
        self.only_ticks = only_ticks
        self.channel = [e for e in effects if isinstance(e, CommandEffect)]
        self.software = [e for e in effects if isinstance(e, SoftwareEffect)]
        step_s = facts.STATE_PERIOD_NS * 1e-9 / SUBSTEPS
        options = MjcfOptions(
            timestep_s=step_s, cone="elliptic", collision="all", link_torque_sensors=not only_ticks, visuals=False
        )
        own = [e for e in effects if not isinstance(e, (CommandEffect, SoftwareEffect))]
        self.plant = Plant(own, self.n, PlantOptions(mjcf=options, n_threads=1, on_divergence="flag"))
        self._reset()
        self.states: dict[str, list[Any]] = {}
        self.ticks: dict[str, list[Any]] = {}
        self.now_ns = START_NS
        self.key = np.zeros(self.n, dtype=np.int64)
        self.received_ns = np.zeros(self.n, dtype=np.int64)
        self.waiting: list[tuple[int, Array, Array]] = []
        self.latest_s = np.full(self.n, -np.inf)
        self.odometry: LegOdometry | None = None

    def _reset(self) -> None:
        starts = [s.start for s in self.scripts]

        def each(name: str) -> Array:
            return np.stack([getattr(s, name) for s in starts])

        attitude = each("world_from_body_wxyz")
        attitude = attitude / np.linalg.norm(attitude, axis=1, keepdims=True)
        height = np.array([standing_height_m(s) for s in starts])
        pose = each("position_rad")
        inverse = attitude * np.array([1.0, -1.0, -1.0, -1.0])
        self.plant.reset(
            position_of_body_in_world_m=np.stack([0.0 * height, 0.0 * height, height], axis=1),
            world_from_body_wxyz=attitude,
            joint_position_rad=pose,
            linear_vel_of_body_in_world_m_s=each("linear_vel_of_body_in_world_m_s"),
            angular_vel_of_body_in_body_rad_s=np.asarray(
                rotate_wxyz(inverse, each("angular_vel_of_body_in_world_rad_s"))
            ),
            joint_velocity_rad_s=each("velocity_rad_s"),
        )
        self.last = np.stack([s.last_action for s in starts]).astype(np.float32)
        self.setpoint = np.asarray(self.policy.setpoint_rad(self.last))

    def surround(self, surroundings: Sequence[Surroundings]) -> None:
        """Another ground and estimator for each run; what effects changed of the ground stays."""
        own = np.array(MjcfOptions().contact_solref)
        wanted = np.array([(s.contact_time_constant_s, s.contact_damping_ratio) for s in surroundings])
        solref = self.plant.fields["geom_solref"]
        for leg in facts.LEG_NAMES:
            solref[:, self.plant.fields.geom_id(f"{leg}_foot")] += wanted - own
        self.plant.fields.commit()
        times_s = np.array([s.odometry_time_s for s in surroundings])
        self.odometry = LegOdometry(times_s) if times_s.any() else None

    def runs(self, tell: Callable[[float], None]) -> list[Run]:
        """All runs."""
        n_ticks = max(len(s.velocity_command) for s in self.scripts)
        commands = np.stack([
            np.pad(s.velocity_command, ((0, n_ticks - len(s.velocity_command)), (0, 0)), mode="edge")
            for s in self.scripts
        ])  # fmt: skip
        gains = self.policy.gains()
        followed: Array | None = None
        for tick in range(n_ticks):
            tell(tick / n_ticks)
            for message in range(TICK_STATES[tick % 3]):
                error = self.odometry.error_m_s(self.plant) if self.odometry is not None else None
                if message == 0 or not self.only_ticks:
                    state = self._sense(error)
                if message == 0:
                    self._tick(tick, state, commands[:, tick])
                for _ in range(SUBSTEPS):
                    setpoint = self._deliver()
                    if setpoint is not followed:
                        followed = setpoint
                        self.plant.command(
                            ServoCommand(
                                position_rad=setpoint,
                                kp_nm_per_rad=gains.kp_nm_per_rad,
                                kd_nm_s_per_rad=gains.kd_nm_s_per_rad,
                            )
                        )
                    self.plant.advance()
                    self.now_ns += facts.STATE_PERIOD_NS // SUBSTEPS
        states = {name: np.array(rows) for name, rows in self.states.items()}
        ticks = {name: np.array(rows) for name, rows in self.ticks.items()}
        return [self._run(i, states, ticks) for i in range(self.n)]

    def _noisy(self, value: Array, sigma: float) -> Array:
        return np.asarray(value + sigma * self.rng.standard_normal(value.shape))

    def _sense(self, velocity_error_m_s: Array | None) -> dict[str, Array]:
        plant, noise = self.plant, self.noise
        reading, estimate = plant.reading, plant.estimate
        attitude = estimate.world_from_body_wxyz
        linear = np.asarray(rotate_wxyz(attitude, estimate.linear_vel_of_body_in_body_m_s))
        if velocity_error_m_s is not None:
            linear = linear + velocity_error_m_s
        angular = rotate_wxyz(attitude, estimate.angular_vel_of_body_in_body_rad_s)
        state = {
            "robot_stamp_ns": np.full(self.n, self.now_ns),
            "position_rad": self._noisy(reading.position_rad, noise.position_rad),
            "velocity_rad_s": self._noisy(reading.velocity_rad_s, noise.velocity_rad_s),
            "load_nm": self._noisy(reading.load_nm, noise.load_nm),
            "position_of_body_in_odom_m": np.array(plant.position_of_body_in_world_m),
            "odom_from_body_wxyz": np.array(attitude),
            "linear_vel_of_body_in_odom_m_s": self._noisy(linear, noise.linear_vel_m_s),
            "angular_vel_of_body_in_odom_rad_s": self._noisy(np.asarray(angular), noise.angular_vel_rad_s),
            "foot_contact": np.asarray(estimate.foot_contact) > 0.5,
            "last_command_key": self.key.copy(),
            "last_command_robot_stamp_ns": self.received_ns.copy(),
        }
        _append(self.states, state)
        return state

    def _tick(self, index: int, state: dict[str, Array], command: Array) -> None:
        order = self.policy.policy_from_canonical
        observation = np.asarray(build_observation(
            world_from_body_wxyz=state["odom_from_body_wxyz"],
            linear_vel_of_body_in_world_m_s=state["linear_vel_of_body_in_odom_m_s"],
            angular_vel_of_body_in_world_rad_s=state["angular_vel_of_body_in_odom_rad_s"],
            velocity_command=command,
            position_rad=state["position_rad"][:, order],
            velocity_rad_s=state["velocity_rad_s"][:, order],
            last_action=self.last,
            default_position_rad=self.policy.default_position_rad,
        )).astype(np.float32)  # fmt: skip
        observation = np.nan_to_num(observation)
        if self.policy.session.get_inputs()[0].shape[0] == 1:
            self.last = np.concatenate([self.policy.act(row[None]) for row in observation])
        else:
            self.last = self.policy.act(observation)
        asked = self.policy.setpoint_rad(self.last)
        sent = asked
        for effect in self.software:
            sent = effect.setpoint_rad(sent)
        issued_s = np.full(self.n, 1e-9 * (self.now_ns - START_NS))
        arrival = issued_s
        for channel in self.channel:
            arrival = np.broadcast_to(channel.arrival_s(arrival, self.rng), (self.n,))
        arrival = np.maximum(arrival, self.latest_s)
        self.latest_s = np.where(np.isfinite(arrival), arrival, self.latest_s)
        self.waiting.append((index + 1, arrival, np.asarray(sent)))
        _append(self.ticks, {
            "index": np.full(self.n, index), "robot_stamp_ns": np.full(self.n, self.now_ns), "observation": observation,
            "action": self.last, "velocity_command": command, "command_key": np.full(self.n, index + 1),
            "asked": np.asarray(asked), "sent": np.asarray(sent),
        })  # fmt: skip

    def _deliver(self) -> Array:
        """Set-points over the coming physics step, shape (n, 12).

        One that arrives within the step counts for the share of it that is left: a delay of 4.6 ms acts as such, and
        not as the next multiple of the step.
        """
        step_ns = facts.STATE_PERIOD_NS // SUBSTEPS
        end_s = 1e-9 * (self.now_ns + step_ns - START_NS)
        mean, any_due = self.setpoint, False
        for number, arrival_s, setpoint in self.waiting:
            due = (arrival_s < end_s - 1e-9) & (self.key < number)
            if due.any():
                any_due = True
                share = np.clip((end_s - np.where(due, arrival_s, end_s)) / (1e-9 * step_ns), 0.0, 1.0)[:, None]
                mean = mean + share * (setpoint - mean)
                self.setpoint = np.where(due[:, None], setpoint, self.setpoint)
                stamp = START_NS + np.round(np.where(due, arrival_s, 0.0) * 1e9).astype(np.int64)
                self.received_ns = np.where(due, stamp, self.received_ns)
                self.key = np.where(due, number, self.key)
        if any_due:
            self.waiting = [w for w in self.waiting if np.any(np.isfinite(w[1]) & (self.key < w[0]))]
        return mean

    def _run(self, i: int, states: dict[str, Any], ticks: dict[str, Any]) -> Run:
        script = self.scripts[i]
        m = len(script.velocity_command)
        s = {k: v[:, i] for k, v in states.items()}
        t = {k: v[:m, i] for k, v in ticks.items()}
        last_ns = int(t["robot_stamp_ns"][-1]) + 20_000_000
        keep = s["robot_stamp_ns"] < last_ns
        s = {k: np.ascontiguousarray(v[keep]) for k, v in s.items()}
        n = len(s["robot_stamp_ns"])
        gains = self.policy.gains()
        asked, sent = t.pop("asked"), t.pop("sent")
        stamp = t["robot_stamp_ns"]
        shape = (m, facts.N_JOINTS)
        empty = np.zeros(0, dtype=np.int64)
        return Run(
            path=Path(f"simulated-{script.sequence}-{script.repeat}"),
            header=RunHeader(
                run_id=f"simulated-{script.sequence}-{script.repeat}", started_host_stamp_ns=START_NS,
                command_sequence=script.sequence, repeat=script.repeat, policy_sha256=self.policy.sha256,
                policy_name=self.policy.contract.name,
            ),
            states=StateTable(
                host_stamp_ns=s["robot_stamp_ns"], sequence=np.arange(n),
                imu=ImuTable(empty, empty, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 4))), **s,
            ),
            commands=CommandTable(
                key=t["command_key"], host_stamp_ns=stamp, robot_stamp_ns=stamp, state_robot_stamp_ns=stamp,
                end_robot_stamp_ns=stamp + 100_000_000, requested_position_rad=asked, position_rad=sent,
                velocity_rad_s=np.zeros(shape), load_nm=np.zeros(shape),
                kp_nm_per_rad=np.broadcast_to(gains.kp_nm_per_rad, shape),
                kd_nm_s_per_rad=np.broadcast_to(gains.kd_nm_s_per_rad, shape),
            ),
            ticks=TickTable(
                host_stamp_ns=stamp, mode=np.full(m, "active"), state_age_s=np.zeros(m), inference_s=np.zeros(m),
                compute_s=np.zeros(m), skipped=np.zeros(m, dtype=np.int64), **t,
            ),
            slow_states=_no_polls(),
            events=(),
            footer=None,
        )  # fmt: skip


def _no_polls() -> SlowTable:
    none, stamps = np.zeros(0), np.zeros(0, dtype=np.int64)
    return SlowTable(
        robot_stamp_ns=stamps, host_stamp_ns=stamps, battery_voltage_v=none, battery_current_a=none,
        motors_powered=np.zeros(0, dtype=np.bool_), estopped=np.zeros(0, dtype=np.bool_), battery_charge_percent=none,
        battery_temperature_c=(), motor_temperature_c=np.zeros((0, facts.N_JOINTS)), system_faults=(),
        behavior_faults=(), service_faults=(),
    )  # fmt: skip


def _append(table: dict[str, list[Any]], row: dict[str, Any]) -> None:
    for name, value in row.items():
        table.setdefault(name, []).append(np.array(value))
