"""Runs of one robot, side by side: physics, drives, sensors, estimator and the policy in the loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from spot_model.errors import SpotRlError
from spot_model.policy.observation import Sensed
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.facts import FOOT_RADIUS_M, LEG_NAMES, N_JOINTS, N_LEGS, STATE_PERIOD_NS, Array
from spot_model.robot.mjcf import default_height_m
from spot_model.robot.rotation import multiply_wxyz
from withheld.simulator.body import build_model
from withheld.simulator.drives import Drives
from withheld.simulator.estimator import Estimator
from withheld.simulator.link import Deliveries, deliveries, tick_states
from withheld.simulator.parameters import Settings
from withheld.simulator.power import Battery
from withheld.simulator.recorder import Recorder, RunArrays
from withheld.simulator.robot import Robot
from withheld.simulator.sensors import ContactDetector, InertialUnit, JointSensors

JOINTS_Q, JOINTS_V = slice(7, 7 + N_JOINTS), slice(6, 6 + N_JOINTS)
STATE_S: Final = STATE_PERIOD_NS * 1e-9
FOOT_SENSOR: Final = 4
_NORMAL_FORCES: Final = slice(3, FOOT_SENSOR * N_LEGS, FOOT_SENSOR)
DROP_M: Final = 0.012
HEAT_STATES: Final = 5
"""States over which heat is gathered before the windings warm: they are slow."""


ABSURD: Final = 200.0
"""No body moves at so many m/s, or rad/s."""


class RealityDivergedError(SpotRlError):
    """A simulation broke down; no log is written."""


class Asked(Protocol):
    """What is asked of a controller over time: velocities of a policy, offsets of a joint experiment."""

    @property
    def name(self) -> str:
        """For the log."""
        ...

    @property
    def duration_s(self) -> float:
        """How long it takes."""
        ...

    def at(self, time_s: float) -> Array:
        """What is asked at a time."""
        ...


@dataclass(frozen=True)
class RunRequest:
    """One run to make."""

    sequence: Asked
    rng: np.random.Generator
    """Generator of all that differs from run to run."""


def simulate(robot: Robot, policy: Policy, requests: Sequence[RunRequest], settings: Settings) -> list[RunArrays]:
    """Make runs of one length side by side; each is the same whatever runs beside it.

    Raises:
        ValueError: The sequences have different lengths.
        RealityDivergedError: The simulation broke down.
    """
    lengths = {r.sequence.duration_s for r in requests}
    if len(lengths) != 1:
        raise ValueError(f"runs side by side need one length; these last {sorted(lengths)} s")
    return _Simulation(robot, policy, requests, settings).run()


class _Simulation:
    def __init__(self, robot: Robot, policy: Policy, requests: Sequence[RunRequest], settings: Settings) -> None:
        self.robot, self.policy, self.requests, self.settings = robot, policy, requests, settings
        self.rngs = [r.rng for r in requests]
        n = self.n = len(requests)
        self.model = build_model(robot, settings)
        self.batch = Batch(self.model, n, nthread=1)
        self._qpos, self._qvel, self._applied, self._pushed, self._sensed = (
            self.batch.bind(name) for name in ("qpos", "qvel", "qfrc_applied", "xfrc_applied", "sensordata")
        )
        self._before: Array = np.zeros(0)
        self._geoms, self._centres = self.batch.bind("geom_xpos"), self.batch.bind("xipos")
        self._feet = (
            [self.model.geom(f"{leg}_foot").id for leg in LEG_NAMES],
            [self.model.body(f"{leg}_lleg").id for leg in LEG_NAMES],
        )
        self.n_states = int(np.ceil((settings.ramp_s + requests[0].sequence.duration_s + settings.tail_s) / STATE_S))
        self._start_poses()
        self.position: Array = self._qpos[:, :7]
        self.velocity: Array = self._qvel[:, :6]
        """Of the bodies, now."""
        self.drives = Drives(robot, n, self._qpos[:, JOINTS_Q].copy(), settings.step_s)
        self.battery = Battery(robot.supply, n)
        self._copper: Array = np.zeros((n, N_JOINTS))
        self._n_heats = 0
        self._read_bodies()

    def _start_poses(self) -> None:
        for qpos, rng in zip(self._qpos, self.rngs, strict=True):
            yaw = rng.uniform(-0.6, 0.6)
            qpos[:3] = [*rng.uniform(-0.5, 0.5, 2), default_height_m() + DROP_M]
            qpos[3:7] = [np.cos(0.5 * yaw), 0.0, 0.0, np.sin(0.5 * yaw)]
            qpos[JOINTS_Q] = facts.DEFAULT_POSITION_RAD + rng.normal(0.0, 0.015, N_JOINTS)
        self.batch.forward()

    def _settle(self) -> Array:
        """Stand, from half of the vendor's gains to the policy's; returns the pose that is held, shape (n, 12)."""
        held = np.tile(facts.DEFAULT_POSITION_RAD, (self.n, 1))
        n_steps = round(self.settings.settle_s / self.settings.step_s)
        to = self.policy.gains()
        for step in range(n_steps):
            share = min(1.0, 1.5 * step / n_steps)
            kp = (1.0 - share) * 0.5 * facts.STAND_KP_NM_PER_RAD + share * to.kp_nm_per_rad
            kd = (1.0 - share) * facts.STAND_KD_NM_S_PER_RAD + share * to.kd_nm_s_per_rad
            self._physics(held, *self.drives.true_gains(kp, kd))
            if step % self.settings.steps_per_state == 0:
                self._energy()
        return held

    def _estimator(self, unit: InertialUnit) -> Estimator:
        """The estimator after a while of standing still: upright by its own unit, somewhere in its own odom."""
        attitude = multiply_wxyz(self.position[:, 3:], unit.body_from_unit_wxyz)
        yaw = np.array([rng.uniform(-1.5, 1.5) for rng in self.rngs])
        zero = np.zeros_like(yaw)
        odom_from_world = np.stack([np.cos(0.5 * yaw), zero, zero, np.sin(0.5 * yaw)], axis=1)
        place = np.stack([rng.uniform([-2.0, -2.0, 0.1], [2.0, 2.0, 0.3]) for rng in self.rngs])
        return Estimator(self.robot.estimator, np.asarray(multiply_wxyz(odom_from_world, attitude)), place, STATE_S)

    def _physics(self, setpoint: Array, kp: Array, kd: Array) -> None:
        self._applied[:, JOINTS_V] = self.drives.step(setpoint, kp, kd)
        self.batch.step()
        self._read_bodies()

    def _read_bodies(self) -> None:
        self.drives.follow(self._qpos[:, JOINTS_Q].copy(), self._qvel[:, JOINTS_V].copy())

    def _energy(self) -> None:
        drives = self.drives
        copper = drives.motors.copper_w(drives.motor_nm)
        self._copper = self._copper + copper
        self._n_heats += 1
        if self._n_heats % HEAT_STATES == 0:
            drives.motors.heat(self._copper / HEAT_STATES, HEAT_STATES * STATE_S)
            self._copper = np.zeros_like(copper)
        bus_v = self.battery.step(drives.motor_nm * drives.motion.rotor_rad_s, copper, STATE_S)
        drives.motion.bus_v = bus_v[:, None]
        drives.refresh()

    def _push_body(self, time_s: float) -> None:
        body = self.model.body("body").id
        for part in self.robot.body_forces:
            self._pushed[:, body, :3] = part(self.velocity[:, :3], time_s)
        if not self.robot.foot_forces:
            return
        feet, shanks = self._feet
        place = self._geoms[:, feet].copy()
        speed = (place - self._before) / STATE_S if time_s else np.zeros_like(place)
        force = sum(part(place[..., 2] - FOOT_RADIUS_M, speed) for part in self.robot.foot_forces)
        self._before, self._pushed[:, shanks, :3] = place, force
        self._pushed[:, shanks, 3:] = np.cross(place - self._centres[:, shanks], force)

    def _foot_force_n(self) -> Array:
        """True normal forces, shape (n, 4)."""
        return np.asarray(np.abs(self._sensed[:, _NORMAL_FORCES]))

    def run(self) -> list[RunArrays]:
        """Settle, then simulate."""
        held = self._settle()
        robot, settings, n, m = self.robot, self.settings, self.n, self.n_states
        sub = settings.steps_per_state
        ticks = [tick_states(m, robot.link, rng) for rng in self.rngs]
        ways = [deliveries(m, robot.link, t, robot.delays, rng) for t, rng in zip(ticks, self.rngs, strict=True)]
        sensors = JointSensors(robot, m, self.rngs)
        unit = InertialUnit(robot.sensing, m, sub, self.rngs)
        contacts = ContactDetector(robot.sensing, n, STATE_S)
        estimator = self._estimator(unit)
        record = Recorder(m, max(len(t) for t in ticks), robot.estimator, self.rngs)
        active = self._in_effect(ways)
        is_new = [True, *np.any(active[1:] != active[:-1], axis=1).tolist()]
        number_of = np.full((m, n), -1)
        for run, at in enumerate(ticks):
            number_of[at, run] = np.arange(len(at))
        self.action = np.zeros((n, N_JOINTS), dtype=np.float32)
        self.setpoint, effective = held.copy(), held
        kp, kd = self.drives.true_gains(self.policy.gains().kp_nm_per_rad, self.policy.gains().kd_nm_s_per_rad)
        runs = np.arange(n)
        unit.note(0, self.position[:, 3:], self.velocity)
        for state in range(m):
            reading = sensors.read(state, self.drives, STATE_S)
            turn, felt = unit.sense(state)
            estimator.step(turn, felt, reading.position_rad, reading.velocity_rad_s, contacts.age, contacts.force_n)
            record.put(state, reading, estimator, contacts.see(self._foot_force_n()), self.battery, self.drives)
            ticking = np.flatnonzero(number_of[state] >= 0)
            if len(ticking):
                self._tick(record, ticking, number_of[state, ticking], state, held)
            record.sent[state] = self.setpoint
            if robot.body_forces or robot.foot_forces:
                self._push_body(state * STATE_S)
            for step in range(state * sub, (state + 1) * sub):
                if is_new[step]:
                    chosen = active[step]
                    effective = np.where((chosen >= 0)[:, None], record.sent[np.maximum(chosen, 0), runs], held)
                self._physics(effective, kp, kd)
                unit.note(step + 1, self.position[:, 3:], self.velocity)
            self._energy()
            if not float(np.abs(self.velocity).max()) < ABSURD:
                raise RealityDivergedError(
                    f"a reality broke down {state * STATE_S:.2f} s into its runs: its body moves at an impossible "
                    "speed; draw another case"
                )
        return record.runs(ways, ticks, settings.ramp_s, unit)

    def _in_effect(self, ways: Sequence[Deliveries]) -> NDArray[np.intp]:
        """The command in effect at the beginning of each physics step, shape (steps, n)."""
        sub = self.settings.steps_per_state
        instants = np.arange(self.n_states * sub, dtype=np.int64) * STATE_PERIOD_NS // sub
        return np.stack([w.newest(instants) for w in ways], axis=1)

    def _tick(
        self, record: Recorder, runs: NDArray[np.intp], numbers: NDArray[np.intp], state: int, held: Array
    ) -> None:
        """Run the policy in some of the runs; their set-points and actions change.

        Args:
            record: Keeps what the policy saw and said.
            runs: Which runs, shape (k,).
            numbers: Of their ticks, shape (k,).
            state: The state that is answered.
            held: Set-points of the stand, shape (n, 12).
        """
        ramp_s, time_s = self.settings.ramp_s, state * STATE_S - self.settings.ramp_s
        command = np.stack([self.requests[i].sequence.at(max(0.0, time_s)) for i in runs]) * (time_s >= 0.0)
        joints = record.joints[state, runs]
        sensed = Sensed(
            world_from_body_wxyz=record.attitude[state, runs],
            linear_vel_of_body_in_world_m_s=record.linear[state, runs],
            angular_vel_of_body_in_world_rad_s=record.angular[state, runs],
            position_rad=joints[:, :N_JOINTS],
            velocity_rad_s=joints[:, N_JOINTS : 2 * N_JOINTS],
        )
        observed = self.policy.observe_many(sensed, command, self.action[runs])
        observation = np.nan_to_num(observed).astype(np.float32)
        action = np.concatenate([self.policy.act(row[None]) for row in observation])
        asked = self.policy.setpoint_rad(action)
        for part in self.robot.setpoints:
            asked = part(asked)
        if self.policy.session is None:
            # A joint experiment: no network saw or said anything, and nobody asked for a velocity.
            observation, action, command = np.full((3, len(runs), 1), np.nan)
        record.observation[numbers, runs], record.action[numbers, runs] = observation, action
        share = min(1.0, max(0.0, 1.0 + time_s / ramp_s))
        blend = share * share * (3.0 - 2.0 * share)
        blended = held[runs] + blend * (asked - held[runs]) if blend < 1.0 else asked
        record.command[numbers, runs], record.requested[numbers, runs] = command, blended
        self.setpoint[runs] = np.clip(blended, facts.POSITION_LOW_RAD, facts.POSITION_HIGH_RAD)
        self.action[runs] = action
