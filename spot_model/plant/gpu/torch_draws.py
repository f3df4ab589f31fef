"""Random numbers for effects on a GPU, from one torch generator."""

from __future__ import annotations

import torch

Tensor = torch.Tensor


class TorchDraws:
    """The draws that effects ask a source for (:class:`spot_model.effects.base.Draws`), as tensors of one device."""

    def __init__(self, seed: int, device: torch.device) -> None:
        self.generator = torch.Generator(device=device)
        self.generator.manual_seed(seed)
        self._device = device

    def random(self, size: tuple[int, ...]) -> Tensor:
        """Evenly drawn in [0, 1)."""
        return torch.rand(size, generator=self.generator, device=self._device)

    def standard_normal(self, size: tuple[int, ...]) -> Tensor:
        """Mean 0, standard deviation 1."""
        return torch.randn(size, generator=self.generator, device=self._device)

    def standard_exponential(self, size: tuple[int, ...]) -> Tensor:
        """Mean 1."""
        return torch.empty(size, device=self._device).exponential_(generator=self.generator)
