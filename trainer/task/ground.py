"""Height of the ground under a foot."""

from __future__ import annotations

import torch

from spot_model.robot.mjcf_options import NoiseTerrain
from spot_model.robot.mjcf_terrain import terrain_heights_m
from trainer.config.task_config import TerrainConfig

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
