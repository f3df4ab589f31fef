"""What a gait is, from contacts alone.

The terms are Hildebrand's (Science 150, 1965; BioScience 39, 1989) and Alexander's (Int. J. Robotics Research 3, 1984):
a stride lasts from one touch-down of a foot to its next; a foot's phase is when it touches down in the stride; its duty
factor is the share of the stride in which it stands. A pair of feet (both front, both hind) is alternate where its two
touch-downs are half a stride apart and in step where they are together; where both pairs are alternate the gait is
symmetrical, and how far the fore foot follows the hind foot of its side tells a pace (0), a walk (a quarter or three
quarters) and a trot (a half) apart. Where both pairs are in step it is a pronk (all four together) or a bound; where
one leads by something between and none alternates, a gallop. Boundaries lie half-way, an eighth of a stride from each.
"""

from __future__ import annotations

import itertools
from collections import Counter
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spot_model.robot import facts
from spot_model.robot.facts import Array

Contact = NDArray[np.bool_]

PAIRS: Final[dict[str, tuple[int, int]]] = {
    "diagonal fl hr": (0, 3),
    "diagonal fr hl": (1, 2),
    "front": (0, 1),
    "hind": (2, 3),
    "left": (0, 2),
    "right": (1, 3),
}
"""Two feet each, by number in the order fl, fr, hl, hr."""

HALF_WAY: Final = 0.125
"""Strides: half of the quarter that separates neighbouring gaits."""
FLYING_FROM: Final = 0.05
"""Share of time with no foot on the ground from which a trot is a flying one."""
SHORTEST_PHASE_S: Final = 0.02
"""Contacts and gaps below this are chatter of the contact, not steps: no phase of a leg's swing is this short."""
STANDING_SHARE: Final = 0.5
"""Share of time on four feet from which a robot without a regular gait is said to stand."""
HOPS: Final = frozenset({"pronk", "bound"})
"""Gaits in which the feet of a pair leave the ground together."""


@dataclass(frozen=True)
class Gait:
    """What was measured over one span of time; legs fl, fr, hl, hr."""

    name: str
    """stand, walk, trot, flying trot, pace, bound, pronk, gallop or none: what most strides are."""
    clarity: float
    """Share of strides that are of this name, 0 to 1; standing, the share of time on four feet."""
    stride_hz: float
    """Strides a second, the median of the feet; 0 where none steps twice."""
    duty: tuple[float, ...]
    """Share of time on the ground."""
    phase: tuple[float, ...]
    """When the foot touches down after fl, in strides, −0.5 to 0.5; NaN where it cannot be said."""
    agreement: dict[str, float]
    """Share of time in which two feet are both up or both down, by the names of :data:`PAIRS`."""
    flight_share: float
    """Share of time with no foot on the ground."""
    touchdown_m_s: float
    """Mean downward speed just before touch-down; NaN where speeds were not given."""

    @property
    def diagonals_agree(self) -> float:
        """The lower agreement of the two diagonals."""
        return min(v for k, v in self.agreement.items() if k.startswith("diagonal"))

    @property
    def others_agree(self) -> float:
        """The highest agreement of the front, hind, left and right pair."""
        return max(v for k, v in self.agreement.items() if not k.startswith("diagonal"))

    def sentence(self) -> str:
        """The gait in a line."""
        if self.name == "stand":
            return "stand" if self.clarity > 0.95 else f"stand ({self.clarity:.0%} of the time on four feet)"
        name = "no regular gait" if self.name == "none" else f"{self.name} ({self.clarity:.0%} of strides)"
        return (
            f"{name}, {self.stride_hz:.1f} strides/s, "
            f"duty {np.mean(self.duty):.2f}, flight {self.flight_share:.0%}, "
            f"diagonals agree {self.diagonals_agree:.2f}, other pairs at most {self.others_agree:.2f}"
        )


def measure_gait(time_s: ArrayLike, contact: ArrayLike, descent_m_s: ArrayLike | None = None) -> Gait:
    """Measure the gait of one span of time.

    Args:
        time_s: Stamps, rising, shape (T,), s; they need not be evenly spaced.
        contact: Feet on the ground, bool, shape (T, 4), legs fl, fr, hl, hr; each holds until the next stamp.
        descent_m_s: Downward speed of each foot, shape (T, 4), m/s, if it is known.

    Raises:
        ValueError: Shapes differ, there are fewer than two stamps, or the stamps do not rise.
    """
    time = np.asarray(time_s, dtype=np.float64)
    feet = np.asarray(contact, dtype=np.bool_)
    if feet.shape != (len(time), facts.N_LEGS) or len(time) < 2 or not np.all(np.diff(time) > 0):
        raise ValueError(f"time {time.shape} and contact {feet.shape}: (T,) and (T, 4) with T ≥ 2 and rising stamps")
    feet = without_chatter(time, feet)
    lasts = np.append(np.diff(time), np.median(np.diff(time)))

    def share(what: Contact) -> float:
        return float((what * lasts).sum() / lasts.sum())

    starts = [np.flatnonzero(~feet[:-1, leg] & feet[1:, leg]) + 1 for leg in range(facts.N_LEGS)]
    touchdowns = [time[rows] for rows in starts]
    standing = feet.sum(axis=-1)
    everywhere, flight = share(standing == facts.N_LEGS), share(standing == 0)
    lags = stride_lags(touchdowns, (float(time[0]), float(time[-1])))
    name, clarity = _most_strides(lags, flight, float(np.mean([share(feet[:, leg]) for leg in range(4)])))
    if everywhere >= STANDING_SHARE and name == "none":
        name, clarity = "stand", everywhere
    return Gait(
        name=name,
        clarity=clarity,
        stride_hz=_stride_hz(touchdowns),
        duty=tuple(share(feet[:, leg]) for leg in range(facts.N_LEGS)),
        phase=tuple(_phases(lags)),
        agreement={key: share(feet[:, a] == feet[:, b]) for key, (a, b) in PAIRS.items()},
        flight_share=flight,
        touchdown_m_s=_touchdown_speed(starts, descent_m_s),
    )


def without_chatter(time_s: Array, contact: Contact) -> Contact:
    """Contacts (T, 4) with gaps, then contacts, shorter than :data:`SHORTEST_PHASE_S` filled in."""
    clean = contact.copy()
    for leg in range(contact.shape[1]):
        for value in (False, True):
            column = clean[:, leg]
            edges = np.flatnonzero(np.diff(column.astype(np.int8))) + 1
            for first, last in itertools.pairwise(edges):
                if column[first] == value and time_s[last] - time_s[first] < SHORTEST_PHASE_S - 1e-9:
                    clean[first:last, leg] = not value
    return clean


def stride_lags(touchdowns: list[Array], span_s: tuple[float, float]) -> Array:
    """When each foot touches down in each whole stride of fl, in strides, −0.5 to 0.5, shape (strides, 4).

    Args:
        touchdowns: Times of each foot, s, rising.
        span_s: First and last time that was seen.

    NaN where a foot does not touch down, or does so twice, within that stride.
    """
    own = touchdowns[0]
    strides = [
        (start, end)
        for start, end in itertools.pairwise(own)
        if start - (end - start) / 2 >= span_s[0] and end <= span_s[1]
    ]
    lags = np.full((len(strides), facts.N_LEGS), np.nan)
    for row, (start, end) in enumerate(strides):
        for leg, times in enumerate(touchdowns):
            # Windows that begin before the stride, so that a foot in step with fl may be a little early.
            lag = (times - start) / (end - start)
            near = lag[(lag >= -0.5) & (lag < 0.5)]
            after = lag[(lag >= -0.25) & (lag < 0.75)]
            if len(near) == 1 or len(after) == 1:
                lags[row, leg] = _wrapped(near[0] if len(near) == 1 else after[0])
    return lags


def name_of(lag: ArrayLike, flight_share: float = 0.0, duty: float = 0.5) -> str:
    """The usual name of one stride.

    Args:
        lag: Touch-downs in strides, shape (4,), legs fl, fr, hl, hr.
        flight_share: Share of time with no foot on the ground.
        duty: Mean duty factor; a gait of four beats is a walk where this is a half or more.
    """
    fl, fr, hl, hr = np.asarray(lag, dtype=np.float64)
    if not np.isfinite([fl, fr, hl, hr]).all():
        return "none"
    pairs = abs(_wrapped(fr - fl)), abs(_wrapped(hr - hl))
    fore_after_hind = abs(_mean_lag([fl - hl, fr - hr]))
    alternate = [lag >= 0.5 - HALF_WAY for lag in pairs]
    in_step = [lag <= HALF_WAY for lag in pairs]
    if all(alternate):
        if fore_after_hind >= 0.5 - HALF_WAY:
            return "flying trot" if flight_share > FLYING_FROM else "trot"
        if fore_after_hind <= HALF_WAY:
            return "pace"
        return "walk" if duty >= 0.5 else "none"
    if all(in_step):
        return "pronk" if fore_after_hind <= HALF_WAY else "bound"
    return "none" if any(alternate) else "gallop"


def _most_strides(lags: Array, flight_share: float, duty: float) -> tuple[str, float]:
    if len(lags) < 2:
        return "none", 0.0
    names = Counter(name_of(row, flight_share, duty) for row in lags)
    name, count = names.most_common(1)[0]
    return name, count / len(lags)


def _phases(lags: Array) -> list[float]:
    return [_mean_lag(column[np.isfinite(column)]) if np.isfinite(column).any() else float("nan") for column in lags.T]


def _stride_hz(touchdowns: list[Array]) -> float:
    rates = [(len(t) - 1) / (t[-1] - t[0]) for t in touchdowns if len(t) >= 2]
    return float(np.median(rates)) if rates else 0.0


def _touchdown_speed(starts: list[NDArray[np.int64]], descent_m_s: ArrayLike | None) -> float:
    if descent_m_s is None:
        return float("nan")
    descent = np.asarray(descent_m_s, dtype=np.float64)
    speeds = np.concatenate([descent[rows - 1, leg] for leg, rows in enumerate(starts)])
    return float(np.clip(speeds, 0.0, None).mean()) if len(speeds) else float("nan")


def _wrapped(lag: float) -> float:
    """A lag in strides brought to −0.5 up to 0.5."""
    return float((lag + 0.5) % 1.0 - 0.5)


def _mean_lag(lags: ArrayLike) -> float:
    """Circular mean, in strides."""
    return float(np.angle(np.exp(2j * np.pi * np.asarray(lags)).mean()) / (2 * np.pi))
