"""Many robots under one policy: what they did, how well, and how each of them fell."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from spot_model.plant.closed_loop import ClosedLoop, CommandAt
from spot_model.plant.plant import Plant
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.arrays import like, on_host
from spot_model.robot.facts import Array
from spot_model.robot.gait import measure_gait
from spot_model.robot.rotation import AnyArray, tilt_rad
from trainer.simulate.recorded_loop import stacked

AT_STOP_RAD: Final = 0.02
"""Distance from a joint's stop at which it counts as at the stop."""
UPRIGHT_RAD: Final = 0.5
"""Tilt below which a robot that fell had sunk or stumbled rather than tipped over."""
PARTS: Final = {"body": "body", "uleg": "upper leg", "lleg": "lower leg"}


@dataclass(frozen=True)
class TrialFall:
    """One robot's fall: the first policy period at whose end something other than a foot is on the ground."""

    robot: int
    time_s: float
    """Since the trial began."""
    command: tuple[float, float, float]
    """V_x, V_y (m/s), ω_z (rad/s)."""
    command_age_s: float
    """How long that command had stood unchanged."""
    velocity: tuple[float, float, float]
    """Measured V_x, V_y (m/s), ω_z (rad/s), body frame."""
    tilt_rad: float
    touched: tuple[str, ...]
    """What is on the ground: "body", "hl lower leg" and so on."""
    at_stop: tuple[str, ...]
    """Joints at a stop."""

    def figures(self) -> dict[str, Any]:
        """The fall as plain data."""
        return {
            "robot": self.robot,
            "time_s": round(self.time_s, 2),
            "command": [round(v, 3) for v in self.command],
            "command_age_s": round(self.command_age_s, 2),
            "velocity": [round(v, 2) for v in self.velocity],
            "tilt_deg": round(float(np.degrees(self.tilt_rad)), 1),
            "touched": list(self.touched),
            "at_stop": list(self.at_stop),
            "why": self.sentence(),
        }

    def sentence(self) -> str:
        """The fall in a line."""
        how = "tips over" if self.tilt_rad > UPRIGHT_RAD else "falls upright"
        stops = f"; at a joint stop: {', '.join(self.at_stop)}" if self.at_stop else ""
        return (
            f"robot {self.robot} {how} at {self.time_s:.2f} s, {self.command_age_s:.1f} s into the command "
            f"{_words(self.command)}, moving at {_words(self.velocity)}: {' and '.join(self.touched) or 'something'} "
            f"on the ground first, tilt {np.degrees(self.tilt_rad):.0f}°{stops}"
        )


def falls_now(
    plant: Plant, rows: NDArray[np.bool_], time_s: float, command: Array, command_since_s: Array, velocity: Array
) -> list[TrialFall]:
    """What is to be said of the robots that fell in this policy period.

    Args:
        plant: The robots as they are.
        rows: Which fell, shape (n,).
        time_s: Since the trial began.
        command: Shape (n, 3).
        command_since_s: When each robot's command last changed, shape (n,).
        velocity: V_x, V_y (m/s), ω_z (rad/s), shape (n, 3).
    """
    if not rows.any():
        return []
    tilt, position, qpos = (
        on_host(array) for array in (tilt_rad(plant.world_from_body_wxyz), plant.joint_position_rad, plant.physics.qpos)
    )
    at_stop = (position < facts.POSITION_LOW_RAD + AT_STOP_RAD) | (position > facts.POSITION_HIGH_RAD - AT_STOP_RAD)
    return [
        TrialFall(
            robot=int(i),
            time_s=time_s,
            command=_three(command[i]),
            command_age_s=time_s - float(command_since_s[i]),
            velocity=_three(velocity[i]),
            tilt_rad=float(tilt[i]),
            touched=touching_ground(plant.model, np.array(qpos[i], dtype=np.float64)),
            at_stop=tuple(facts.JOINT_NAMES[j] for j in np.flatnonzero(at_stop[i])),
        )
        for i in np.flatnonzero(rows)
    ]


def touching_ground(model: mujoco.MjModel, qpos: Array) -> tuple[str, ...]:
    """What touches the ground other than feet, or all but does, in a pose of MuJoCo's generalised position."""
    data = mujoco.MjData(model)
    touched: tuple[str, ...] = ()
    # After the step that brought the contact the part may have left the ground again by a little.
    for lowered_m in (0.0, 0.01, 0.03):
        data.qpos[:] = qpos
        data.qpos[2] -= lowered_m
        mujoco.mj_forward(model, data)
        names = {model.geom(int(geom)).name for pair in data.contact.geom for geom in pair}
        parts = [name.rpartition("_") for name in sorted(names)]
        touched = tuple(f"{leg} {PARTS[part]}".strip() for leg, _, part in parts if part in PARTS)
        if touched:
            break
    return touched


def _words(velocity: tuple[float, float, float]) -> str:
    v_x, v_y, yaw = velocity
    return f"({v_x:.2f}, {v_y:.2f} m/s, {yaw:.2f} rad/s)"


def _three(values: Array) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])


Disturb = Callable[[Plant, int], None]
"""Called before every tick with the plant and the tick's number."""


@dataclass(frozen=True)
class WalkRecord:
    """What happened, tick by tick (T ticks, n robots); rows after a robot's fall are meaningless."""

    command: Array
    """V_x, V_y (m/s), ω_z (rad/s), shape (T, n, 3)."""
    velocity: Array
    """Measured V_x, V_y (m/s) and ω_z (rad/s) in the body frame, shape (T, n, 3)."""
    foot_contact: NDArray[np.bool_]
    """At every physics step, shape (T, steps a tick, n, 4), legs fl, fr, hl, hr: a stance lasts few ticks."""
    foot_descent_m_s: Array
    """Downward speed of the feet at the end of every physics step, shape (T, steps a tick, n, 4)."""
    power_w: Array
    """Mechanical power of all motors, shape (T, n); positive work only."""
    torque_peak_nm: Array
    """Largest motor torque so far, shape (n,)."""
    alive: NDArray[np.bool_]
    """Whether the robot has not fallen yet, shape (T, n)."""
    rate_hz: float
    falls: tuple[TrialFall, ...] = ()
    """In the order of time."""

    def ticks(self, start_s: float, end_s: float) -> slice:
        """The ticks of a span of time."""
        return slice(round(start_s * self.rate_hz), round(end_s * self.rate_hz))

    @property
    def survived(self) -> NDArray[np.bool_]:
        """Robots that never fell, shape (n,)."""
        return np.asarray(self.alive[-1])

    def tracking_error(self, span: slice) -> Array:
        """Mean over time of |command − mean velocity over a stride|, shape (n, 3); NaN for robots that fell.

        Velocity is averaged over half a second, about a stride, so that sway within a stride is not an error.
        """
        window = round(0.5 * self.rate_hz)
        velocity, command = _running_mean(self.velocity[span], window), _running_mean(self.command[span], window)
        error = np.abs(velocity - command).mean(axis=0)
        return np.where(self.alive[span][-1][:, None], error, np.nan)

    def mean_velocity(self, span: slice) -> Array:
        """Mean velocity, shape (n, 3)."""
        return np.asarray(self.velocity[span].mean(axis=0))

    def gait(self, span: slice, robot: int) -> dict[str, Any]:
        """The gait of one robot; see :class:`spot_model.robot.gait.Gait`."""
        contact = self.foot_contact[span, :, robot].reshape(-1, facts.N_LEGS)
        descent = self.foot_descent_m_s[span, :, robot].reshape(-1, facts.N_LEGS)
        step_s = 1.0 / (self.rate_hz * self.foot_contact.shape[1])
        measured = measure_gait(step_s * np.arange(len(contact)), contact, descent)
        return {
            "gait": measured.name,
            "clarity": round(measured.clarity, 3),
            "stride_hz": round(measured.stride_hz, 2),
            "duty_factors": [round(d, 3) for d in measured.duty],
            "duty_spread": round(max(measured.duty) - min(measured.duty), 3),
            "flight_share": round(measured.flight_share, 3),
            "phases": [None if np.isnan(p) else round(p, 3) for p in measured.phase],
            "agreement": {name: round(share, 3) for name, share in measured.agreement.items()},
            "diagonals_agree": round(measured.diagonals_agree, 3),
            "others_agree": round(measured.others_agree, 3),
            "touchdown_m_s": None if np.isnan(measured.touchdown_m_s) else round(measured.touchdown_m_s, 3),
        }


def walk_at(
    policy: Policy,
    plant: Plant,
    target: Array,
    ramp_s: float,
    seconds: float,
    *,
    noise_sigma: Array | None = None,
    rng: np.random.Generator | None = None,
    disturb: Disturb | None = None,
) -> WalkRecord:
    """Let robots walk for ``seconds`` under commands that rise evenly to ``target``, shape (n, 3), and stay there."""
    rate_hz = policy.contract.rate_hz
    return record_walks(
        policy,
        plant,
        lambda tick: target * min(1.0, (tick + 1) / max(1.0, ramp_s * rate_hz)),
        round(seconds * rate_hz),
        noise_sigma=noise_sigma,
        rng=rng,
        disturb=disturb,
    )


def record_walks(
    policy: Policy,
    plant: Plant,
    command_at: CommandAt,
    n_ticks: int,
    *,
    noise_sigma: Array | None = None,
    rng: np.random.Generator | None = None,
    disturb: Disturb | None = None,
) -> WalkRecord:
    """Run the policy from the plant's present state.

    Args:
        policy: Joint order and gains are its contract's.
        plant: Robots, already in their initial state.
        command_at: Commands by tick.
        n_ticks: Policy periods.
        noise_sigma: Observation noise, shape (48,), in the policy's joint order; None for none.
        rng: Draws the noise; needed with ``noise_sigma``.
        disturb: Pushes, patches and the like.
    """
    n = plant.n_sims
    substeps = round(1.0 / (policy.contract.rate_hz * plant.timestep_s))
    contact: list[Any] = []
    descent: list[Any] = []
    draws = None if rng is None else plant.draws(rng)
    sigma = None if noise_sigma is None else like(plant.joint_position_rad, noise_sigma)

    def noisy(_: int, observation: AnyArray) -> AnyArray:
        if sigma is None or draws is None:
            return observation
        return observation + sigma * draws.standard_normal(tuple(observation.shape))

    def watch() -> None:
        contact.append(plant.foot_contact)
        descent.append(-plant.foot_velocity_in_world_m_s[..., 2])

    loop = ClosedLoop(
        plant,
        policy,
        see=noisy,
        before_tick=None if disturb is None else lambda tick: disturb(plant, tick),
        after_step=watch,
    )
    rows: list[tuple[Array, Array, NDArray[np.bool_], Array, Array, NDArray[np.bool_]]] = []
    alive = np.ones(n, dtype=np.bool_)
    peak = np.zeros(n)
    falls: list[TrialFall] = []
    asked, since_s = np.full((n, 3), np.nan), np.zeros(n)
    for tick in loop.run(command_at, [(substeps,)] * n_ticks):
        time_s = (tick.index + 1) / policy.contract.rate_hz
        changed = (tick.velocity_command != asked).any(axis=-1)
        asked, since_s = (
            np.array(tick.velocity_command),
            np.where(changed, tick.index / policy.contract.rate_hz, since_s),
        )
        plant.check_finite()
        fell = alive & on_host(plant.body_contact)
        alive &= ~fell
        torque, joint_velocity = on_host(plant.applied_torque_nm), on_host(plant.joint_velocity_rad_s)
        power = np.maximum(torque * joint_velocity, 0.0).sum(axis=-1)
        peak = np.maximum(peak, np.abs(torque).max(axis=-1))
        linear, angular = (
            on_host(v) for v in (plant.linear_vel_of_body_in_body_m_s, plant.angular_vel_of_body_in_body_rad_s)
        )
        velocity = np.concatenate([linear[:, :2], angular[:, 2:]], axis=-1)
        falls += falls_now(plant, fell, time_s, asked, since_s, velocity)
        rows.append(
            (np.array(tick.velocity_command), velocity, stacked(contact), stacked(descent), power, alive.copy())
        )
        contact.clear()
        descent.clear()
    plant.check_room()
    columns = [np.stack(column) for column in zip(*rows, strict=True)]
    commands, velocities, contacts, descents, powers, lives = columns
    return WalkRecord(
        commands, velocities, contacts, descents, powers, peak, lives, policy.contract.rate_hz, tuple(falls)
    )


def _running_mean(values: Array, window: int) -> Array:
    sums = np.cumsum(np.concatenate([np.zeros_like(values[:1]), values]), axis=0)
    return np.asarray((sums[window:] - sums[:-window]) / window)
