"""The feet during a training: their motion, the ground below them, and how long each has stood or swung."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from torch import Tensor

from spot_model.robot.leg_kinematics import foot_position_and_jacobian
from spot_model.robot.rotation import rotate_wxyz
from spot_model.robot.terrain import NoiseTerrain, TileTerrain
from trainer.config.task_config import TerrainConfig
from trainer.task.plant_backend import TaskState

START_FROM_EDGE_M: Final = 12.0
"""No robot starts nearer to the ground's edge."""
SLOPE_OVER_M: Final = 0.3
"""The ground's slope under a robot is that of nine points so far apart, about its footprint."""


class Ground:
    """Looks up ground heights: zero on flat ground, elsewhere that of the height field's triangles."""

    def __init__(self, config: TerrainConfig, device: torch.device | str) -> None:
        terrain = config.terrain()
        self.is_level = config.kind == "flat"
        """Whether it is a horizontal plane."""
        self.start_reach_m = max(0.0, config.half_size_m - START_FROM_EDGE_M)
        """Unless it is, robots start spread over [-start_reach_m, start_reach_m] in x and y, so that they do not all
        learn the same few square metres."""
        heights = terrain.heights_m() if isinstance(terrain, NoiseTerrain | TileTerrain) else np.zeros((2, 2))
        self._heights = torch.tensor(heights, device=device, dtype=torch.float32)
        self._half_size_m = config.half_size_m
        around = torch.arange(-1.0, 2.0, device=device) * SLOPE_OVER_M
        self._around = torch.cartesian_prod(around, around)

    def height_m(self, xy_m: Tensor) -> Tensor | float:
        """Ground height at points of shape (..., 2); shape (...), or 0.0 on flat ground."""
        return 0.0 if self.is_level else self._on_triangles(xy_m)

    def _on_triangles(self, xy_m: Tensor) -> Tensor:
        n = len(self._heights)
        at = ((xy_m + self._half_size_m) * ((n - 1) / (2.0 * self._half_size_m))).clamp(0.0, n - 1.0)
        # A diverged robot is nowhere, which is no index.
        low = at.nan_to_num(0.0).long().clamp(max=n - 2)
        (x, y), (along_x, along_y) = low.unbind(dim=-1), (at - low).unbind(dim=-1)
        # MuJoCo folds a cell along the diagonal from its lowest to its highest x and y.
        is_upper = (along_y >= along_x).long()
        first, last = self._heights[y, x], self._heights[y + 1, x + 1]
        between = self._heights[y + is_upper, x + 1 - is_upper]
        nearer, further = torch.maximum(along_x, along_y), torch.minimum(along_x, along_y)
        return first + nearer * (between - first) + further * (last - between)

    def normal(self, xy_m: Tensor) -> Tensor:
        """The ground's upward normal in the world under robots at points of shape (n, 2); shape (n, 3), of length 1."""
        heights = self._on_triangles(xy_m[:, None, :] + self._around)
        # The plane that fits the nine heights best: per axis, the mean of the last three less that of the first three.
        square = heights.view(-1, 3, 3)
        ends = [square[:, 2].mean(-1) - square[:, 0].mean(-1), square[..., 2].mean(-1) - square[..., 0].mean(-1)]
        slope = torch.stack(ends, dim=-1) / (2.0 * SLOPE_OVER_M)
        return torch.nn.functional.normalize(torch.cat([-slope, torch.ones_like(slope[:, :1])], dim=-1), dim=-1)

    def is_outside(self, body_position_m: Tensor) -> Tensor:
        """Which robots are within a metre of the edge, bool (n,); none on flat ground."""
        if self.is_level:
            return torch.zeros(len(body_position_m), dtype=torch.bool, device=body_position_m.device)
        return (body_position_m[:, :2].abs() > self._half_size_m - 1.0).any(dim=-1)


@dataclass(frozen=True)
class FootMotion:
    """The four feet (centres of their spheres), legs fl, fr, hl, hr."""

    position_in_world_m: Tensor
    """Shape (n, 4, 3)."""
    velocity_in_world_m_s: Tensor
    """Shape (n, 4, 3)."""


def motion_at_feet(state: TaskState) -> FootMotion:
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
