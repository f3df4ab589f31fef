"""The feet during a training: their motion, the ground below them, and how long each has stood or swung."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from spot_model.robot.leg_kinematics import foot_position_and_jacobian
from spot_model.robot.mjcf_options import NoiseTerrain, terrain_heights_m
from spot_model.robot.rotation import rotate_wxyz
from trainer.config.task_config import TerrainConfig
from trainer.task.plant_backend import PlantState

Tensor = torch.Tensor


class Ground:
    """Looks up ground heights: zero on flat ground, the nearest grid point on rough ground."""

    def __init__(self, config: TerrainConfig, device: torch.device | str) -> None:
        self.half_size_m = config.half_size_m if config.kind == "noise" else None
        terrain = config.terrain()
        self._heights: Tensor | None = None
        if isinstance(terrain, NoiseTerrain):
            self._heights = torch.tensor(terrain_heights_m(terrain), device=device, dtype=torch.float32)

    def height_m(self, xy_m: Tensor) -> Tensor | float:
        """Ground height at points of shape (..., 2); shape (...), or 0.0 on flat ground."""
        if self._heights is None or self.half_size_m is None:
            return 0.0
        n = len(self._heights)
        cell = 2.0 * self.half_size_m / (n - 1)
        index = ((xy_m + self.half_size_m) / cell).round().long().clamp(0, n - 1)
        return self._heights[index[..., 1], index[..., 0]]

    def is_outside(self, body_position_m: Tensor, margin_m: float = 1.0) -> Tensor:
        """Which robots have reached the edge, bool (n,); never on flat ground."""
        if self.half_size_m is None:
            return torch.zeros(len(body_position_m), dtype=torch.bool, device=body_position_m.device)
        return (body_position_m[:, :2].abs() > self.half_size_m - margin_m).any(dim=-1)


@dataclass(frozen=True)
class FootMotion:
    """The four feet (centres of their spheres), legs fl, fr, hl, hr."""

    position_in_world_m: Tensor
    """Shape (n, 4, 3)."""
    velocity_in_world_m_s: Tensor
    """Shape (n, 4, 3)."""


def foot_motion(state: PlantState) -> FootMotion:
    """Where the feet are and how they move, from joints and body alone."""
    position, jacobian = foot_position_and_jacobian(state.position_rad)
    rates = state.velocity_rad_s.reshape(-1, 4, 1, 3)
    attitude = state.world_from_body_wxyz[:, None, :].expand(-1, 4, -1)
    arm = rotate_wxyz(attitude, position)
    relative = rotate_wxyz(attitude, (jacobian * rates).sum(dim=-1))
    spin = state.angular_vel_of_body_in_world_rad_s[:, None, :].expand_as(arm)
    return FootMotion(
        position_in_world_m=state.body_position_m[:, None, :] + arm,
        velocity_in_world_m_s=(
            state.linear_vel_of_body_in_world_m_s[:, None, :] + torch.linalg.cross(spin, arm) + relative
        ),
    )


class FootTimers:
    """Contact timers of n robots' four feet; every tensor has shape (n, 4), s.

    Args:
        n: Robots.
        device: Where the tensors are.
        duty_window_s: Time constant of the mean that :attr:`duty` is.
    """

    NAMES = ("air_time_s", "contact_time_s", "last_air_time_s", "last_contact_time_s", "duty", "support")

    def __init__(self, n: int, device: torch.device | str, duty_window_s: float = 1.0) -> None:
        self.air_time_s = torch.zeros(n, 4, device=device)
        self.contact_time_s = torch.zeros(n, 4, device=device)
        self.last_air_time_s = torch.zeros(n, 4, device=device)
        self.last_contact_time_s = torch.zeros(n, 4, device=device)
        self.duty = torch.zeros(n, 4, device=device)
        """Share of time on the ground, a mean that forgets; starts from 0 for all feet alike."""
        self.support = torch.zeros(n, 4, dtype=torch.bool, device=device)
        """The feet on the ground; in flight those that were last."""
        self._duty_window_s = duty_window_s

    def update(self, contact: Tensor, dt_s: float, duty: Tensor | None = None) -> Tensor:
        """Count one more period with ``contact`` (bool, (n, 4)); returns which feet touched down in it.

        A phase's length is kept when it ends, with the period in which it ended counted in. ``duty`` is the share of
        the period in which each foot stood, shape (n, 4), where it is known.
        """
        touched_down = contact & (self.air_time_s > 0)
        lifted_off = ~contact & (self.contact_time_s > 0)
        self.last_air_time_s.copy_(torch.where(touched_down, self.air_time_s + dt_s, self.last_air_time_s))
        self.last_contact_time_s.copy_(torch.where(lifted_off, self.contact_time_s + dt_s, self.last_contact_time_s))
        self.support.copy_(torch.where(contact.any(dim=-1, keepdim=True), contact, self.support))
        self.air_time_s.add_(dt_s).mul_(~contact)
        self.contact_time_s.add_(dt_s).mul_(contact)
        self.duty.lerp_(contact.to(self.duty.dtype) if duty is None else duty, min(1.0, dt_s / self._duty_window_s))
        return touched_down

    def reset(self, mask: Tensor) -> None:
        """Zero the timers of the robots in ``mask`` (bool, (n,))."""
        keep = ~mask[:, None]
        for name in self.NAMES:
            getattr(self, name).mul_(keep)
