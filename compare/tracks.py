"""Runs as arrays on an even grid of time, brought to one clock: the shift at which their velocity commands agree best.

The grid begins with the policy's first tick.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from spot_log.read.run import Run
from spot_log.tools.measures import body_velocity
from spot_model.errors import BadInputError
from spot_model.policy.observation import is_fallen
from spot_model.robot import facts
from spot_model.robot.facts import Array
from trainer.signals.policy_ticks import policy_ticks
from trainer.signals.recording import Flags, nearest_rows

STEP_S: Final = 0.01
"""The grid: fine enough for a leg's swing, a third of the states of a 333 Hz stream."""
LEAST_S: Final = 1.0
ALLOWED: Final = 0.15
"""Largest difference of the velocity commands (m/s, rad/s) at any instant up to which two runs were told the same."""
AXES: Final = (("forward", "m/s"), ("to the left", "m/s"), ("turning", "rad/s"))
SLIP_S: Final = 0.1
"""A command may come so much earlier or later: five ticks of a policy, which a busy computer may lose."""
STRIDE: Final = 2
"""Shifts are tried every so many samples: commands change with the policy's 50 Hz."""
LEAST_SHARE: Final = 0.5
"""Two runs must overlap by this share of the shorter one."""


class CompareError(BadInputError):
    """Two runs cannot be compared as asked; the message says what to give instead."""


@dataclass(frozen=True)
class Track:
    """Signals of one run, n samples :data:`STEP_S` apart; joints in canonical order, NaN where the run has no value."""

    name: str
    """Name of the run."""
    is_simulated: bool
    """Whether it was simulated."""
    whole_s: float
    """How long the run is under the policy, of which the samples may be a part."""
    fell: bool
    """Whether the run ended in a fall."""
    start_ns: int
    """Stamp of the first sample, the robot's clock."""
    stamp_ns: NDArray[np.int64]
    """Stamps of the samples, the robot's clock. Shape (n,)."""
    velocity_command: Array
    """V_x, V_y (m/s), ω_z (rad/s). Shape (n, 3)."""
    set_point_rad: Array
    """Joint positions that were asked for. Shape (n, 12)."""
    position_rad: Array
    """Measured joint positions. Shape (n, 12)."""
    velocity_rad_s: Array
    """Measured joint velocities. Shape (n, 12)."""
    load_nm: Array
    """Torques that the joints report. Shape (n, 12)."""
    body_velocity: Array
    """V_x, V_y (m/s) and ω_z (rad/s) in the body frame. Shape (n, 3)."""
    position_of_body_in_odom_m: Array
    """Position of the body in odom. Shape (n, 3)."""
    odom_from_body_wxyz: Array
    """Its orientation, scalar first. Shape (n, 4)."""
    foot_contact: Flags
    """Whether each foot is on the ground. Shape (n, 4), or (n, 0) where the run has none."""

    def __len__(self) -> int:
        return len(self.stamp_ns)

    @property
    def time_s(self) -> Array:
        """Time since the first sample. Shape (n,), s."""
        return np.asarray(np.arange(len(self)) * STEP_S, dtype=np.float64)

    def part(self, rows: slice) -> Track:
        """The samples of ``rows``, as a track of their own."""
        arrays = {name: value[rows] for name, value in vars(self).items() if isinstance(value, np.ndarray)}
        start_ns = int(arrays["stamp_ns"][0]) if len(arrays["stamp_ns"]) else self.start_ns
        given: dict[str, Any] = {**arrays, "start_ns": start_ns}
        return replace(self, **given)


def track_of(run: Run, name: str, *, is_simulated: bool = False) -> Track:
    """Lay a run out on the grid; of a run without policy ticks all of it.

    Raises:
        CompareError: The run is not of Spot's joints, or has less than a second.
    """
    if run.header.joint_names != facts.JOINT_NAMES:
        joints = ", ".join(run.header.joint_names)
        raise CompareError(f"{name} has the joints {joints}; only runs of Spot's twelve joints are compared")
    states, rows = run.states, policy_ticks(run)
    stamps = run.ticks.robot_stamp_ns[rows] if len(rows) else states.robot_stamp_ns
    first_ns, last_ns = (int(stamps[0]), int(stamps[-1])) if len(stamps) else (0, 0)
    length_s = (last_ns - first_ns) * 1e-9 if len(states) > 1 else 0.0
    _check_length(name, length_s)
    grid_ns = first_ns + np.arange(0, last_ns - first_ns + 1, round(STEP_S * 1e9), dtype=np.int64)
    at = nearest_rows(states.robot_stamp_ns, grid_ns)
    linear, angular = body_velocity(run)
    return Track(
        name=name,
        is_simulated=is_simulated,
        whole_s=length_s,
        fell=len(rows) < len(run.policy_rows) and bool(is_fallen(run.ticks.observation[run.policy_rows]).any()),
        start_ns=first_ns,
        stamp_ns=grid_ns,
        velocity_command=_held(run.ticks.robot_stamp_ns, run.ticks.velocity_command, grid_ns, 3),
        set_point_rad=_held(run.commands.robot_stamp_ns, run.commands.position_rad, grid_ns, facts.N_JOINTS),
        position_rad=states.position_rad[at],
        velocity_rad_s=states.velocity_rad_s[at],
        load_nm=states.load_nm[at],
        body_velocity=np.column_stack([linear[at, :2], angular[at, 2]]),
        position_of_body_in_odom_m=states.position_of_body_in_odom_m[at],
        odom_from_body_wxyz=states.odom_from_body_wxyz[at],
        foot_contact=states.foot_contact[at],
    )


def _held(stamps: NDArray[np.int64], values: Array, grid_ns: NDArray[np.int64], width: int) -> Array:
    """The newest value at each instant of the grid; NaN before the first."""
    if len(stamps) == 0:
        return np.full((len(grid_ns), width), np.nan)
    at = np.searchsorted(stamps, grid_ns, side="right") - 1
    return np.where(at[:, None] >= 0, values[np.maximum(at, 0)], np.nan)


def aligned_tracks(tracks: Sequence[Track]) -> list[Track]:
    """The stretch that all runs share, each run's samples at the same time under the command.

    Args:
        tracks: The first is the reference.

    Raises:
        CompareError: A run was told something else than the first, or the runs share less than a second.
    """
    reference, *others = tracks
    shifts = [0, *(shift(reference, other) for other in others)]
    begin = max(0, *(-s for s in shifts)) if others else 0
    end = min(len(t) - s for t, s in zip(tracks, shifts, strict=True))
    _check_length("what the runs have in common", max(0, end - begin) * STEP_S)
    return [t.part(slice(begin + s, end + s)) for t, s in zip(tracks, shifts, strict=True)]


def shift(reference: Track, other: Track) -> int:
    """How many samples later ``other`` does what ``reference`` does; the smallest such shift where several agree.

    Raises:
        CompareError: At no shift do the commands agree.
    """
    a, b = reference.velocity_command, other.velocity_command
    if np.isnan(a).all() or np.isnan(b).all():
        return 0  # a recording without commands: the starts are aligned
    shortest = round(LEAST_SHARE * min(len(a), len(b)))
    candidates = sorted(range(-(len(a) - shortest), len(b) - shortest + 1, STRIDE), key=abs)
    if 0 not in candidates:
        candidates.insert(0, 0)
    differences = [_difference(a, b, s) for s in candidates]
    best = candidates[int(np.argmin(np.round(differences, 3)))]  # ties: the first, which is the smallest shift
    _check_same(reference, other, best)
    return best


def _overlap(a: Array, b: Array, s: int) -> tuple[Array, Array]:
    begin, end = max(0, -s), min(len(a), len(b) - s)
    return a[begin:end], b[begin + s : end + s]


def _difference(a: Array, b: Array, s: int) -> float:
    first, second = _overlap(a, b, s)
    return float(np.nanmean(np.abs(first - second))) if len(first) else np.inf


def _check_same(reference: Track, other: Track, s: int) -> None:
    """Refuse a run that at any instant was told something else, on any axis; steps may come a little early or late."""
    first, second = _overlap(reference.velocity_command, other.velocity_command, s)
    apart = np.nan_to_num(np.maximum(_beyond(first, second), _beyond(second, first)))
    at, axis = np.unravel_index(int(np.argmax(apart)), apart.shape)
    if apart[at, axis] > ALLOWED:
        at_s = (max(0, -s) + int(at)) * STEP_S
        name, unit = AXES[axis]
        raise CompareError(
            f"{reference.name} and {other.name} follow different velocity commands: after {at_s:.1f} s they get "
            f"{first[at, axis]:.2f} and {second[at, axis]:.2f} {unit} {name}; {ALLOWED:g} apart is allowed; compare "
            "runs of one sequence, or a log with a model, which is simulated with the log's own commands"
        )


def _beyond(command: Array, other: Array) -> Array:
    """How far a command leaves what the other one is about that time, shape (n, 3)."""
    size = 2 * round(SLIP_S / STEP_S) + 1
    low, high = minimum_filter1d(other, size, axis=0), maximum_filter1d(other, size, axis=0)
    return np.asarray(np.maximum(low - command, command - high))


def _check_length(name: str, seconds: float) -> None:
    if seconds < LEAST_S:
        raise CompareError(f"{name} has {seconds:.1f} s under the policy; at least {LEAST_S:g} s are needed")
