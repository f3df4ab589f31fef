"""The operator's velocity commands during training: drawn, held, drawn anew."""

from __future__ import annotations

from typing import Any

import torch

from trainer.config.task_config import CommandConfig
from trainer.task.draws import Draws

Tensor = torch.Tensor

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
