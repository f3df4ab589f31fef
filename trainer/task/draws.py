"""What a training draws: commands, where episodes start, what differs between simulations, parameters of effects."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import torch
from torch import Tensor

from spot_model.effects.base import Effect
from spot_model.effects.registry import effect_class, make_effect
from spot_model.effects.side_by_side import side_by_side
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.io.models_file import load_models
from spot_model.robot import facts
from spot_model.robot.leg_kinematics import foot_position_in_body_m
from spot_model.robot.rotation import rotate_wxyz
from trainer.config.task_config import FREE_HEIGHT_M, CommandConfig, RandomisationConfig, Range
from trainer.task.feet import Ground
from trainer.task.plant_backend import InitialState, SimulationDraws


class Draws:
    """Uniform and normal draws on one device from one generator."""

    def __init__(self, generator: torch.Generator) -> None:
        self.generator = generator
        self.device = generator.device

    def uniform(self, bounds: tuple[float, float], *shape: int) -> Tensor:
        """Even draws in [low, high), float32."""
        low, high = bounds
        return torch.rand(*shape, generator=self.generator, device=self.device) * (high - low) + low

    def normal(self, *shape: int) -> Tensor:
        """Standard normal draws, float32."""
        return torch.randn(*shape, generator=self.generator, device=self.device)


def draw_initial_state(config: RandomisationConfig, ground: Ground, n: int, draws: Draws) -> InitialState:
    """Initial states for n robots, one draw each; see :class:`RandomisationConfig` for the ranges."""
    device = draws.device
    c, joints = config, facts.N_JOINTS
    ranges = [(1, c.initial_yaw_rad), (joints, c.initial_position_rad), (2, c.initial_xy_m)]
    if not ground.is_level:
        ranges.append((2, (-ground.start_reach_m, ground.start_reach_m)))
    velocities = (c.initial_v_x_m_s, c.initial_v_y_m_s, c.initial_v_z_m_s)
    rates = (c.initial_roll_rate_rad_s, c.initial_pitch_rate_rad_s, c.initial_yaw_rate_rad_s)
    ranges += [(1, bounds) for bounds in (*velocities, *rates)]
    ranges.append((joints, c.initial_velocity_rad_s))
    low, width = _columns(tuple(ranges), device)
    blocks = torch.split(draws.uniform((0.0, 1.0), len(low), n) * width + low, [rows for rows, _ in ranges])
    yaw, position, xy = blocks[0][0], blocks[1].view(n, joints), blocks[2].view(n, 2)
    if not ground.is_level:
        xy = xy + blocks[3].view(n, 2)
    motion = torch.cat(blocks[-7:-1]).T
    half_yaw = 0.5 * yaw
    zero = torch.zeros(n, device=device)
    default, stops = _joint_constants(device)
    position = torch.clamp(default + position, *stops)
    attitude = torch.stack([half_yaw.cos(), zero, zero, half_yaw.sin()], dim=-1)
    # The body starts level, so the foot nearest to the ground says how high it must be for none to start inside.
    feet = foot_position_in_body_m(position)
    above = feet[..., 2]
    if not ground.is_level:
        feet_xy = xy[:, None, :] + rotate_wxyz(attitude[:, None, :].expand(-1, facts.N_LEGS, -1), feet)[..., :2]
        above = above - ground.height_m(feet_xy)
    height = facts.FOOT_RADIUS_M + FREE_HEIGHT_M - above.amin(dim=-1)
    return InitialState(
        body_position_m=torch.cat([xy, height[:, None]], dim=-1),
        world_from_body_wxyz=attitude,
        linear_vel_of_body_in_world_m_s=motion[:, :3],
        angular_vel_of_body_in_body_rad_s=motion[:, 3:],
        position_rad=position,
        velocity_rad_s=blocks[-1].view(n, joints),
    )


@functools.lru_cache(maxsize=8)
def _columns(ranges: tuple[tuple[int, Range], ...], device: torch.device) -> tuple[torch.Tensor, torch.Tensor]:
    """Lower bound and width of each row of draws, shape (rows, 1); kept, because a copy would make the device wait."""
    bounds = [pair for rows, pair in ranges for _ in range(rows)]
    with torch.inference_mode(mode=False):
        low = torch.tensor([[low] for low, _ in bounds], device=device)
        return low, torch.tensor([[high - low] for low, high in bounds], device=device)


@functools.lru_cache(maxsize=8)
def _joint_constants(device: torch.device) -> tuple[torch.Tensor, tuple[torch.Tensor, torch.Tensor]]:
    """Default pose and joint stops; kept on the device, because a copy would make it wait."""
    values = (facts.DEFAULT_POSITION_RAD, facts.POSITION_LOW_RAD, facts.POSITION_HIGH_RAD)
    default, low, high = (torch.tensor(v, device=device, dtype=torch.float32) for v in values)
    return default, (low, high)


def draw_simulations(config: RandomisationConfig, n: int, draws: Draws) -> SimulationDraws:
    """Friction and mass of n simulations."""
    return SimulationDraws(
        foot_friction=draws.uniform(config.foot_friction, n),
        added_body_mass_kg=draws.uniform(config.added_body_mass_kg, n),
    )


def training_effects(
    model: str | RobotModel, randomisation: RandomisationConfig, n: int, draws: Draws
) -> tuple[Effect, ...]:
    """All effects that act in training.

    Args:
        model: Built-in model name, model file, models file, or a model.
        randomisation: Its ``effects`` are added (a parameter may be ``[low, high]``), ``replaced_effects`` left out.
        n: Number of simulations; a drawn parameter has shape (n, 1).
        draws: Where the draws come from.

    Raises:
        BadInputError: An effect, key or value is not allowed.
    """
    own = model.effects if isinstance(model, RobotModel) else side_by_side([m.effects for m in load_models(model)], n)
    for name in randomisation.replaced_effects:
        if name not in {effect.name for effect in own}:
            raise BadInputError(
                f"randomisation.replaced_effects: the model has no effect {name!r}; "
                f"allowed: {', '.join(sorted({effect.name for effect in own})) or 'none'}"
            )
    kept = tuple(effect for effect in own if effect.name not in randomisation.replaced_effects)
    return kept + tuple(_randomised(i, dict(entry), n, draws) for i, entry in enumerate(randomisation.effects))


def _randomised(index: int, entry: dict[str, Any], n: int, draws: Draws) -> Effect:
    where = f"randomisation.effects.{index}"
    name = entry.pop("effect", None)
    if not isinstance(name, str):
        raise BadInputError(f"{where} has no key 'effect'; name the effect there")
    parameters = {p.name for p in effect_class(name).parameters()}
    ranges = {key: v for key, v in entry.items() if key in parameters and isinstance(v, (list, tuple))}
    fixed = {key: v for key, v in entry.items() if key not in ranges}
    values: dict[str, Any] = {}
    for key, bounds in ranges.items():
        if len(bounds) != 2 or not all(isinstance(b, (int, float)) for b in bounds) or bounds[0] > bounds[1]:
            raise BadInputError(f"{where}: {key} = {bounds}; allowed: a number, or [low, high]")
        drawn = draws.uniform((float(bounds[0]), float(bounds[1])), n, 1)
        values[key] = drawn.to(device="cpu", dtype=torch.float64).numpy()
    try:
        # Replacing builds the effect once, so related parameters are checked together.
        cls = effect_class(name)
        base = make_effect(name, {"joints": fixed["joints"]} if "joints" in fixed else {})
        numbers = make_effect(name, fixed).values if not ranges else {k: v for k, v in fixed.items() if k != "joints"}
        unknown = sorted(set(numbers) - {p.name for p in cls.parameters()})
        if unknown:
            raise BadInputError(f"unknown key {unknown[0]!r}; allowed: joints, {', '.join(sorted(parameters))}")
        return dataclasses.replace(base, **numbers, **values)
    except BadInputError as error:
        raise BadInputError(f"{where}: {error}") from error


SLOW = 0.25
"""Share of the ranges that slow commands are drawn from."""


class VelocityCommands:
    """Commands of n robots; ``command`` has shape (n, 3): V_x, V_y (m/s), ω_z (rad/s), body frame."""

    def __init__(self, config: CommandConfig, n: int, draws: Draws) -> None:
        self.config = config
        self._draws = draws
        self.command = torch.zeros(n, 3, device=draws.device)
        self.time_left_s = torch.zeros(n, device=draws.device)
        self.share = 1.0
        """Share of the ranges' width in use; the curriculum raises it."""
        self._low = torch.zeros(3, 1, device=draws.device)
        self._width = torch.zeros(3, 1, device=draws.device)
        self._set_ranges(1.0)

    def draw(self) -> Tensor:
        """New commands for all robots, shape (n, 3)."""
        c = self.config
        chances = self._draws.uniform((0.0, 1.0), 5 if c.slow_share > 0.0 else 4, len(self.command))
        command = (chances[:3] * self._width + self._low).T
        if c.slow_share > 0.0:
            command = command * torch.where(chances[3] < c.slow_share, SLOW, 1.0)[:, None]
        acceleration = (command[:, 0] * command[:, 2]).abs()
        scale = (c.lateral_acceleration_limit_m_s2 / acceleration.clamp(min=1e-6)).clamp(max=1.0)
        chance = chances[-1]
        straight_until = c.standing_share + c.straight_share
        bends = chance >= straight_until
        advances = (chance >= c.standing_share) & ~(bends & (chance < straight_until + c.turning_share))
        factors = torch.stack([advances, scale * (bends & advances), scale * bends], dim=-1)
        return command * factors

    def update(self, fresh: Tensor, dt_s: float) -> None:
        """Count one period; draw anew for robots in ``fresh`` (bool, (n,)) and those whose time is up."""
        self.time_left_s -= dt_s
        due = fresh | (self.time_left_s <= 0.0)
        self.command.copy_(torch.where(due[:, None], self.draw(), self.command))
        self.time_left_s.masked_fill_(due, self.config.resample_s)

    def advance_curriculum(self, iteration: int) -> None:
        """Set the share of the ranges that this iteration uses."""
        c = self.config
        done = 1.0 if c.curriculum_iterations == 0 else min(1.0, iteration / c.curriculum_iterations)
        self._set_ranges(c.curriculum_start + (1.0 - c.curriculum_start) * done if c.curriculum_iterations else 1.0)

    def _set_ranges(self, share: float) -> None:
        self.share = share
        c = self.config
        for i, bounds in enumerate((c.v_x_m_s, c.v_y_m_s, c.yaw_rate_rad_s)):
            low, high = _narrowed(bounds, share)
            self._low[i] = low
            self._width[i] = high - low

    def snapshot(self) -> dict[str, Any]:
        """Command state by name."""
        return {"command": self.command.clone(), "time_left_s": self.time_left_s.clone(), "share": self.share}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from a snapshot."""
        self.command.copy_(snapshot["command"])
        self.time_left_s.copy_(snapshot["time_left_s"])
        self._set_ranges(float(snapshot["share"]))


def _narrowed(bounds: tuple[float, float], share: float) -> tuple[float, float]:
    """A range shrunk towards zero (towards its nearer end where zero lies outside)."""
    centre = min(max(0.0, bounds[0]), bounds[1])
    return (centre + share * (bounds[0] - centre), centre + share * (bounds[1] - centre))
