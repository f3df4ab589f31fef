"""How far two aligned runs are apart: in step, and as distributions whatever the step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from compare.tracks import Track
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.rotation import yaw_rad
from trainer.signals.distances import wasserstein_sorted

SIGNALS: Final = {"position_rad": "rad", "velocity_rad_s": "rad/s", "load_nm": "N·m", "set_point_rad": "rad"}
TITLES: Final = {
    "position_rad": "joint position",
    "velocity_rad_s": "joint velocity",
    "load_nm": "load",
    "set_point_rad": "set-point",
}


@dataclass(frozen=True)
class SignalDifference:
    """One signal of the twelve joints, the other run minus the reference."""

    signal: str
    """Its name: position_rad, velocity_rad_s, load_nm or set_point_rad."""
    over_time: Array
    """Other minus reference at each sample. Shape (n, 12)."""
    rms: Array
    """Root mean square of that. Two walks drift out of phase, so it grows with time. Shape (12,)."""
    distance: Array
    """1-Wasserstein distance of the distributions of values, which ignores phase. Shape (12,)."""
    spread: Array
    """Standard deviation of the reference, for scale. Shape (12,)."""

    @property
    def share(self) -> Array:
        """Distance over spread; 0 where the signal is missing. Shape (12,)."""
        known = np.isfinite(self.distance) & (self.spread > 0.0)
        return np.divide(self.distance, self.spread, out=np.zeros_like(self.distance), where=known)

    @property
    def worst(self) -> int:
        """Number of the joint with the largest share."""
        return int(np.argmax(self.share))


@dataclass(frozen=True)
class Differences:
    """All differences of one run from the reference."""

    name: str
    """Name of the run."""
    signals: dict[str, SignalDifference]
    """By name of the signal; below."""
    forward_speed_m_s: tuple[float, float]
    """Mean over the stretch, reference and other."""
    speed_error_m_s: tuple[float, float]
    """Mean of |commanded − measured| forward speed, reference and other; NaN without commands."""
    end_distance_m: float
    """Distance between the two bodies at the end, if both start in the same place and direction."""

    @property
    def is_known(self) -> bool:
        """Whether the two runs have a signal of the joints in common; set-points left out."""
        return any(np.isfinite(s.distance).any() for s in self.signals.values() if s.signal != "set_point_rad")

    @property
    def largest(self) -> tuple[str, str, float]:
        """Signal, joint and share of the largest difference of distributions; set-points left out."""
        told = [(s.signal, facts.JOINT_NAMES[s.worst], float(s.share[s.worst])) for s in self.signals.values()]
        return max((t for t in told if t[0] != "set_point_rad"), key=lambda t: t[2])


def differences(reference: Track, other: Track) -> Differences:
    """Compare two aligned tracks of equal length."""
    return Differences(
        name=other.name,
        signals={name: _signal(name, getattr(reference, name), getattr(other, name)) for name in SIGNALS},
        forward_speed_m_s=(_mean(reference.body_velocity[:, 0]), _mean(other.body_velocity[:, 0])),
        speed_error_m_s=(_speed_error(reference), _speed_error(other)),
        end_distance_m=float(np.linalg.norm(_travelled(reference) - _travelled(other))),
    )


def _signal(name: str, reference: Array, other: Array) -> SignalDifference:
    over_time = other - reference
    good = np.isfinite(over_time).all(axis=1)
    if not good.any():
        nothing = np.full(facts.N_JOINTS, np.nan)
        return SignalDifference(name, over_time, nothing, nothing, np.zeros(facts.N_JOINTS))
    return SignalDifference(
        signal=name,
        over_time=over_time,
        rms=np.sqrt((over_time[good] ** 2).mean(axis=0)),
        distance=wasserstein_sorted(*(np.sort(values[good], axis=0).T for values in (reference, other))),
        spread=reference[good].std(axis=0),
    )


def _mean(values: Array) -> float:
    return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")


def _speed_error(track: Track) -> float:
    return _mean(np.abs(track.velocity_command[:, 0] - track.body_velocity[:, 0]))


def _travelled(track: Track) -> Array:
    """Where the body ends, seen from where it started and looked, on the ground. Shape (2,), m."""
    moved = (track.position_of_body_in_odom_m[-1] - track.position_of_body_in_odom_m[0])[:2]
    yaw = float(yaw_rad(track.odom_from_body_wxyz[0]))
    turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    return np.asarray(turn @ moved)
