"""A policy whose actions are changed from some instant on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray
from typing_extensions import Self

from spot_model.policy.policy import Policy

Actions = NDArray[np.float32]


@dataclass
class Change:
    """What is done to a network's output."""

    act: Callable[[Actions], Actions] | None = None
    """Takes and returns shape (n, 12); None: nothing is done."""


@dataclass(frozen=True)
class FaultyPolicy(Policy):
    """A policy whose output may be changed while it runs."""

    change: Change = field(default_factory=Change)

    @classmethod
    def of(cls, policy: Policy) -> Self:
        """Make the same policy, unchanged so far."""
        return cls(**{part.name: getattr(policy, part.name) for part in fields(policy)})

    def act(self, observation: NDArray[Any]) -> Actions:
        """Act like the real one, changed; shapes (48,) to (12,), or (n, 48) to (n, 12)."""
        if self.change.act is None:
            return super().act(observation)
        actions = self.change.act(super().act(np.atleast_2d(observation)))
        return actions[0] if np.ndim(observation) == 1 else actions
