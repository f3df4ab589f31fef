"""Where a policy holds: slopes, rough ground, steps, payloads, friction and pushes, all robots at once."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from spot_model.effects.bodies import PayloadMass
from spot_model.plant.closed_loop import ClosedLoop
from spot_model.plant.plant import Plant
from spot_model.robot.arrays import like, on_host
from spot_model.robot.facts import Array
from spot_model.robot.rotation import AnyArray, multiply_wxyz
from spot_model.robot.terrain import CourseTerrain, NoiseTerrain, RampTerrain
from trainer.evaluate.setting import FOOT_GEOMS, Setting, set_friction

SECONDS: Final = 15.0
RAMP_S: Final = 1.0
"""Time in which the command rises."""
COUNTED_FROM_S: Final = 2.5
"""From here on, the mean velocity counts."""
SPEEDS_M_S: Final = (0.3, 1.0)
"""Commanded speeds."""
PROGRESS: Final = 0.7
"""Share of the commanded velocity that a robot must get on at, so that one that stands at a step does not count."""
HOLDS: Final = 0.95
"""Share of robots that must stay up and get on, for a policy that holds."""

ROUGH_FINE: Final = NoiseTerrain(seed=1, amplitude_m=0.015, cell_m=0.1, half_size_m=17.0, flat_radius_m=0.0)
ROUGH_COARSE: Final = NoiseTerrain(seed=13, amplitude_m=0.025, cell_m=0.3, half_size_m=16.8, flat_radius_m=0.0)
GENTLE, STEEP, STAIRS = RampTerrain(slope_deg=5.0), RampTerrain(slope_deg=10.0), RampTerrain(step_m=0.05)
COURSE: Final = CourseTerrain((ROUGH_FINE, ROUGH_COARSE, GENTLE, STEEP, STAIRS))


@dataclass(frozen=True)
class Condition:
    """What some of the robots meet; whatever is not named is as usual, on level ground."""

    group: str
    name: str
    field: NoiseTerrain | RampTerrain | None = None
    is_down: bool = False
    """Whether they walk down a ramp instead of up."""
    payload_kg: float = 0.0
    payload_x_m: float = 0.0
    payload_y_m: float = 0.0
    friction: float | None = None
    push_m_s: float = 0.0

    @property
    def is_ramp(self) -> bool:
        """Whether robots must walk straight on, because up and down differ."""
        return isinstance(self.field, RampTerrain)


PAYLOAD_HEIGHT_M: Final = 0.15
"""Height of a payload's centre above the body's: a box on the back."""
CONDITIONS: Final = (
    Condition("slope", "10° down", STEEP, is_down=True),
    Condition("slope", "5° down", GENTLE, is_down=True),
    Condition("slope", "5° up", GENTLE),
    Condition("slope", "10° up", STEEP),
    Condition("rough ground", "3 cm, every 10 cm", ROUGH_FINE),
    Condition("rough ground", "5 cm, every 30 cm", ROUGH_COARSE),
    Condition("steps of 5 cm", "up", STAIRS),
    Condition("steps of 5 cm", "down", STAIRS, is_down=True),
    *(Condition("payload", f"{mass:g} kg", payload_kg=mass) for mass in (0.0, 2.5, 5.0, 7.5, 10.0)),
    Condition("payload", "10 kg, 10 cm ahead", payload_kg=10.0, payload_x_m=0.1),
    Condition("payload", "10 kg, 10 cm behind", payload_kg=10.0, payload_x_m=-0.1),
    Condition("payload", "10 kg, 10 cm left", payload_kg=10.0, payload_y_m=0.1),
    *(Condition("friction", f"μ {friction:g}", friction=friction) for friction in (0.3, 0.4, 0.6, 1.0)),
    *(Condition("three pushes", f"{push:g} m/s each", push_m_s=push) for push in (0.5, 1.0)),
)
"""Source: the ranges that a user of such a robot meets first. Rough ground: heights of Isaac Lab's released Spot task
(the paper gives none), and those of the fake robot's scenario *rough*."""


def holds(setting: Setting, n: int = 100) -> dict[str, Any]:
    """Let ``n`` robots in each condition walk for 15 s at up to 1 m/s, with noise; who stays up, and who gets on."""
    rng = np.random.default_rng([setting.seed, 3])
    each = [condition for condition in CONDITIONS for _ in range(n)]
    plant, (command, starts_s) = _robots(setting, each, rng), _commands(setting, each, rng)
    alive, progress = _walk(setting, plant, each, command, starts_s, rng)
    stays, gets_on = alive.reshape(-1, n), (alive & (progress >= PROGRESS)).reshape(-1, n)
    return {
        "seconds": SECONDS,
        "speed_m_s": list(SPEEDS_M_S),
        "progress_needed": PROGRESS,
        "conditions": [
            {
                "group": condition.group,
                "name": condition.name,
                "robots": n,
                "stayed_up": int(stays[i].sum()),
                "held": int(gets_on[i].sum()),
                "progress": round(float(of[stays[i]].mean()), 3) if stays[i].any() else None,
            }
            for i, (condition, of) in enumerate(zip(CONDITIONS, progress.reshape(-1, n), strict=True))
        ],
    }


def _robots(setting: Setting, each: list[Condition], rng: np.random.Generator) -> Plant:
    """One robot a condition of ``each``, where it starts."""
    n = len(each)
    course = replace(setting, mjcf=replace(setting.mjcf, terrain=COURSE))
    mass, x, y = (np.array([[getattr(c, f"payload_{name}")] for c in each]) for name in ("kg", "x_m", "y_m"))
    plant = course.plant(n, added=(PayloadMass(mass_kg=mass, x_m=x, y_m=y, z_m=PAYLOAD_HEIGHT_M),))
    feet = [plant.model.geom(name).id for name in FOOT_GEOMS]
    friction = np.array([[c.friction or setting.mjcf.foot_friction] for c in each])
    set_friction(plant, plant.fields["geom_friction"][:, feet, 0] * (friction / setting.mjcf.foot_friction))
    is_ramp, is_down = (np.array([getattr(c, name) for c in each]) for name in ("is_ramp", "is_down"))
    around = rng.uniform(-np.pi, np.pi, n)
    yaw = np.where(is_ramp, np.where(is_down, np.pi, 0.0) + around / 9.0, around)
    joints, height = setting.drawn_joints(n, rng)
    place = rng.uniform(-1.0, 1.0, (n, 2))
    position, tilt = np.zeros((n, 3)), np.zeros(n)
    for i, c in enumerate(each):
        position[i], tilt[i] = _start(c, place[i], height[i])
    zero = np.zeros(n)
    upright = np.stack([np.cos(0.5 * yaw), zero, zero, np.sin(0.5 * yaw)], axis=-1)
    tilted = np.stack([np.cos(0.5 * tilt), zero, -np.sin(0.5 * tilt), zero], axis=-1)
    plant.reset(
        position_of_body_in_world_m=position,
        world_from_body_wxyz=multiply_wxyz(tilted, upright),
        joint_position_rad=joints,
    )
    return plant


def _start(condition: Condition, place: Array, height_m: float) -> tuple[Array, float]:
    """Where a robot starts, and how the ground is tilted there about y, rad.

    Args:
        condition: What it meets.
        place: Two draws in [-1, 1].
        height_m: Of its body above level ground.
    """
    if condition.field is None:
        return np.array([*place, height_m]), 0.0
    field, centre = condition.field, np.array(COURSE.centre_m(COURSE.fields.index(condition.field)))
    along = 1.5 - field.half_size_m if condition.is_ramp else 0.0
    x, y = place[0] + (-along if condition.is_down else along), place[1]
    if isinstance(field, RampTerrain) and field.slope_deg:
        slope = np.radians(field.slope_deg)
        surface = np.array([x, y, np.tan(slope) * (x + field.half_size_m)])
        return centre + surface + height_m * np.array([-np.sin(slope), 0.0, np.cos(slope)]), slope
    heights = _heights_m(field)
    x_axis, y_axis = (np.linspace(-field.half_size_m, field.half_size_m, n) for n in heights.shape[::-1])
    below = heights[np.abs(y_axis - y) < REACH_M][:, np.abs(x_axis - x) < REACH_M]
    return centre + np.array([x, y, height_m + below.max()]), 0.0


@functools.cache
def _heights_m(field: NoiseTerrain | RampTerrain) -> Array:
    return field.heights_m()


REACH_M: Final = 0.6
"""No foot is further from the body's origin, horizontally."""


def _commands(setting: Setting, each: list[Condition], rng: np.random.Generator) -> tuple[Array, Array]:
    """V_x, V_y (m/s), ω_z (rad/s), shape (n, 3), within the policy's range, and when they begin, s, shape (n,)."""
    n, contract = len(each), setting.policy.contract
    straight = np.array([c.is_ramp for c in each])
    command = rng.uniform((-0.5, -0.5, -1.0), (1.0, 0.5, 1.0), (n, 3))
    command[straight] = (1.0, 0.0, 0.0)
    command[:, :2] *= (rng.uniform(*SPEEDS_M_S, n) / np.linalg.norm(command[:, :2], axis=-1))[:, None]
    command = np.clip(command, contract.velocity_command_low, contract.velocity_command_high)
    return command, rng.uniform(0.0, 0.5, n)


def _walk(
    setting: Setting, plant: Plant, each: list[Condition], command: Array, starts_s: Array, rng: np.random.Generator
) -> tuple[NDArray[np.bool_], Array]:
    """Who stays up, bool, shape (n,), and the share of its commanded velocity at which each gets on, shape (n,)."""
    n, rate_hz = len(each), setting.policy.contract.rate_hz
    draws, sigma = plant.draws(rng), like(plant.joint_position_rad, setting.noise_sigma())
    push_m_s = np.array([c.push_m_s for c in each])
    push_ticks = np.round((np.array([[4.0], [8.0], [12.0]]) + rng.uniform(0.0, 1.0, (3, n))) * rate_hz)
    angle = rng.uniform(-np.pi, np.pi, (3, n))
    delta = push_m_s[:, None] * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=-1)

    def noisy(_: int, observation: AnyArray) -> AnyArray:
        return observation + sigma * draws.standard_normal(tuple(observation.shape))

    def shove(tick: int) -> None:
        is_due = push_ticks == tick
        if (is_due & (push_m_s > 0.0)).any():
            plant.push(linear_vel_in_world_m_s=(delta * is_due[..., None]).sum(axis=0))

    def asked(tick: int) -> Array:
        return np.asarray(command * np.clip(((tick + 1) / rate_hz - starts_s) / RAMP_S, 0.0, 1.0)[:, None])

    loop = ClosedLoop(plant, setting.policy, see=noisy, before_tick=shove)
    alive, velocity = np.ones(n, dtype=np.bool_), np.zeros((n, 2))
    substeps, n_ticks = round(1.0 / (rate_hz * plant.timestep_s)), round(SECONDS * rate_hz)
    first = round(COUNTED_FROM_S * rate_hz)
    for tick in loop.run(asked, [(substeps,)] * n_ticks):
        plant.check_finite()
        fell = alive & on_host(plant.body_contact)
        if fell.any():
            alive &= ~fell
            # Back on its feet on level ground: a robot that lies on stairs takes a hundred times as long to simulate.
            plant.reset(like(plant.joint_position_rad, fell) > 0.0)
        if tick.index >= first:
            velocity += on_host(plant.linear_vel_of_body_in_body_m_s)[:, :2] / (n_ticks - first)
    plant.check_room()
    planar = command[:, :2]
    return alive, np.asarray((velocity * planar).sum(axis=-1) / np.maximum(np.square(planar).sum(axis=-1), 1e-9))
