"""Draws from a torch generator that was passed in."""

from __future__ import annotations

import torch

Tensor = torch.Tensor


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
