"""The reward terms: pure functions of one moment, each of shape (n,), before its weight.

Source: the paper names the terms; the formulas follow Isaac Lab's released Spot task (BSD-3-Clause). Foot impact and
foot distance, which the paper names without a formula, are this project's, and so are trot, short swing, long phase,
uneven duty, power and fall.
"""

from __future__ import annotations

import functools
import itertools
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any, Final

import torch
from torch import Tensor

from spot_model.errors import BadInputError
from spot_model.user_code import users_code
from trainer.config.task_config import ENTRY_POINT_GROUP, RewardShape, RewardWeights


@dataclass(frozen=True)
class Moment:
    """What the rewards look at, after one policy period. Legs fl, fr, hl, hr; canonical joint order."""

    command: Tensor
    """V_x, V_y (m/s), ω_z (rad/s), shape (n, 3)."""
    linear_vel_m_s: Tensor
    """Body velocity in the body frame, shape (n, 3)."""
    angular_vel_rad_s: Tensor
    """In the body frame, shape (n, 3)."""
    gravity: Tensor
    """Projected gravity, shape (n, 3)."""
    down: Tensor
    """Straight into the ground below the robot, in the body frame, shape (n, 3): on level ground, gravity."""
    position_offset_rad: Tensor
    """Joint position minus default pose, shape (n, 12)."""
    velocity_rad_s: Tensor
    """Shape (n, 12)."""
    acceleration_rad_s2: Tensor
    """Change of joint velocity over the period, shape (n, 12)."""
    torque_nm: Tensor
    """Shape (n, 12)."""
    action: Tensor
    """Shape (n, 12)."""
    last_action: Tensor
    """Shape (n, 12)."""
    foot_height_m: Tensor
    """Foot centres above the ground, shape (n, 4)."""
    foot_velocity_m_s: Tensor
    """In the world, shape (n, 4, 3)."""
    foot_xy_m: Tensor
    """In the world, shape (n, 4, 2)."""
    contact: Tensor
    """Bool, shape (n, 4)."""
    support: Tensor
    """Bool, shape (n, 4): the feet on the ground, in flight those that were last."""
    air_time_s: Tensor
    """Time in the air so far, shape (n, 4)."""
    contact_time_s: Tensor
    last_air_time_s: Tensor
    """Length of the last flight, shape (n, 4)."""
    last_contact_time_s: Tensor
    touched_down: Tensor
    """Bool, shape (n, 4): in this period."""
    touchdown_speed_m_s: Tensor
    """Downward speed of a foot just before it touched down in this period, else 0. Shape (n, 4)."""
    duty: Tensor
    """Recent share of time on the ground, shape (n, 4)."""
    fell: Tensor
    """Bool, shape (n,): the episode ends in this period by a fall."""
    is_moving: Tensor
    """Bool, shape (n,): a velocity is commanded, or the body moves all the same."""


RewardTerm = Callable[[Moment, RewardShape], Tensor]


def linear_velocity(m: Moment, c: RewardShape) -> Tensor:
    """exp(−error / scale), worth more at higher commanded speed."""
    speed = _norm(m.command[:, :2])
    error = _norm(m.command[:, :2] - m.linear_vel_m_s[:, :2])
    factor = 1.0 + c.linear_velocity_ramp_s_per_m * (speed - c.linear_velocity_ramp_from_m_s)
    return torch.exp(-error / c.linear_velocity_scale_m_s) * factor.clamp(min=1.0)


def yaw_rate(m: Moment, c: RewardShape) -> Tensor:
    """exp(−|error| / scale)."""
    return torch.exp(-(m.command[:, 2] - m.angular_vel_rad_s[:, 2]).abs() / c.yaw_rate_scale_rad_s)


def air_time(m: Moment, c: RewardShape) -> Tensor:
    """Moving: phases of the wanted length; standing: feet on the ground."""
    longest = torch.maximum(m.air_time_s, m.contact_time_s)
    moving = torch.where(longest < c.swing_time_s, longest, torch.zeros_like(longest))
    standing = (m.contact_time_s - m.air_time_s).clamp(-c.swing_time_s, c.swing_time_s)
    return torch.where(m.is_moving[:, None], moving, standing).sum(dim=-1)


def gait(m: Moment, c: RewardShape) -> Tensor:
    """Diagonal feet in step, neighbouring feet out of step; 0 when standing."""
    cap, scale = c.gait_largest_error_s**2, c.gait_scale_s2
    times = torch.cat([m.air_time_s, m.contact_time_s], dim=-1)
    if c.gait_stride_s > 0.0:
        stride_s = (m.last_air_time_s + m.last_contact_time_s).mean(dim=-1, keepdim=True).clamp(min=0.1)
        times = times * (c.gait_stride_s / stride_s)
    first, second = _gait_pairs(times.device)
    error = (times[:, first] - times[:, second]).square().clamp(max=cap).sum(dim=-1)
    return torch.exp(-error / scale) * m.is_moving


def trot(m: Moment, c: RewardShape) -> Tensor:
    """1 on one diagonal alone, a quarter on one or three feet, else 0.

    That is the share of the six pairs of feet that are as a trot has them, above the third that standing, pronk, pace
    and bound have. It does not depend on time, so strides of any length are paid alike. In flight it is the value of
    the last support, times a share that rises from 0 to 1 over the commanded speeds ``flight_allowed_m_s``.
    """
    fl, fr, hl, hr = m.support.unbind(dim=-1)
    diagonal = (fl == hr) & (fr == hl) & (fl != fr)
    odd = fl ^ fr ^ hl ^ hr
    low, high = c.flight_allowed_m_s
    allowed = ((_norm(m.command[:, :2]) - low) / (high - low)).clamp(0.0, 1.0)
    paid = torch.where(m.contact.any(dim=-1), torch.ones_like(allowed), allowed)
    return (diagonal + 0.25 * odd) * paid * m.is_moving


def short_swing(m: Moment, c: RewardShape) -> Tensor:
    """How much shorter than wanted the swings were that end in this period, s."""
    return ((c.swing_time_s - m.last_air_time_s).clamp(min=0.0) * m.touched_down).sum(dim=-1) * m.is_moving


def long_phase(m: Moment, c: RewardShape) -> Tensor:
    """How many feet have been in the air, or on the ground, for longer than a swing should last."""
    longest = torch.maximum(m.air_time_s, m.contact_time_s)
    return (longest > c.swing_time_s).sum(dim=-1) * m.is_moving


def foot_clearance(m: Moment, c: RewardShape) -> Tensor:
    """Feet that move are at the wanted height."""
    speed = _norm(m.foot_velocity_m_s[..., :2])
    error = (m.foot_height_m - c.clearance_height_m).square() * torch.tanh(c.clearance_speed_factor_s_per_m * speed)
    return torch.exp(-error.sum(dim=-1) / c.clearance_scale_m2)


def action_smoothness(m: Moment, _c: RewardShape) -> Tensor:
    """Change of the action."""
    return _norm(m.action - m.last_action)


def air_time_variance(m: Moment, c: RewardShape) -> Tensor:
    """Unequal last phases between the feet."""
    air, contact = m.last_air_time_s.clamp(max=c.variance_cap_s), m.last_contact_time_s.clamp(max=c.variance_cap_s)
    return air.var(dim=-1) + contact.var(dim=-1)


def uneven_duty(m: Moment, _c: RewardShape) -> Tensor:
    """Moving: how far the feet's duty factors are from their mean, as a norm."""
    return _norm(m.duty - m.duty.mean(dim=-1, keepdim=True)) * m.is_moving


def fall(m: Moment, _c: RewardShape) -> Tensor:
    """1 in the period in which the robot fell."""
    return m.fell.float()


def base_motion(m: Moment, _c: RewardShape) -> Tensor:
    """Motion in the directions that are not commanded."""
    return 0.8 * m.linear_vel_m_s[:, 2].square() + 0.2 * m.angular_vel_rad_s[:, :2].abs().sum(dim=-1)


def orientation(m: Moment, _c: RewardShape) -> Tensor:
    """Tilt against the ground below, as the horizontal part, in the body frame, of the way into it."""
    return _norm(m.down[:, :2])


def foot_slip(m: Moment, _c: RewardShape) -> Tensor:
    """Horizontal speed of feet on the ground."""
    return (_norm(m.foot_velocity_m_s[..., :2]) * m.contact).sum(dim=-1)


def foot_impact(m: Moment, c: RewardShape) -> Tensor:
    """Downward speed of the feet that touched down, worth less at higher commanded speed where a relief is set."""
    relief = 1.0 + c.foot_impact_relief_s_per_m * _norm(m.command[:, :2])
    return m.touchdown_speed_m_s.sum(dim=-1) / relief


def foot_distance(m: Moment, c: RewardShape) -> Tensor:
    """How much closer than allowed the feet are, summed over the six pairs."""
    first, second = _foot_pairs(m.foot_xy_m.device)
    distance = _norm(m.foot_xy_m[:, first] - m.foot_xy_m[:, second])
    return (c.foot_distance_m - distance).clamp(min=0.0).sum(dim=-1)


def joint_acceleration(m: Moment, _c: RewardShape) -> Tensor:
    """Norm of the joint accelerations."""
    return _norm(m.acceleration_rad_s2)


def joint_velocity(m: Moment, _c: RewardShape) -> Tensor:
    """Norm of the joint velocities."""
    return _norm(m.velocity_rad_s)


def joint_position(m: Moment, c: RewardShape) -> Tensor:
    """Distance from the default pose, weighing more when standing."""
    distance = _norm(m.position_offset_rad)
    return torch.where(m.is_moving, distance, c.standing_position_factor * distance)


def joint_torque(m: Moment, _c: RewardShape) -> Tensor:
    """Norm of the motor torques."""
    return _norm(m.torque_nm)


def power(m: Moment, _c: RewardShape) -> Tensor:
    """Positive mechanical power of the motors, W."""
    return (m.torque_nm * m.velocity_rad_s).clamp(min=0.0).sum(dim=-1)


def _norm(vectors: Tensor) -> Tensor:
    norms: Tensor = torch.linalg.vector_norm(vectors, dim=-1)
    return norms


@functools.lru_cache(maxsize=8)
def _gait_pairs(device: torch.device) -> tuple[Tensor, Tensor]:
    """Columns of (air, contact) times that a trot makes equal; kept on the device, a copy would make it wait."""
    fl, fr, hl, hr = range(4)
    in_step = [(fl, hr), (fr, hl)]
    out_of_step = [(fl, fr), (hr, hl), (fl, hl), (fr, hr)]
    pairs = [(a + k, b + k) for a, b in in_step for k in (0, 4)]
    pairs += [pair for a, b in out_of_step for pair in ((a, b + 4), (a + 4, b))]
    first, second = zip(*pairs, strict=True)
    return torch.tensor(first, device=device), torch.tensor(second, device=device)


@functools.lru_cache(maxsize=8)
def _foot_pairs(device: torch.device) -> tuple[Tensor, Tensor]:
    first, second = zip(*itertools.combinations(range(4), 2), strict=True)
    return torch.tensor(first, device=device), torch.tensor(second, device=device)


TERMS: Final[dict[str, RewardTerm]] = {name: globals()[name] for name in RewardWeights.model_fields}
"""Every term by its key in the weights: the function above of that name."""


def reward_term(name: str) -> RewardTerm:
    """The function called ``name``: it takes a :class:`~trainer.task.rewards.Moment` and the config's shape numbers.

    Raises:
        BadInputError: There is none, or what is there cannot be called.
    """
    if name in TERMS:
        return TERMS[name]
    installed = {entry.name: entry for entry in entry_points(group=ENTRY_POINT_GROUP)}
    with users_code(f"reward {name!r}", "check module and function name"):
        if name in installed:
            return _checked(name, installed[name].load())
        if ":" in name:
            return _checked(name, pkgutil.resolve_name(name))
    known = ", ".join(sorted([*TERMS, *installed]))
    raise BadInputError(f"reward {name!r} is unknown; allowed: {known}, or module:function for one of your own")


def _checked(name: str, found: Any) -> RewardTerm:
    if not callable(found):
        raise BadInputError(f"reward {name!r} is {found!r}; allowed: a function of a moment and the shape numbers")
    term: RewardTerm = found
    return term
