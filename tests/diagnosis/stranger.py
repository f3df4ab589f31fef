"""A robot of another hand: its own servo loop, friction, load cells, transport and estimator around bare MuJoCo.

Nothing of it is shared with the plant or with the effects: LuGre friction in place of Coulomb's, a load cell with one
pole, a link with a floor and a gamma tail, masses and gains that scatter. It is there to find mistakes of mechanism;
no number of the diagnosis is chosen on it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from spot_log.format.records import RunHeader
from spot_log.read.run import ImuTable, Run, StateTable, run_of_columns
from spot_model.policy.observation import build_observation
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.mjcf import MjcfOptions, default_height_m, spot_mjcf
from spot_model.robot.rotation import rotate_wxyz

Array = NDArray[np.float64]
STEP_MS = 1
START_NS = 1_650_000_000_000_000_000
TICK_STATES = (7, 7, 6)
TEETH_NM_PER_RAD, TEETH_NM_S_PER_RAD, ROTOR_KG_M2 = 4e3, 8.0, 0.04
BOOT_M = 0.2
STAND_S = 0.6
"""The robot stands under the default pose before the policy takes over."""


@dataclass(frozen=True)
class Errors:
    """Standard deviations (or ranges) of what differs from the nominal robot without being a fault."""

    gain: float = 0.07
    mass: float = 0.04
    friction_nm: tuple[float, float] = (0.02, 0.2)
    load_gain: float = 0.02
    load_lag_s: tuple[float, float] = (0.001, 0.004)
    transport_floor_s: float = 0.003
    transport_mean_s: float = 0.0012
    contact_s: tuple[float, float] = (0.008, 0.02)
    estimator_lag_s: tuple[float, float] = (0.0, 0.02)
    estimator_scale: float = 0.01


@dataclass(frozen=True)
class Faults:
    """What is wrong, each by joint name or number; empty for a faultless robot."""

    gain: Mapping[str, float] = field(default_factory=dict)
    friction_nm: Mapping[str, float] = field(default_factory=dict)
    load_share: Mapping[str, float] = field(default_factory=dict)
    """Of the motor's torque, by which friction grows with it."""
    armature_kg_m2: Mapping[str, float] = field(default_factory=dict)
    limit_nm: Mapping[str, float] = field(default_factory=dict)
    spring_nm_per_rad: Mapping[str, float] = field(default_factory=dict)
    encoder_rad: Mapping[str, float] = field(default_factory=dict)
    payload_kg: float = 0.0
    boot_kg: Mapping[str, float] = field(default_factory=dict)
    """By leg, a point on the lower leg, :data:`BOOT_M` below the knee."""
    command_delay_s: float = 0.0
    effort_delay_s: float = 0.0
    play_rad: Mapping[str, float] = field(default_factory=dict)
    """Between rotor and link, which the encoder sits on; with it, every joint has a rotor of its own."""


def _by_joint(values: Mapping[str, float], otherwise: float) -> Array:
    """Keys are joint names, or ends of them: "kn" is all knees, "" is all joints."""
    out = np.full(facts.N_JOINTS, otherwise)
    for key, value in values.items():
        out[[name.endswith(key) for name in facts.JOINT_NAMES]] = value
    return out


def _add_point(model: Any, body: int, kg: float, place: Array) -> None:
    """A point mass on a body: mass, centre of mass and inertia by the parallel-axis theorem."""
    whole = model.body_mass[body] + kg
    arm = place - model.body_ipos[body]
    model.body_inertia[body] += model.body_mass[body] * kg / whole * (arm @ arm - arm**2)
    model.body_ipos[body] += kg / whole * arm
    model.body_mass[body] = whole


class Stranger:
    """One robot; every call of :meth:`walk` gives more logs of it."""

    def __init__(self, policy: Policy, seed: int, faults: Faults | None = None, errors: Errors | None = None) -> None:
        self.policy, self.faults, self.errors = policy, faults or Faults(), errors or Errors()
        rng = np.random.default_rng(seed)
        e, f, n = self.errors, self.faults, facts.N_JOINTS
        self.seed = seed
        by_type = np.tile(1.0 + 0.7 * e.gain * rng.standard_normal(3), facts.N_LEGS)
        self.gain = by_type * (1.0 + 0.7 * e.gain * rng.standard_normal(n)) * _by_joint(f.gain, 1.0)
        self.level = rng.uniform(*e.friction_nm, n) + _by_joint(f.friction_nm, 0.0)
        self.load_share = _by_joint(f.load_share, 0.0)
        self.load_gain = 1.0 + e.load_gain * rng.standard_normal(n)
        self.load_lag_s = rng.uniform(*e.load_lag_s)
        self.mass = 1.0 + e.mass * rng.standard_normal(30)
        self.contact_s = rng.uniform(*e.contact_s)
        self.estimator_lag_s = rng.uniform(*e.estimator_lag_s)
        self.estimator_scale = 1.0 + e.estimator_scale * rng.standard_normal()
        self.limit, self.encoder = _by_joint(f.limit_nm, np.inf), _by_joint(f.encoder_rad, 0.0)
        self.play = _by_joint(f.play_rad, 0.0)
        self.spring, self.armature = _by_joint(f.spring_nm_per_rad, 0.0), _by_joint(f.armature_kg_m2, 0.0)

    def _model(self) -> Any:
        options = MjcfOptions(
            timestep_s=1e-3 * STEP_MS,
            integrator="implicitfast",
            cone="elliptic",
            contact_solref=(self.contact_s, 1.05),
            contact_solimp=(0.88, 0.96, 0.002),
            foot_friction=0.75,
            collision="all",
            visuals=False,
            armature_kg_m2=tuple(self.armature.tolist()),
        )
        model = mujoco.MjModel.from_xml_string(spot_mjcf(options))
        scale = self.mass[: model.nbody]
        model.body_mass[:] *= scale
        model.body_inertia[:] *= scale[:, None]
        for leg, kg in self.faults.boot_kg.items():
            _add_point(model, model.body(f"{leg}_lleg").id, kg, np.array([0.0, 0.0, -BOOT_M]))
        body = model.body("body").id
        if self.faults.payload_kg:
            share = self.faults.payload_kg / (model.body_mass[body] + self.faults.payload_kg)
            model.body_ipos[body] += share * (np.array([0.05, 0.0, 0.15]) - model.body_ipos[body])
            model.body_mass[body] += self.faults.payload_kg
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return model

    def walk(
        self, sequences: Mapping[str, Sequence[Sequence[float]]], repeats: int, seconds: float, seed: int = 0
    ) -> list[Run]:
        """Logs: each sequence (rows of time share, v_x, v_y, turn; straight lines between) ``repeats`` times."""
        names = [(s, r) for s in sequences for r in range(repeats)]
        n_ticks = round(seconds * facts.POLICY_RATE_HZ)
        at = np.linspace(0.0, 1.0, n_ticks)
        commands = np.stack(
            [
                np.stack(
                    [np.interp(at, np.array(sequences[s])[:, 0], np.array(sequences[s])[:, k]) for k in (1, 2, 3)], 1
                )
                for s, _ in names
            ]
        )
        return _Walk(self, names, commands, np.random.default_rng((self.seed, seed))).runs()


class _Walk:
    def __init__(
        self, robot: Stranger, names: list[tuple[str, int]], commands: Array, rng: np.random.Generator
    ) -> None:
        self.robot, self.names, self.commands, self.rng, self.n = robot, names, commands, rng, len(names)
        self.batch = Batch(robot._model(), self.n, nthread=1)
        self.qpos, self.qvel, self.qacc = (self.batch.bind(name) for name in ("qpos", "qvel", "qacc"))
        self.ctrl, self.sensors = self.batch.bind("ctrl"), self.batch.bind("sensordata")
        self.batch.reset(np.arange(self.n), stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        self.qpos[:, 2] = default_height_m() + 0.005
        self.qpos[:, 7:] = facts.DEFAULT_POSITION_RAD + 0.02 * rng.standard_normal((self.n, 12))
        self.batch.forward(np.arange(self.n))
        self.bristle, self.load = np.zeros((self.n, 12)), np.zeros((self.n, 12))
        self.asked: list[Array] = []
        self.rotor, self.rotor_speed = self.qpos[:, 7:].copy(), np.zeros((self.n, 12))
        self.velocity = np.zeros((self.n, 3))
        self.setpoint = np.tile(facts.DEFAULT_POSITION_RAD, (self.n, 1))
        self.key, self.received = np.zeros(self.n, dtype=np.int64), np.zeros(self.n, dtype=np.int64)
        self.waiting: list[tuple[int, Array, Array]] = []
        self.latest = np.zeros(self.n)
        self.now_ms = 0
        self.states: dict[str, list[Any]] = {}
        self.ticks: dict[str, list[Any]] = {}
        self.kp, self.kd = robot.policy.gains().kp_nm_per_rad, robot.policy.gains().kd_nm_s_per_rad

    def runs(self) -> list[Run]:
        for _ in range(round(STAND_S * 1e3)):
            self._step()
        last = np.zeros((self.n, 12), dtype=np.float32)
        for tick in range(self.commands.shape[1]):
            for message in range(TICK_STATES[tick % 3]):
                state = self._sense()
                if message == 0:
                    last = self._tick(tick, state, last)
                for _ in range(3):
                    self._step()
        return [self._run(i) for i in range(self.n)]

    def _step(self) -> None:
        robot, dt = self.robot, 1e-3
        now = 1e-3 * self.now_ms
        for number, arrival, setpoint in self.waiting:
            due = (arrival <= now) & (self.key < number)
            self.setpoint = np.where(due[:, None], setpoint, self.setpoint)
            self.received = np.where(due, START_NS + (arrival * 1e9).astype(np.int64), self.received)
            self.key = np.where(due, number, self.key)
        self.waiting = [w for w in self.waiting if np.any(self.key < w[0])]
        q, v = self.qpos[:, 7:], self.qvel[:, 6:]
        asked = self.kp * (self.setpoint - q - robot.encoder) - self.kd * v
        self.asked.append(asked)
        late = round(robot.faults.effort_delay_s * 1e3)
        asked = self.asked[max(0, len(self.asked) - 1 - late)]
        self.asked = self.asked[-(late + 2) :]
        motor = np.clip(robot.gain * asked, -robot.limit, robot.limit)
        if robot.faults.play_rad:
            motor = self._through_play(motor, q, v)
        # LuGre, the bristle implicit in time: sticks over 2 mrad, 20 % more at rest.
        sliding = robot.level + robot.load_share * np.abs(motor)
        level = sliding * (1.0 + 0.2 * np.exp(-np.abs(v) / 0.1))
        stiffness = sliding / 0.002
        rate = stiffness * np.abs(v) / np.maximum(level, 1e-9)
        before = self.bristle
        self.bristle = (before + dt * v) / (1.0 + dt * rate)
        friction = stiffness * self.bristle + 0.02 * v
        spring = robot.spring * (q - facts.DEFAULT_POSITION_RAD)
        self.ctrl[...] = motor - friction - spring
        self.batch.step()
        self.now_ms += STEP_MS
        link = robot.load_gain * (self.ctrl - robot.armature * self.qacc[:, 6:])
        self.load += (1.0 - np.exp(-dt / robot.load_lag_s)) * (link - self.load)
        keep = np.exp(-dt / robot.estimator_lag_s) if robot.estimator_lag_s > 1e-4 else 0.0
        self.velocity = keep * self.velocity + (1.0 - keep) * robot.estimator_scale * self.qvel[:, :3]

    def _through_play(self, motor: Array, q: Array, v: Array) -> Array:
        """Mean torque of stiff teeth on the link over the step; the rotor is thrown across the gap between them."""
        parts, passed = 50, np.zeros_like(motor)
        dt, half = 1e-3 * STEP_MS / parts, 0.5 * self.robot.play
        for k in range(parts):
            apart, speed = self.rotor - q - k * dt * v, self.rotor_speed - v
            pressed = np.sign(apart) * np.maximum(np.abs(apart) - half, 0.0)
            teeth = np.where(pressed != 0.0, TEETH_NM_PER_RAD * pressed + TEETH_NM_S_PER_RAD * speed, 0.0)
            teeth = np.where(teeth * pressed > 0.0, teeth, 0.0)
            self.rotor_speed = self.rotor_speed + dt * (motor - teeth) / ROTOR_KG_M2
            self.rotor = self.rotor + dt * self.rotor_speed
            passed += teeth / parts
        return passed

    def _sense(self) -> dict[str, Array]:
        def noisy(value: Array, sigma: float) -> Array:
            return np.asarray(value + sigma * self.rng.standard_normal(value.shape))

        attitude = self.qpos[:, 3:7].copy()
        state = {
            "robot_stamp_ns": np.full(self.n, START_NS + self.now_ms * 1_000_000),
            "position_rad": noisy(self.qpos[:, 7:] + self.robot.encoder, 2e-4),
            "velocity_rad_s": noisy(self.qvel[:, 6:], 0.03),
            "load_nm": noisy(self.load, 0.3),
            "position_of_body_in_odom_m": self.qpos[:, :3].copy(),
            "odom_from_body_wxyz": attitude,
            "linear_vel_of_body_in_odom_m_s": noisy(self.velocity, 0.01),
            "angular_vel_of_body_in_odom_rad_s": noisy(np.asarray(rotate_wxyz(attitude, self.qvel[:, 3:6])), 0.01),
            "foot_contact": self.sensors[:, 0:16:4] > 0.5,
            "last_command_key": self.key.copy(),
            "last_command_robot_stamp_ns": self.received.copy(),
        }
        for name, value in state.items():
            self.states.setdefault(name, []).append(value)
        return state

    def _tick(self, index: int, state: dict[str, Array], last: NDArray[np.float32]) -> NDArray[np.float32]:
        policy, order = self.robot.policy, self.robot.policy.policy_from_canonical
        observation = np.asarray(
            build_observation(
                world_from_body_wxyz=state["odom_from_body_wxyz"],
                linear_vel_of_body_in_world_m_s=state["linear_vel_of_body_in_odom_m_s"],
                angular_vel_of_body_in_world_rad_s=state["angular_vel_of_body_in_odom_rad_s"],
                velocity_command=self.commands[:, index],
                position_rad=state["position_rad"][:, order],
                velocity_rad_s=state["velocity_rad_s"][:, order],
                last_action=last,
                default_position_rad=policy.default_position_rad,
            )
        ).astype(np.float32)
        action = np.concatenate([policy.act(row[None]) for row in observation])
        e = self.robot.errors
        wait = e.transport_floor_s + self.rng.gamma(2.0, 0.5 * e.transport_mean_s, self.n)
        self.latest = np.maximum(self.latest, 1e-3 * self.now_ms + wait + self.robot.faults.command_delay_s)
        sent = np.asarray(policy.setpoint_rad(action))
        self.waiting.append((index + 1, self.latest.copy(), sent))
        row = {
            "index": np.full(self.n, index),
            "robot_stamp_ns": state["robot_stamp_ns"],
            "observation": observation,
            "action": action,
            "velocity_command": self.commands[:, index].copy(),
            "command_key": np.full(self.n, index + 1),
            "sent": sent,
        }
        for name, value in row.items():
            self.ticks.setdefault(name, []).append(value)
        return action

    def _run(self, i: int) -> Run:
        s = {k: np.array([row[i] for row in v]) for k, v in self.states.items()}
        t = {k: np.array([row[i] for row in v]) for k, v in self.ticks.items()}
        name, repeat = self.names[i]
        sent, stamp, shape = t.pop("sent"), t["robot_stamp_ns"], (len(t["index"]), facts.N_JOINTS)
        header = RunHeader(
            run_id=f"stranger-{self.robot.seed}-{name}-{repeat}",
            started_host_stamp_ns=START_NS,
            command_sequence=name,
            repeat=repeat,
            policy_sha256=self.robot.policy.sha256,
            policy_name=self.robot.policy.contract.name,
            policy_contract_json=self.robot.policy.contract.to_json(),
        )
        commands = {
            "key": t["command_key"],
            "host_stamp_ns": stamp,
            "robot_stamp_ns": stamp + 1_500_000,
            "state_robot_stamp_ns": stamp,
            "end_robot_stamp_ns": stamp + 100_000_000,
            "requested_position_rad": sent,
            "position_rad": sent,
            "velocity_rad_s": np.zeros(shape),
            "load_nm": np.zeros(shape),
            "kp_nm_per_rad": np.broadcast_to(self.kp, shape),
            "kd_nm_s_per_rad": np.broadcast_to(self.kd, shape),
        }
        ticks = {"host_stamp_ns": stamp, "mode": np.full(len(stamp), "active"), **t}
        return run_of_columns(Path(header.run_id), header, states=s, commands=commands, ticks=ticks)


SEQUENCES: Mapping[str, Sequence[Sequence[float]]] = {
    "forward": ((0, 0, 0, 0), (0.15, 0.6, 0, 0), (0.5, 1.3, 0, 0), (0.8, 0.5, 0, 0), (1, 0.3, 0, 0)),
    "turn": ((0, 0, 0, 0), (0.2, 0.6, 0, 0.6), (0.6, 0.8, 0, -0.7), (1, 0.4, 0, 0)),
    "sideways": ((0, 0, 0, 0), (0.2, 0.4, 0.4, 0), (0.6, 0.5, -0.4, 0), (1, 0.8, 0, 0.3)),
}


def uneven(n_states: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Rows of a 3 ms stream at steps of 15, 18 and 21 ms, as a real recording of 55 Hz has them."""
    return np.cumsum(rng.integers(5, 8, n_states // 7))


def thinned(run: Run, at: NDArray[np.intp]) -> Run:
    """The run with these states alone: no receipts, no contact flags, no inertial unit, no policy."""
    none = np.zeros(0, dtype=np.int64)
    columns = {f.name: getattr(run.states, f.name)[at] for f in dataclasses.fields(StateTable) if f.name != "imu"}
    columns |= {
        "sequence": np.arange(len(at)),
        "last_command_key": np.zeros(len(at), dtype=np.int64),
        "last_command_robot_stamp_ns": np.zeros(len(at), dtype=np.int64),
        "foot_contact": np.zeros((len(at), 0), dtype=np.bool_),
    }
    imu = ImuTable(none, none, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 4)))
    header = dataclasses.replace(run.header, policy_contract_json="", policy_name="", policy_sha256="")
    return dataclasses.replace(run, header=header, states=StateTable(imu=imu, **columns))
