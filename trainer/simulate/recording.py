"""Many robots under one policy, recorded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spot_model.plant.closed_loop import ClosedLoop, CommandAt
from spot_model.plant.plant import Plant
from spot_model.policy.policy import Policy
from spot_model.robot.arrays import like, on_host
from spot_model.robot.rotation import AnyArray
from trainer.simulate.falls import Fall, falls_now
from trainer.simulate.recorded_loop import stacked

Array = NDArray[np.float64]

Disturb = Callable[[Plant, int], None]
"""Called before every tick with the plant and the tick's number."""


@dataclass(frozen=True)
class Recording:
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
    falls: tuple[Fall, ...] = ()
    """In the order of time."""

    def ticks(self, start_s: float, end_s: float) -> slice:
        """The ticks of a span of time."""
        return slice(round(start_s * self.rate_hz), round(end_s * self.rate_hz))

    @property
    def survived(self) -> NDArray[np.bool_]:
        """Robots that never fell, shape (n,)."""
        return np.asarray(self.alive[-1])


def roll_out(
    policy: Policy,
    plant: Plant,
    command_at: CommandAt,
    n_ticks: int,
    *,
    noise_sigma: Array | None = None,
    rng: np.random.Generator | None = None,
    disturb: Disturb | None = None,
) -> Recording:
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
    falls: list[Fall] = []
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
    columns = [np.stack(column) for column in zip(*rows, strict=True)]
    commands, velocities, contacts, descents, powers, lives = columns
    return Recording(
        commands, velocities, contacts, descents, powers, peak, lives, policy.contract.rate_hz, tuple(falls)
    )
