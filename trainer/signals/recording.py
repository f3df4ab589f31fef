"""One log as arrays, a row a state, in robot time, with the command in effect at each state.

An even state stream is laid on its grid, with rows for the messages that are missing. A stream with uneven steps keeps
its own instants: a row is what was measured then, and never what lies between two measurements.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from spot_log.format.events import FOLLOWING_MODE
from spot_log.read.run import CommandTable, Run, SlowTable, TickTable
from spot_log.tools.measures import NEVER_NS, receipts_ns
from spot_model.errors import SpotRlError
from spot_model.robot.facts import Array
from spot_model.robot.state import Measured

Stamps = NDArray[np.int64]
Flags = NDArray[np.bool_]

MIN_STATES: Final = 50
"""A shorter log says nothing."""
GRID_TOLERANCE: Final = 0.1
"""Share of the period by which a stamp may miss an even grid."""
MAX_GAP_PERIODS: Final = 1.5
"""A wider gap is a loss of messages."""


class RecordingError(SpotRlError):
    """A log that cannot be laid out on a grid; the message says which and why."""


@dataclass(frozen=True)
class Imu:
    """The inertial unit's packets, averaged by state message; NaN where there are none."""

    acceleration_m_s2: Array
    """Expressed in the mounting link's frame. Shape (n, 3)."""
    angular_vel_rad_s: Array
    """Shape (n, 3)."""
    age_s: float
    """How much older the packets are than the state, on average."""


@dataclass(frozen=True)
class Recording(Measured):
    """A log on its grid. n rows, J joints, F feet; rows that the log lacks are NaN, and not ``present``.

    The signs of ``odom_from_body_wxyz`` are continuous in time; a log without contacts has none, shape (n, 0).
    """

    run_id: str
    sequence: str
    """Name of the velocity-command sequence."""
    policy_contract_json: str
    joint_names: tuple[str, ...]
    foot_names: tuple[str, ...]
    period_s: float
    """Between states, the median."""
    stamp_ns: Stamps
    """Robot stamp of each row, rising. Shape (n,)."""
    present: Flags
    """Shape (n,)."""
    imu: Imu
    commands: CommandTable
    command_ns: Stamps
    """When each row of ``commands`` took effect by the robot's own stamp; a large number where it never did."""
    has_receipts: bool
    """Whether the robot said when it received commands; otherwise they count as received when sent."""
    ticks: TickTable
    slow_states: SlowTable
    velocity_command: Array
    """The operator's command in effect. Shape (n, 3); NaN before the first tick."""

    def __len__(self) -> int:
        return len(self.present)

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @property
    def start_ns(self) -> int:
        """Robot stamp of row 0."""
        return int(self.stamp_ns[0])

    @property
    def time_s(self) -> Array:
        """Time since row 0, shape (n,)."""
        return np.asarray((self.stamp_ns - self.start_ns) * 1e-9, dtype=np.float64)

    def next_row(self, robot_stamp_ns: Stamps) -> tuple[NDArray[np.intp], Array]:
        """The first row at or after each stamp, ``len(self)`` where none is, and how much later it is, in periods."""
        row = np.searchsorted(self.stamp_ns, robot_stamp_ns)
        late_ns = self.stamp_ns[np.minimum(row, len(self) - 1)] - robot_stamp_ns
        return row, np.asarray(late_ns * 1e-9 / self.period_s)

    def command_row(self, offset_s: float = 0.0) -> NDArray[np.intp]:
        """Row of ``commands`` in effect at each state's stamp plus ``offset_s``; -1 before the first. Shape (n,)."""
        if len(self.command_ns) == 0:
            return np.full(len(self), -1, dtype=np.intp)
        order = np.argsort(self.command_ns, kind="stable")
        at = np.searchsorted(self.command_ns[order], self.stamp_ns + round(offset_s * 1e9), side="right") - 1
        return np.where(at >= 0, order[np.maximum(at, 0)], -1)

    def in_control(self) -> Flags:
        """Ticks whose set-points are the policy's own, not blended with a stand; all where a log has no modes."""
        active = np.asarray(self.ticks.mode == FOLLOWING_MODE)
        return active if active.any() else np.ones(len(self.ticks), dtype=np.bool_)

    def rows_at(self, robot_stamp_ns: Stamps) -> NDArray[np.intp]:
        """The grid's row nearest to each stamp, within the grid."""
        return nearest_rows(self.stamp_ns, robot_stamp_ns)

    def has(self, signal: str) -> bool:
        """Whether the log has the signal, an attribute's name, in at least half of its rows."""
        values: Any = self
        for part in signal.split("."):
            values = getattr(values, part)
        if values.shape[-1] == 0:
            return False
        if values.dtype == np.bool_:
            return True
        return bool(np.isfinite(values).all(axis=-1).mean() > 0.5)


def record(run: Run) -> Recording:
    """Lay a log out on its grid. Raises RecordingError: the log has too few states, or its stamps do not rise."""
    states = run.states
    if len(states) < MIN_STATES:
        raise RecordingError(f"log {run.path} has {len(states)} states; at least {MIN_STATES} are needed")
    stamps = states.robot_stamp_ns
    steps = np.diff(stamps)
    if np.any(steps <= 0):
        worst = int(np.argmax(steps <= 0))
        raise RecordingError(
            f"log {run.path}: the robot's stamp does not rise after state {worst}; repair the log first"
        )
    period_s = float(np.median(steps)) * 1e-9
    at = (stamps - stamps[0]) * 1e-9 / period_s
    n = round(float(at[-1])) + 1
    if n > 10_000_000:
        raise RecordingError(f"log {run.path} spans {n} periods of {period_s} s; cut it into runs first")
    row = np.round(at).astype(np.intp)
    if np.max(np.abs(at - row)) <= GRID_TOLERANCE and len(np.unique(row)) == len(at):
        row_ns = stamps[0] + np.round(np.arange(n) * period_s * 1e9).astype(np.int64)
        present = np.isin(np.arange(n), row)
    else:
        row, row_ns = np.arange(len(at)), stamps
        present = np.diff(at, prepend=at[0]) <= MAX_GAP_PERIODS
        # Of uneven steps the mean is the same in every log of a recorder, the median is not.
        period_s = float(np.mean(steps[present[1:]])) * 1e-9

    def laid(values: Array) -> Array:
        """Values of shape (m, k) in their rows, shape (n, k); themselves where nothing is missing."""
        if len(values) == len(present) and values.dtype == np.float64:
            return values
        out = np.full((len(present), values.shape[1]), np.nan)
        out[row] = values
        return out

    contact = np.zeros((len(present), states.foot_contact.shape[1]), dtype=np.bool_)
    contact[row] = states.foot_contact
    told = np.full((len(present), 3), np.nan)
    newest = np.searchsorted(run.ticks.robot_stamp_ns, row_ns, side="right") - 1
    told[newest >= 0] = run.ticks.velocity_command[newest[newest >= 0]]
    command_ns = receipts_ns(run)
    has_receipts = bool((command_ns < NEVER_NS).any())
    return Recording(
        run_id=run.header.run_id,
        sequence=run.header.command_sequence,
        policy_contract_json=run.header.policy_contract_json,
        joint_names=run.header.joint_names,
        foot_names=run.header.foot_names,
        period_s=period_s,
        stamp_ns=row_ns,
        present=present,
        position_rad=laid(states.position_rad),
        velocity_rad_s=laid(states.velocity_rad_s),
        load_nm=laid(states.load_nm),
        position_of_body_in_odom_m=laid(states.position_of_body_in_odom_m),
        odom_from_body_wxyz=laid(_continuous(states.odom_from_body_wxyz)),
        linear_vel_of_body_in_odom_m_s=laid(states.linear_vel_of_body_in_odom_m_s),
        angular_vel_of_body_in_odom_rad_s=laid(states.angular_vel_of_body_in_odom_rad_s),
        foot_contact=contact,
        imu=_imu(run, laid),
        commands=run.commands,
        command_ns=command_ns if has_receipts else run.commands.robot_stamp_ns.astype(np.int64),
        has_receipts=has_receipts,
        ticks=run.ticks,
        slow_states=run.slow_states,
        velocity_command=told,
    )


def _imu(run: Run, laid: Callable[[Array], Array]) -> Imu:
    table, n_states = run.states.imu, len(run.states)
    count = np.bincount(table.state_index, minlength=n_states).astype(np.float64)

    def mean(values: Array) -> Array:
        sums = np.stack([np.bincount(table.state_index, values[:, k], minlength=n_states) for k in range(3)], axis=1)
        return np.where(count[:, None] > 0, sums / np.maximum(count, 1.0)[:, None], np.nan)

    ages = run.states.robot_stamp_ns[table.state_index] - table.robot_stamp_ns
    return Imu(
        acceleration_m_s2=laid(mean(table.acceleration_of_imu_in_link_m_s2)),
        angular_vel_rad_s=laid(mean(table.angular_vel_of_link_in_link_rad_s)),
        age_s=float(np.mean(ages)) * 1e-9 if len(ages) else 0.0,
    )


def _continuous(wxyz: Array) -> Array:
    """The same rotations, each quaternion with the sign nearer to the one before."""
    if len(wxyz) < 2:
        return wxyz
    flips = np.sign(np.sum(wxyz[1:] * wxyz[:-1], axis=1))
    flips[~np.isfinite(flips) | (flips == 0.0)] = 1.0
    first = -1.0 if wxyz[0, 0] < 0.0 else 1.0
    return np.asarray(wxyz * np.concatenate([[first], first * np.cumprod(flips)])[:, None])


def nearest_rows(stamps_ns: Stamps, at_ns: Stamps) -> NDArray[np.intp]:
    """The row nearest to each instant, among rising stamps of two rows or more."""
    after = np.clip(np.searchsorted(stamps_ns, at_ns), 1, len(stamps_ns) - 1)
    is_before = at_ns - stamps_ns[after - 1] < stamps_ns[after] - at_ns
    return np.asarray(after - is_before)
