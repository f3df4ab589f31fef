"""All recordings end to end, so that a channel computes on one set of arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter

from diagnosis.channels import Array, Channel, ChannelView, Flags, Ints
from diagnosis.read.segments import Segmentation, cut
from spot_model.errors import BadInputError
from spot_model.robot.rotation import rotate_inverse_wxyz, rotate_wxyz
from spot_model.robot.state import Measured
from trainer.signals.recording import GRID_TOLERANCE, Imu, Recording
from trainer.signals.smoothing import NOISE_GAIN, REACH, eroded, is_even, rate, rate_over

SAME_RATE: Final = 0.01
"""Share by which the periods of two logs may differ; where steps are uneven, a grid's tolerance."""
MIN_NOISE: Final = 1e-6
"""No channel's noise counts as less than this, in its own unit: simulated logs may have none."""
STRIDE: Final = 4
"""Channels of the body keep every fourth row: inverse dynamics are expensive, and smoothed signals change slowly."""
GRAVITY_M_S2: Final = 9.81
GRAVITY_TOLERANCE_M_S2: Final = 2.0
"""The mean vertical reading must be this near to gravity, or to none, to know whether it is in."""
RATTLE_REACH: Final = 9
"""States over which rattling is averaged, the reach of the smoothing filter."""
RATTLE_RAD_S: Final = 0.25
"""Root mean square of a velocity's second difference between states; a new set-point's step makes at most 0.2."""
TIMES_USUAL: Final = 3.0
"""Noisy velocities rattle all the time: only so many times the usual counts."""


@dataclass(frozen=True)
class Stack:
    """Recordings with their segmentations, and their signals end to end, n rows in all.

    Filters run over the boundaries between recordings; ``inner`` keeps away from them.
    """

    recordings: tuple[Recording, ...]
    segmentations: tuple[Segmentation, ...]
    states: Measured
    """With 0 for what is missing, which ``used`` tells; no feet where a recording has no contacts. Shapes (n, ...)."""
    imu: Imu
    """Likewise; its age is that of the first recording."""
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

    def missing(self, words: Mapping[str, str]) -> str:
        """What is said of the first of these signals that a recording lacks; empty if none is missing."""
        return next((told for signal, told in words.items() if not self.has(signal)), "")

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

    def inner(self, flags: Flags, before: int = REACH, after: int = REACH) -> Flags:
        """Flags of shape (n, ...) that hold throughout the filter's reach, within one recording."""
        return self.by_run(lambda part: eroded(part, before, after), flags)

    def kept_rows(self, reach: int = REACH) -> Ints:
        """One of :data:`STRIDE` rows, where the filter reaches nothing that is not used; shape (m,)."""
        return np.flatnonzero((np.arange(self.n) % STRIDE == 0) & self.inner(self.used, reach, reach))

    def by_run(self, compute: Callable[[NDArray[Any]], NDArray[Any]], values: NDArray[Any]) -> NDArray[Any]:
        """What a function of the same shape makes of (n, ...), each recording by itself."""
        return np.concatenate([compute(part) for part in np.split(values, self.starts()[1:])])

    def rate(self, raw: Array, at: slice | Ints | None = None) -> Array:
        """Derivative of what :func:`smooth` makes of (n, ...), by robot time, of all rows or those of ``at``."""
        if self.is_even:
            return rate(raw, self.period_s, at)
        parts = np.split(raw, self.starts()[1:])
        found = [rate_over(part, r.stamp_ns) for part, r in zip(parts, self.recordings, strict=True)]
        return np.asarray(np.concatenate(found)[slice(None) if at is None else at])

    @cached_property
    def is_even(self) -> bool:
        """Whether all recordings stand on grids."""
        return all(is_even(r.stamp_ns) for r in self.recordings)

    def low_pass(self, raw: Array, time_constant_s: float) -> Array:
        """First-order low pass of (n, k), starting at rest at each recording's first value; 0 s changes nothing."""
        if time_constant_s <= 0.0:
            return raw
        keep = float(np.exp(-self.period_s / time_constant_s))
        b, a = [1.0 - keep], [1.0, -keep]
        return self.by_run(lambda part: lfilter(b, a, part, axis=0, zi=keep * part[:1])[0], raw)

    def starts(self) -> Ints:
        """First row of each recording, shape (n_runs,)."""
        return np.flatnonzero(np.diff(self.run, prepend=-1)).astype(np.intp)

    @cached_property
    def linear_vel_in_body_m_s(self) -> Array:
        """Velocity of the body in its own frame, shape (n, 3)."""
        return np.asarray(
            rotate_inverse_wxyz(self.states.odom_from_body_wxyz, self.states.linear_vel_of_body_in_odom_m_s)
        )

    @cached_property
    def angular_vel_in_body_rad_s(self) -> Array:
        """Turn rate of the body in its own frame, shape (n, 3)."""
        return np.asarray(
            rotate_inverse_wxyz(self.states.odom_from_body_wxyz, self.states.angular_vel_of_body_in_odom_rad_s)
        )

    @cached_property
    def imu_in_odom_m_s2(self) -> Array:
        """The inertial unit's accelerations in odom, shape (n, 3)."""
        return np.asarray(rotate_wxyz(self.states.odom_from_body_wxyz, self.imu.acceleration_m_s2))

    @cached_property
    def imu_gravity_m_s2(self) -> float | None:
        """Gravity in the inertial unit's readings: 9.81 where it reports the specific force, 0 where the acceleration.

        None where there is no unit, or its mean is neither.
        """
        if not self.has("imu.acceleration_m_s2") or not self.used.any():
            return None
        mean = float(np.mean(self.imu_in_odom_m_s2[self.used, 2]))
        return next((g for g in (GRAVITY_M_S2, 0.0) if abs(mean - g) < GRAVITY_TOLERANCE_M_S2), None)

    @cached_property
    def rattles(self) -> Flags:
        """Where a joint's velocity rattles, by impacts or a foot that skips over the ground; shape (n, J).

        The load of one instant says little there of the mean acceleration between states, and no filter mends that.
        """
        velocity = self.states.velocity_rad_s
        second = np.zeros_like(velocity)
        second[1:-1] = velocity[2:] - 2.0 * velocity[1:-1] + velocity[:-2]
        size = np.sqrt(uniform_filter1d(second**2, RATTLE_REACH, axis=0))
        usual = np.median(size[self.used], axis=0) if self.used.any() else np.zeros(velocity.shape[1])
        return np.asarray(size > np.maximum(RATTLE_RAD_S, TIMES_USUAL * usual))


def stacked(recordings: Sequence[Recording]) -> Stack:
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
        is_even_pair = is_even(other.stamp_ns) and is_even(first.stamp_ns)
        if abs(other.period_s - first.period_s) > (SAME_RATE if is_even_pair else GRID_TOLERANCE) * first.period_s:
            raise BadInputError(
                f"log {other.run_id} has a state every {1e3 * other.period_s:.3f} ms, log {first.run_id} every "
                f"{1e3 * first.period_s:.3f} ms; diagnose logs of one state rate at a time"
            )
    segmentations = tuple(cut(r) for r in recordings)
    sizes = [len(r) for r in recordings]

    def filled(each: Sequence[Any]) -> Array:
        return np.asarray(np.nan_to_num(np.concatenate(each)))

    signals = {f.name: [getattr(r, f.name) for r in recordings] for f in fields(Measured)}
    contacts = signals.pop("foot_contact")
    n_feet = min(contact.shape[1] for contact in contacts)
    return Stack(
        recordings=tuple(recordings),
        segmentations=segmentations,
        states=Measured(
            **{name: filled(each) for name, each in signals.items()},
            foot_contact=np.concatenate([contact[:, :n_feet] for contact in contacts]),
        ),
        imu=Imu(
            filled([r.imu.acceleration_m_s2 for r in recordings]),
            filled([r.imu.angular_vel_rad_s for r in recordings]),
            first.imu.age_s,
        ),
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
