"""Logs of a simulated robot, for tests: other time step, integrator, cone and contact than the search's."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spot_model.io.model_file import RobotModel
from spot_model.plant.delay import ConstantDelay, Delay
from spot_model.plant.plant import Plant, PlantOptions, ServoCommand
from spot_model.policy.observation import build_observation
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.mjcf import MjcfOptions, default_height_m
from trainer.sysid.logs.logged_run import Array, Commands, LoggedRun, States, Ticks

POLICY_PERIOD_STATES = (7, 7, 6)
"""State messages in each control period of a 50 Hz policy on a 3 ms stream."""


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviations of white noise on the state message."""

    position_rad: float = 0.0
    velocity_rad_s: float = 0.0
    load_nm: float = 0.0
    linear_vel_m_s: float = 0.0
    angular_vel_rad_s: float = 0.0


@dataclass(frozen=True)
class SimulatedRobot:
    """A robot that makes logs."""

    model: RobotModel
    """Hidden truth; its command delay is not used, ``delay`` is."""
    noise: SensorNoise = SensorNoise()
    delay: Delay = field(default_factory=lambda: ConstantDelay(delay_s=facts.TRAINING_COMMAND_DELAY_S))
    """From the state's stamp to the receipt of the command that answers it."""
    mjcf: MjcfOptions = field(
        default_factory=lambda: MjcfOptions(
            timestep_s=0.001,
            integrator="implicitfast",
            cone="elliptic",
            contact_solref=(0.008, 1.0),
            collision="feet",
            link_torque_sensors=True,
        )
    )


def simulate_logs(
    robot: SimulatedRobot,
    policy: Policy,
    sequence: str,
    velocity_command: Array,
    n_repeats: int,
    rng: np.random.Generator,
) -> list[LoggedRun]:
    """Run one command sequence several times.

    Args:
        robot: What makes the logs.
        policy: The policy.
        sequence: Name of the sequence.
        velocity_command: One command a policy tick, shape (n_ticks, 3).
        n_repeats: Number of runs; they differ by noise, delays and a slightly different start.
        rng: Source of all differences.
    """
    effects = [e for e in robot.model.effects if e.hook.value != "command"]
    plant = Plant(effects, n_repeats, PlantOptions(mjcf=robot.mjcf, n_threads=1))
    pose = facts.DEFAULT_POSITION_RAD + 0.02 * rng.standard_normal((n_repeats, facts.N_JOINTS))
    plant.reset(joint_position_rad=pose, position_of_body_in_world_m=(0.0, 0.0, default_height_m() + 0.01))
    recorder = _Recorder(robot, policy, velocity_command, n_repeats, rng)
    recorder.run(plant)
    return [recorder.logged(i, sequence) for i in range(n_repeats)]


class _Recorder:
    def __init__(
        self, robot: SimulatedRobot, policy: Policy, commands: Array, n: int, rng: np.random.Generator
    ) -> None:
        self.robot, self.policy, self.velocity_command, self.n, self.rng = robot, policy, commands, n, rng
        self.steps_per_state = round(facts.STATE_PERIOD_NS * 1e-9 / robot.mjcf.timestep_s)
        self.start_ns = 1_000_000_000_000
        self.states: list[dict[str, NDArray[np.float64]]] = []
        self.state_ns: list[int] = []
        self.ticks: list[dict[str, NDArray[Any]]] = []
        self.tick_ns: list[int] = []
        self.delays: list[NDArray[np.float64]] = []

    def run(self, plant: Plant) -> None:
        gains = self.policy.gains()
        last_action = np.zeros((self.n, facts.N_JOINTS), dtype=np.float32)
        active = plant.joint_position_rad
        key = np.zeros(self.n)
        received_ns = np.zeros(self.n)
        waiting: list[tuple[int, NDArray[np.float64], Array]] = []
        now_ns = self.start_ns
        step_ns = round(self.robot.mjcf.timestep_s * 1e9)
        for tick, command in enumerate(self.velocity_command):
            for message in range(POLICY_PERIOD_STATES[tick % 3]):
                state = self._sense(plant, key, received_ns)
                self.states.append(state)
                self.state_ns.append(now_ns)
                if message == 0:
                    observation = self._observe(state, command, last_action)
                    last_action = self.policy.act(observation)
                    self.ticks.append({"observation": observation, "action": last_action, "command": command})
                    self.tick_ns.append(now_ns)
                    delay = self.robot.delay.sample(self.rng, self.n)
                    self.delays.append(delay)
                    waiting.append((tick + 1, now_ns + 1e9 * delay, self._setpoint(last_action)))
                for _ in range(self.steps_per_state):
                    for number, arrival_ns, setpoint in waiting:
                        due = (arrival_ns <= now_ns) & (key < number)
                        active = np.where(due[:, None], setpoint, active)
                        received_ns = np.where(due, arrival_ns, received_ns)
                        key = np.where(due, number, key)
                    waiting = [w for w in waiting if np.any(key < w[0])]
                    plant.command(
                        ServoCommand(
                            position_rad=active,
                            kp_nm_per_rad=gains.kp_nm_per_rad,
                            kd_nm_s_per_rad=gains.kd_nm_s_per_rad,
                        )
                    )
                    plant.advance()
                    now_ns += step_ns

    def _sense(self, plant: Plant, key: Array, received_ns: Array) -> dict[str, Array]:
        noise = self.robot.noise

        def noisy(value: Array, sigma: float) -> Array:
            return value + sigma * self.rng.standard_normal(value.shape)

        return {
            "position": noisy(plant.joint_position_rad, noise.position_rad),
            "velocity": noisy(plant.joint_velocity_rad_s, noise.velocity_rad_s),
            "load": noisy(plant.link_torque_nm, noise.load_nm),
            "attitude": plant.world_from_body_wxyz,
            "linear": noisy(plant.linear_vel_of_body_in_world_m_s, noise.linear_vel_m_s),
            "angular": noisy(plant.angular_vel_of_body_in_world_rad_s, noise.angular_vel_rad_s),
            "key": key.copy(),
            "received": received_ns.copy(),
        }

    def _setpoint(self, action: NDArray[np.float32]) -> Array:
        return np.clip(self.policy.setpoint_rad(action), facts.POSITION_LOW_RAD, facts.POSITION_HIGH_RAD)

    def _observe(self, state: dict[str, Array], command: Array, last_action: NDArray[np.float32]) -> Array:
        order = self.policy.policy_from_canonical
        return np.asarray(
            build_observation(
                world_from_body_wxyz=state["attitude"],
                linear_vel_of_body_in_world_m_s=state["linear"],
                angular_vel_of_body_in_world_rad_s=state["angular"],
                velocity_command=np.tile(command, (self.n, 1)),
                position_rad=state["position"][:, order],
                velocity_rad_s=state["velocity"][:, order],
                last_action=last_action,
                default_position_rad=self.policy.default_position_rad,
            )
        ).astype(np.float32)

    def logged(self, i: int, sequence: str) -> LoggedRun:
        def of_states(name: str) -> Array:
            return np.array([s[name][i] for s in self.states])

        action = np.array([t["action"][i] for t in self.ticks], dtype=np.float32)
        tick_ns = np.array(self.tick_ns, dtype=np.int64)
        gains = self.policy.gains()
        n_ticks = len(tick_ns)
        return LoggedRun(
            source=f"simulated {sequence} {i}",
            sequence=sequence,
            repeat=i,
            policy_sha256=self.policy.sha256,
            ticks=Ticks(
                robot_stamp_ns=tick_ns,
                observation=np.array([t["observation"][i] for t in self.ticks], dtype=np.float32),
                action=action,
                velocity_command=np.array([t["command"] for t in self.ticks]),
            ),
            commands=Commands(
                key=np.arange(1, n_ticks + 1),
                robot_stamp_ns=tick_ns,
                state_robot_stamp_ns=tick_ns,
                position_rad=self._setpoint(action),
                kp_nm_per_rad=np.tile(gains.kp_nm_per_rad, (n_ticks, 1)),
                kd_nm_s_per_rad=np.tile(gains.kd_nm_s_per_rad, (n_ticks, 1)),
            ),
            states=States(
                robot_stamp_ns=np.array(self.state_ns, dtype=np.int64),
                position_rad=of_states("position"),
                velocity_rad_s=of_states("velocity"),
                load_nm=of_states("load"),
                odom_from_body_wxyz=of_states("attitude"),
                linear_vel_of_body_in_odom_m_s=of_states("linear"),
                angular_vel_of_body_in_odom_rad_s=of_states("angular"),
                last_command_key=of_states("key").astype(np.int64),
                last_command_robot_stamp_ns=of_states("received").astype(np.int64),
            ),
        )
