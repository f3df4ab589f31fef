"""The mean load of the joints while the robot stands: the feed-forward torque with which joint control begins."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from spot_model.robot.stamps import NS_PER_S
from spot_model.robot.state import Array, RobotState


class LoadAverage(NamedTuple):
    """The mean joint load over the newest states, so that one noisy sample does not become a feed-forward torque."""

    window_ns: int
    samples: tuple[tuple[int, Array], ...] = ()
    """Stamps and loads, oldest first."""

    @staticmethod
    def over(window_s: float) -> LoadAverage:
        """An average over so much robot time."""
        return LoadAverage(round(window_s * NS_PER_S))

    def after(self, states: Sequence[RobotState]) -> LoadAverage:
        """The average once these states have come, too; states older than the window fall out."""
        if not states:
            return self
        begin_ns = states[-1].robot_stamp_ns - self.window_ns
        samples = (*self.samples, *((state.robot_stamp_ns, state.load_nm) for state in states))
        return LoadAverage(self.window_ns, tuple(sample for sample in samples if sample[0] >= begin_ns))

    @property
    def is_full(self) -> bool:
        """Whether the samples span at least nine tenths of the window."""
        return bool(self.samples) and self.samples[-1][0] - self.samples[0][0] >= 0.9 * self.window_ns

    def mean_nm(self) -> Array:
        """Mean load, shape (12,), N·m.

        Raises:
            ValueError: No state was taken yet.
        """
        if not self.samples:
            raise ValueError("no state to average over")
        return np.asarray(np.mean([load for _, load in self.samples], axis=0))
