"""Sums over finished episodes, kept on the device and read once per iteration to avoid synchronisation."""

from __future__ import annotations

from collections.abc import Iterable

import torch

Tensor = torch.Tensor


class EpisodeStats:
    """Reward sums by term, lengths and falls of episodes."""

    def __init__(self, terms: Iterable[str], n: int, device: torch.device | str) -> None:
        self.terms = tuple(terms)
        self.running = torch.zeros(n, len(self.terms), device=device)
        self.length = torch.zeros(n, device=device)
        self._finished_terms = torch.zeros(len(self.terms), device=device)
        self._counts = torch.zeros(3, device=device)

    def add(self, by_term: Tensor, done: Tensor, fell: Tensor) -> None:
        """Count one step: weighted rewards (n, terms), and which episodes ended, and by a fall (bool, (n,))."""
        self.running += by_term
        self.length += 1.0
        ended = done.float()
        self._finished_terms += ended @ self.running
        self._counts += torch.stack([ended.sum(), ended @ self.length, fell.float().sum()])
        self.running *= (1.0 - ended)[:, None]
        self.length *= 1.0 - ended

    def drain(self) -> dict[str, float]:
        """Means over the episodes that ended since the last call, then start afresh; empty if none ended."""
        episodes, length, falls = self._counts.tolist()
        terms = self._finished_terms.tolist()
        self._counts.zero_()
        self._finished_terms.zero_()
        if episodes == 0:
            return {}
        means = {f"reward/{name}": value / episodes for name, value in zip(self.terms, terms, strict=True)}
        return {
            "reward": sum(terms) / episodes,
            "episode_length": length / episodes,
            "fall_share": falls / episodes,
            "episodes": episodes,
            **means,
        }
