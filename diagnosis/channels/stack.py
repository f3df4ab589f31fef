"""All recordings end to end, so that a channel computes on one set of arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from diagnosis.channels import Array, Channel, ChannelView, Flags, Ints
from diagnosis.read.segments import Segmentation, cut
from spot_model.errors import BadInputError
from trainer.signals.recording import Recording
from trainer.signals.smoothing import NOISE_GAIN, REACH, Rows, eroded, rate, too_coarse

MIN_NOISE: Final = 1e-6
"""No channel's noise counts as less than this, in its own unit: simulated logs may have none."""


@dataclass(frozen=True)
class Stack:
    """Recordings with their segmentations, n rows in all.

    Filters run over the boundaries between recordings; ``inner`` keeps away from them.
    """

    recordings: tuple[Recording, ...]
    segmentations: tuple[Segmentation, ...]
    run: Ints
    """Number of the recording, shape (n,)."""
    state: Ints
    """Row within the recording, shape (n,)."""
    used: Flags
    """What the segmentation leaves, shape (n,)."""
    period_s: float

    @property
    def n(self) -> int:
        """Number of rows."""
        return len(self.run)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the robot's joints, in order."""
        return self.recordings[0].joint_names

    @property
    def legs(self) -> Ints:
        """Leg of each joint by the joint's prefix, -1 where none fits; shape (J,)."""
        legs = {name: i for i, name in enumerate(self.recordings[0].foot_names)}
        return np.array([legs.get(name.split("_")[0], -1) for name in self.joint_names], dtype=np.intp)

    def has(self, signal: str) -> bool:
        """Whether every recording has the signal, an attribute's name."""
        return all(r.has(signal) for r in self.recordings)

    def missing(self, names: Mapping[str, str]) -> str:
        """The name in words of the first of these signals that a recording lacks; empty if none is missing."""
        return next((name for signal, name in names.items() if not self.has(signal)), "")

    def view(self, name: Channel, at: Any, response: Array, **rest: Any) -> ChannelView:
        """A channel with a sample at each state of ``at``; the rest are fields of :class:`ChannelView`.

        Unless they are given, its rows belong to no joint and no leg, and nothing is fitted beside any effect.
        """
        none = np.full(response.shape[1], -1)
        defaults: dict[str, Any] = {
            "run": self.run[at],
            "state": self.state[at],
            "nuisance": np.zeros((*response.shape, 0)),
            "row_joint": none,
            "row_leg": none,
            "leg_of_joint": np.full(len(self.joint_names), -1),
        }
        return ChannelView(name=name, response=response, **{**defaults, **rest})

    def joint_view(self, name: Channel, at: Any, response: Array, legs: Ints, **rest: Any) -> ChannelView:
        """The same with a row a joint, of the legs that are given."""
        rows = {"rows": self.joint_names, "row_joint": np.arange(len(legs)), "row_leg": legs, "leg_of_joint": legs}
        return self.view(name, at, response, **rows, **rest)

    def cat(self, part: Callable[[Recording], Any]) -> NDArray[Any]:
        """The same array of all recordings, end to end."""
        return np.concatenate([np.asarray(part(r)) for r in self.recordings])

    def filled(self, part: Callable[[Recording], Any]) -> Array:
        """Like :meth:`cat`, with 0 for what is missing; :attr:`used` has it marked."""
        return np.nan_to_num(self.cat(part).astype(np.float64))

    def rate(self, values: Array, at: Rows | None = None) -> Array:
        """Derivative of the smoothed values along time, per second."""
        return rate(values, self.period_s, at)

    def inner(self, flags: Flags, before: int = REACH, after: int = REACH) -> Flags:
        """Flags of shape (n, ...) that hold throughout the filter's reach, within one recording."""
        return self.by_run(lambda part: eroded(part, before, after), flags)

    def by_run(self, compute: Callable[[NDArray[Any]], NDArray[Any]], values: NDArray[Any]) -> NDArray[Any]:
        """What a function of the same shape makes of (n, ...), each recording by itself."""
        return np.concatenate([compute(part) for part in np.split(values, self.starts()[1:])])

    def low_pass(self, raw: Array, time_constant_s: float) -> Array:
        """First-order low pass of (n, k), starting at rest at each recording's first value; 0 s changes nothing."""
        if time_constant_s <= 0.0:
            return raw
        keep = float(np.exp(-self.period_s / time_constant_s))
        b, a = [1.0 - keep], [1.0, -keep]
        return self.by_run(lambda part: lfilter(b, a, part, axis=0, zi=keep * part[:1])[0], raw)

    def step_s(self) -> Array:
        """Time since the row before, the period at a recording's first; shape (n, 1), s."""
        steps = self.cat(lambda r: np.diff(r.time_s, prepend=-r.period_s))
        return np.asarray(np.maximum(steps, 1e-9)[:, None])

    def too_coarse(self) -> str:
        """Why accelerations cannot be had from these states; empty if they can."""
        return too_coarse(self.period_s)

    def starts(self) -> Ints:
        """First row of each recording, shape (n_runs,)."""
        return np.flatnonzero(np.diff(self.run, prepend=-1)).astype(np.intp)


def stack(recordings: Sequence[Recording]) -> Stack:
    """Segment the recordings and put them end to end.

    Raises:
        BadInputError: There are none, or they are of different robots or state rates.
    """
    if not recordings:
        raise BadInputError("no recording to diagnose; give at least one log")
    first = recordings[0]
    for other in recordings[1:]:
        if other.joint_names != first.joint_names:
            raise BadInputError(
                f"log {other.run_id} has joints {', '.join(other.joint_names)}; log {first.run_id} has "
                f"{', '.join(first.joint_names)}; diagnose logs of one robot at a time"
            )
        if abs(other.period_s - first.period_s) > 0.01 * first.period_s:
            raise BadInputError(
                f"log {other.run_id} has a state every {1e3 * other.period_s:.3f} ms, log {first.run_id} every "
                f"{1e3 * first.period_s:.3f} ms; diagnose logs of one state rate at a time"
            )
    segmentations = tuple(cut(r) for r in recordings)
    sizes = [len(r) for r in recordings]
    return Stack(
        recordings=tuple(recordings),
        segmentations=segmentations,
        run=np.repeat(np.arange(len(sizes), dtype=np.intp), sizes),
        state=np.concatenate([np.arange(s, dtype=np.intp) for s in sizes]),
        used=np.concatenate([s.used for s in segmentations]),
        period_s=first.period_s,
    )


def white_noise(residual: Array, usable: Flags, *, is_smoothed: bool = False) -> Array:
    """Standard deviation that white noise in an unsmoothed residual leaves after smoothing.

    From the median size of second differences, which hardly see what is smooth or rare. The residual and where it is
    usable have shape (n, R), rows in time, the result (R,); ``is_smoothed`` where it is smoothed and thinned already.
    """
    second = np.abs(residual[2:] - 2.0 * residual[1:-1] + residual[:-2])
    good = usable[2:] & usable[1:-1] & usable[:-2]
    medians = [float(np.median(v[g])) if g.any() else np.inf for v, g in zip(second.T, good.T, strict=True)]
    sigma = 1.4826 * np.array(medians) / np.sqrt(6.0)
    return np.asarray(np.maximum(sigma if is_smoothed else NOISE_GAIN * sigma, MIN_NOISE))
