"""The operator's velocity commands during training: drawn, held, drawn anew."""

from __future__ import annotations

from typing import Any

import torch

from trainer.backends.random_draws import Draws
from trainer.config.task_config import CommandConfig

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

    def draw(self) -> Tensor:
        """New commands for all robots, shape (n, 3)."""
        c, n = self.config, len(self.command)
        command = torch.stack(
            [
                self._draws.uniform(_narrowed(bounds, self.share), n)
                for bounds in (c.v_x_m_s, c.v_y_m_s, c.yaw_rate_rad_s)
            ],
            dim=-1,
        )
        if c.slow_share > 0.0:
            slow = self._draws.uniform((0.0, 1.0), n) < c.slow_share
            command *= torch.where(slow, SLOW, 1.0)[:, None]
        acceleration = (command[:, 0] * command[:, 2]).abs()
        scale = (c.lateral_acceleration_limit_m_s2 / acceleration.clamp(min=1e-6)).clamp(max=1.0)
        chance = self._draws.uniform((0.0, 1.0), n)
        straight_from = c.standing_share
        turning_from = straight_from + c.straight_share
        straight = (chance >= straight_from) & (chance < turning_from)
        turning = (chance >= turning_from) & (chance < turning_from + c.turning_share)
        command[:, 1:] *= (scale * ~straight)[:, None]
        command[:, :2] *= ~turning[:, None]
        return command * (chance >= c.standing_share)[:, None]

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
        self.share = c.curriculum_start + (1.0 - c.curriculum_start) * done if c.curriculum_iterations else 1.0

    def snapshot(self) -> dict[str, Any]:
        """Command state by name."""
        return {"command": self.command.clone(), "time_left_s": self.time_left_s.clone(), "share": self.share}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from a snapshot."""
        self.command.copy_(snapshot["command"])
        self.time_left_s.copy_(snapshot["time_left_s"])
        self.share = float(snapshot["share"])


def _narrowed(bounds: tuple[float, float], share: float) -> tuple[float, float]:
    """A range shrunk towards zero (towards its nearer end where zero lies outside)."""
    centre = min(max(0.0, bounds[0]), bounds[1])
    return (centre + share * (bounds[0] - centre), centre + share * (bounds[1] - centre))
