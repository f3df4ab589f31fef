"""Command delays from a log: keys say which command a robot had received, stamps say when."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from spot_log.read.run import Run
from spot_log.tools.measures import NEVER_NS, receipts_ns
from spot_model.errors import BadInputError
from spot_model.io.whole import whole_file
from spot_model.plant.delay import EmpiricalDelay

Array = NDArray[np.float64]

BIN_S: Final = 0.00025
"""Width of the histogram's bins."""


@dataclass(frozen=True)
class MeasuredDelays:
    """Delays of all commands whose receipt a state message shows."""

    path_s: Array
    """From the acquisition of the state that a command answers to its receipt; both by the robot's clock."""
    transit_s: Array
    """From the hand-over to the stream to the receipt; the former by the estimated robot clock, with its error."""

    @property
    def path_median_s(self) -> float:
        """Median of :attr:`path_s`; NaN without any."""
        return float(np.median(self.path_s)) if len(self.path_s) else float("nan")

    @property
    def transit_median_s(self) -> float:
        """Median of :attr:`transit_s`; NaN without any."""
        return float(np.median(self.transit_s)) if len(self.transit_s) else float("nan")


def measure_delays(runs: Sequence[Run]) -> MeasuredDelays:
    """Collect the delays of runs; each command counts once, at the first state that shows its receipt."""
    path: list[Array] = [np.zeros(0)]
    transit: list[Array] = [np.zeros(0)]
    for run in runs:
        received = receipts_ns(run)
        for sent, out in ((run.commands.state_robot_stamp_ns, path), (run.commands.robot_stamp_ns, transit)):
            known = (received < NEVER_NS) & (sent > 0)
            out.append(np.asarray((received[known] - sent[known]) * 1e-9, np.float64))
    return MeasuredDelays(np.concatenate(path), np.concatenate(transit))


def delay_histogram(delays_s: Array) -> EmpiricalDelay:
    """Histogram of delays, as a distribution that trainer, search and fake robot can draw from.

    Raises:
        BadInputError: There is no delay, or one is negative: the clocks of the log do not fit together.
    """
    if not len(delays_s):
        raise BadInputError("delays: no command's receipt is in the logs; give logs with commands and their keys")
    if float(np.min(delays_s)) < 0.0:
        raise BadInputError(
            f"delays: {int(np.sum(delays_s < 0))} of {len(delays_s)} commands were received before they were sent, by "
            f"up to {-1e3 * float(np.min(delays_s)):.2f} ms; the estimate of the robot's clock in these logs is off by "
            "more than the delay"
        )
    low, high = int(np.min(delays_s) / BIN_S), int(np.max(delays_s) / BIN_S) + 1
    edges = np.arange(low, high + 1) * BIN_S
    counts, _ = np.histogram(delays_s, edges)
    return EmpiricalDelay(edges_s=tuple(float(e) for e in edges), counts=tuple(float(c) for c in counts))


def write_delay_csv(delay: EmpiricalDelay, path: Path) -> None:
    """Write a histogram as :func:`spot_model.plant.delay.read_delay_csv` reads it; refuses to overwrite.

    Raises:
        OutputExistsError: The file exists.
    """
    with whole_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["low_s", "high_s", "count"])
        for low, high, count in zip(delay.edges_s, delay.edges_s[1:], delay.counts, strict=False):
            writer.writerow([f"{low:.6f}", f"{high:.6f}", f"{count:g}"])
