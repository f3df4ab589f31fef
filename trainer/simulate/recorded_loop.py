"""Closed loops of simulated robots, kept as the log of a real run would be: every state, tick, command and receipt."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from spot_log.format.events import FOLLOWING_MODE
from spot_log.format.records import RunHeader
from spot_log.read.run import Run, run_of_columns
from spot_model.effects.base import CommandEffect, SoftwareEffect
from spot_model.plant.closed_loop import ClosedLoop, LoopTick, schedule_by_messages
from spot_model.plant.command_path import ReceiptPath
from spot_model.plant.plant import Plant
from spot_model.policy.joint_script import JointScript
from spot_model.policy.observation import Sensed
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.arrays import copy_of, like, namespace_of, on_host
from spot_model.robot.facts import Array
from spot_model.robot.rotation import AnyArray, rotate_wxyz

START_NS = 1_000_000_000_000
"""Robot time of a simulated run's first state."""
N_QUATERNION: Final = 4


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviations of white noise on the state message, which the policy sees and the log holds."""

    position_rad: float = 0.0
    velocity_rad_s: float = 0.0
    load_nm: float = 0.0
    linear_vel_m_s: float = 0.0
    angular_vel_rad_s: float = 0.0


@dataclass(frozen=True)
class Course:
    """The commands of one simulated robot, and the name of its run."""

    sequence: str
    repeat: int
    velocity_command: Array
    """One a policy tick, shape (n_ticks, 3); of a joint script, its offsets, shape (n_ticks, 12)."""


@dataclass
class RecordedLoop:
    """Runs one closed loop of ``len(courses)`` robots and gives their logs.

    Args:
        plant: Robots in their initial state, without command and software effects.
        policy: What controls.
        courses: One a robot.
        start_setpoint_rad: In effect until the first command arrives, shape (n, 12), canonical order.
        last_action: The network's output before the first tick, shape (n, 12), policy order.
        channel: Effects on the commands' way.
        rng: Draws the sensors' noise and what those effects draw.
        noise: Of the sensors.
        software: Effects of the program that drives the robot.
        only_ticks: Keep only the states that the policy saw.
        tick_period_s: Of the program that runs the policy.
    """

    plant: Plant
    policy: Policy
    courses: Sequence[Course]
    start_setpoint_rad: Array
    last_action: NDArray[np.float32]
    channel: Sequence[CommandEffect]
    rng: np.random.Generator
    noise: SensorNoise = SensorNoise()
    software: Sequence[SoftwareEffect] = ()
    only_ticks: bool = False
    tick_period_s: float = 1.0 / facts.POLICY_RATE_HZ
    _states: dict[str, list[Any]] = field(default_factory=dict, init=False)
    _ticks: dict[str, list[Any]] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        position = self.plant.joint_position_rad
        start = like(position, self.start_setpoint_rad)
        self._draws = self.plant.draws(self.rng)
        self._software = [effect.arrays_like(position) for effect in self.software]
        self._look = self.plant.recorded(self._look_now, self._draws)
        self._path = ReceiptPath(self.plant, self.policy.gains(), start, self.channel, self._draws, START_NS)

    def runs(self, tell: Callable[[float], None] = lambda _: None) -> list[Run]:
        """Simulate; ``tell`` is called with the share that was done before each tick."""
        n_ticks = max(len(t.velocity_command) for t in self.courses)
        commands = np.stack([padded(t.velocity_command, n_ticks) for t in self.courses])
        steps = round(facts.STATE_PERIOD_NS * 1e-9 / self.plant.timestep_s)
        loop = ClosedLoop(self.plant, self.policy, path=self, sense=self._sense, see=lambda _, o: _as_seen(o))
        schedule = schedule_by_messages(n_ticks, steps, self.tick_period_s)
        if self.only_ticks:
            schedule = [(sum(messages),) for messages in schedule]
        for tick in loop.run(lambda i: commands[:, i], schedule, self.last_action):
            self._keep(tick)
            tell(tick.index / n_ticks)
        # Rows go as they are stacked: of many long runs, both at once would be the most that is ever in memory.
        states, ticks = ({name: stacked(own.pop(name)) for name in list(own)} for own in (self._states, self._ticks))
        return [self._run(i, states, ticks) for i in range(len(self.courses))]

    # The loop's command path ------------------------------------------------------------------------------------------

    def send(self, number: int, setpoint_rad: Array) -> None:
        """Issue a command, changed by the software's effects; both are kept."""
        sent = setpoint_rad
        for effect in self._software:
            sent = effect.setpoint_rad(sent)
        _append(self._ticks, {"stamp": self._path.now_ns, "requested": setpoint_rad, "sent": sent})
        self._path.send(number, sent)

    def advance(self, n_steps: int) -> None:
        """Move the plant by physics steps."""
        self._path.advance(n_steps)

    def _sense(self, _: int) -> Sensed:
        sensed: Sensed
        sensed, columns = self._look()
        _append(self._states, {"robot_stamp_ns": self._path.now_ns, **columns})
        return sensed

    def _look_now(self) -> tuple[Sensed, dict[str, AnyArray]]:
        """What the policy may see, and the columns of a state."""
        reading, estimate, noise = self.plant.reading, self.plant.estimate, self.noise
        attitude = copy_of(estimate.world_from_body_wxyz)
        linear = rotate_wxyz(attitude, estimate.linear_vel_of_body_in_body_m_s)
        angular = rotate_wxyz(attitude, estimate.angular_vel_of_body_in_body_rad_s)
        position = self._noisy(reading.position_rad, noise.position_rad)
        velocity = self._noisy(reading.velocity_rad_s, noise.velocity_rad_s)
        load = self._noisy(reading.load_nm, noise.load_nm)
        linear = self._noisy(linear, noise.linear_vel_m_s)
        angular = self._noisy(angular, noise.angular_vel_rad_s)
        columns = {
            "position_rad": position,
            "velocity_rad_s": velocity,
            "load_nm": load,
            "position_of_body_in_odom_m": self.plant.position_of_body_in_world_m,
            "odom_from_body_wxyz": attitude,
            "linear_vel_of_body_in_odom_m_s": linear,
            "angular_vel_of_body_in_odom_rad_s": angular,
            "foot_contact": estimate.foot_contact > 0.5,
            "last_command_key": self._path.key,
            "last_command_robot_stamp_ns": self._path.received_ns,
        }
        return Sensed(position, velocity, attitude, linear, angular), columns

    def _noisy(self, value: AnyArray, sigma: float) -> AnyArray:
        return value + sigma * self._draws.standard_normal(tuple(value.shape))

    def _keep(self, tick: LoopTick) -> None:
        kept = {"observation": tick.observation, "action": tick.action, "velocity_command": tick.velocity_command}
        _append(self._ticks, kept)

    def _run(self, i: int, states: dict[str, Any], ticks: dict[str, Any]) -> Run:
        course, gains = self.courses[i], self.policy.gains()
        m = len(course.velocity_command)
        stamp = ticks["stamp"][:m]
        kept = states["robot_stamp_ns"] < stamp[-1] + round(1e9 * self.tick_period_s)
        own = {k: np.ascontiguousarray((v if v.ndim == 1 else v[:, i])[kept]) for k, v in states.items()}
        key = np.arange(1, m + 1)
        name = f"simulated-{course.sequence}-{course.repeat}"
        header = RunHeader(
            run_id=name,
            started_host_stamp_ns=START_NS,
            command_sequence=course.sequence,
            repeat=course.repeat,
            policy_sha256=self.policy.sha256,
            policy_name=self.policy.contract.name,
        )
        commands = {
            "key": key,
            "host_stamp_ns": stamp,
            "robot_stamp_ns": stamp,
            "state_robot_stamp_ns": stamp,
            "end_robot_stamp_ns": stamp + 100_000_000,
            "requested_position_rad": ticks["requested"][:m, i],
            "position_rad": ticks["sent"][:m, i],
            "velocity_rad_s": np.zeros((m, facts.N_JOINTS)),
            "load_nm": np.zeros((m, facts.N_JOINTS)),
            "kp_nm_per_rad": np.broadcast_to(gains.kp_nm_per_rad, (m, facts.N_JOINTS)),
            "kd_nm_s_per_rad": np.broadcast_to(gains.kd_nm_s_per_rad, (m, facts.N_JOINTS)),
        }
        columns = {
            "index": key - 1,
            "robot_stamp_ns": stamp,
            "host_stamp_ns": stamp,
            "mode": np.full(m, FOLLOWING_MODE),
            "command_key": key,
            "state_age_s": np.zeros(m),
            "inference_s": np.zeros(m),
            "compute_s": np.zeros(m),
        }
        if isinstance(self.policy, JointScript):
            columns["velocity_command"] = np.zeros((m, 3))
        else:
            columns |= {name: ticks[name][:m, i] for name in ("observation", "action", "velocity_command")}
        return run_of_columns(Path(name), header, states=own, commands=commands, ticks=columns)


def padded(command: Array, n_ticks: int) -> Array:
    """Commands, shape (m, k), of which the last is repeated up to ``n_ticks``."""
    return np.concatenate([command, np.repeat(command[-1:], n_ticks - len(command), axis=0)])


def _as_seen(observation: AnyArray) -> AnyArray:
    """The policy's input as float32; NaN of a diverged simulation becomes 0, so that the others go on."""
    xp = namespace_of(observation)
    seen = xp.astype(observation, xp.float32)
    return xp.where(seen == seen, seen, xp.zeros_like(seen))


def _append(table: dict[str, list[Any]], row: dict[str, Any]) -> None:
    for name, value in row.items():
        table.setdefault(name, []).append(value if np.isscalar(value) else copy_of(value))


def stacked(rows: Sequence[Any]) -> NDArray[Any]:
    """Rows of all ticks as one array of NumPy, shape (T, ...); of a GPU's tensors in one transfer, and float64.

    What is not a number any more in a diverged simulation becomes 0, and an attitude level, as MuJoCo puts it back.
    """
    if np.isscalar(rows[0]) or isinstance(rows[0], np.ndarray):
        return np.array(rows)
    table = on_host(namespace_of(rows[0]).stack(list(rows)))
    if table.dtype.kind != "f":
        return table
    table = table.astype(np.float64)
    lost = ~np.isfinite(table).all(axis=-1, keepdims=True)
    level = np.eye(table.shape[-1])[0] if table.shape[-1] == N_QUATERNION else 0.0
    return np.where(lost, level, table)
