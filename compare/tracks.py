"""A run as arrays on an even grid of time that begins with the policy's first tick."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from compare.errors import DifferentJointsError, TooShortError
from spot_log.read.run import Run
from spot_model.policy.observation import is_fallen
from spot_model.robot import facts
from spot_model.robot.rotation import rotate_inverse_wxyz
from trainer.signals.policy_ticks import policy_ticks

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

STEP_S: Final = 0.01
"""The grid: fine enough for a leg's swing, a third of the states of a 333 Hz stream."""
LEAST_S: Final = 1.0


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
        DifferentJointsError: The run is not of Spot's joints.
        TooShortError: It has less than a second.
    """
    if run.header.joint_names != facts.JOINT_NAMES:
        raise DifferentJointsError(name, run.header.joint_names)
    states, rows = run.states, policy_ticks(run)
    if len(states) < 2:
        raise TooShortError(name, 0.0, LEAST_S)
    stamps = states.robot_stamp_ns
    first_ns, last_ns = int(stamps[0]), int(stamps[-1])
    if len(rows):
        first_ns, last_ns = int(run.ticks.robot_stamp_ns[rows[0]]), int(run.ticks.robot_stamp_ns[rows[-1]])
    length_s = (last_ns - first_ns) * 1e-9
    if length_s < LEAST_S:
        raise TooShortError(name, length_s, LEAST_S)
    grid_ns = first_ns + np.arange(0, last_ns - first_ns + 1, round(STEP_S * 1e9), dtype=np.int64)
    at = _nearest(stamps, grid_ns)
    attitude = states.odom_from_body_wxyz[at]
    linear = rotate_inverse_wxyz(attitude, states.linear_vel_of_body_in_odom_m_s[at])
    angular = rotate_inverse_wxyz(attitude, states.angular_vel_of_body_in_odom_rad_s[at])
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
        body_velocity=np.column_stack([linear[:, :2], angular[:, 2]]),
        position_of_body_in_odom_m=states.position_of_body_in_odom_m[at],
        odom_from_body_wxyz=attitude,
        foot_contact=states.foot_contact[at],
    )


def _nearest(stamps: NDArray[np.int64], grid_ns: NDArray[np.int64]) -> NDArray[np.intp]:
    after = np.clip(np.searchsorted(stamps, grid_ns), 1, len(stamps) - 1)
    is_before_nearer = grid_ns - stamps[after - 1] < stamps[after] - grid_ns
    return np.where(is_before_nearer, after - 1, after)


def _held(stamps: NDArray[np.int64], values: Array, grid_ns: NDArray[np.int64], width: int) -> Array:
    """The newest value at each instant of the grid; NaN before the first."""
    if len(stamps) == 0:
        return np.full((len(grid_ns), width), np.nan)
    at = np.searchsorted(stamps, grid_ns, side="right") - 1
    return np.where(at[:, None] >= 0, values[np.maximum(at, 0)], np.nan)
