"""Signals that stand still though their neighbours move."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from spot_model.robot import facts
from spot_model.robot.state import Array, RobotState
from spot_runtime.control.safety.signals import bounds

Counts = NDArray[np.int64]
N_SIGNALS: Final = 4 * facts.N_JOINTS + 7

NAMES: Final = (
    *(f"position of {name}" for name in facts.JOINT_NAMES),
    *(f"velocity of {name}" for name in facts.JOINT_NAMES),
    *(f"load of {name}" for name in facts.JOINT_NAMES),
    *(f"all of {name}" for name in facts.JOINT_NAMES),
    "attitude",
    *(f"the body's velocity, {axis}" for axis in "xyz"),
    *(f"the body's turn rate, {axis}" for axis in "xyz"),
)
"""Of the signals, in the order of :func:`still_windows`."""

WINDOWS: Final = np.array(
    [bounds.LOAD_WINDOWS_STILL if name.startswith("load") else bounds.STILL_WINDOWS for name in NAMES]
)
"""Windows after which a signal is no longer trusted. Shape (55,)."""

IS_NEEDED: Final[NDArray[np.bool_]] = np.array([not name.startswith("load") for name in NAMES])
"""Whether control needs the signal: nothing does need a load."""

NO_COUNTS: Final[Counts] = np.zeros(N_SIGNALS, dtype=np.int64)
NO_COUNTS.flags.writeable = False
_KINDS: Final = tuple(slice(i * facts.N_JOINTS, (i + 1) * facts.N_JOINTS) for i in range(3))
_POSITIONS, _, _LOADS = _KINDS
_WHOLE: Final = slice(3 * facts.N_JOINTS, 4 * facts.N_JOINTS)
"""A joint of which nothing changes at all, judged even if eleven of twelve are so."""
_BODY: Final = slice(4 * facts.N_JOINTS, N_SIGNALS)
_RESOLUTIONS: Final = (bounds.POSITION_NOISE_RAD, bounds.VELOCITY_NOISE_RAD_S, bounds.LOAD_NOISE_NM)


def still_windows(counts: Counts, first: RobotState, last: RobotState) -> Counts:
    """Count on, signal by signal, in how many windows in a row it stood still while its neighbours moved.

    Args:
        counts: Before this window. Shape (55,), in the order of :data:`NAMES`.
        first: State at the start of the window.
        last: State at its end.

    Returns:
        The new counts. Where neighbours move quickly, a window counts as much as two; where they stand, nothing. A
        signal that changes begins anew.
    """
    after = np.empty_like(counts)
    changes = (
        np.abs(last.position_rad - first.position_rad),
        np.abs(last.velocity_rad_s - first.velocity_rad_s),
        np.abs(last.load_nm - first.load_nm),
    )
    middle = round((1.0 - bounds.MOVING_SHARE) * facts.N_JOINTS)
    # Half of the neighbours move by at least this much, in units of what a sensor resolves.
    in_order = [np.sort(change) for change in changes]
    moves = [float(change[middle]) / resolution for change, resolution in zip(in_order, _RESOLUTIONS, strict=True)]
    for kind, change, ordered, move in zip(_KINDS, changes, in_order, moves, strict=True):
        step = 0
        if move > 1.0 and ordered[middle] < bounds.STEPS * ordered[ordered > 0.0][0]:
            pass  # the sensors resolve no less
        elif move > 1.0:
            is_quick = move > bounds.QUICK_FACTOR and kind is not _LOADS
            step = bounds.STILL_WINDOWS // bounds.QUICK_WINDOWS if is_quick else 1
        elif kind is not _POSITIONS and not change.any():
            # All of a kind stand still; loads that are all zero are not reported at all.
            others = [other for other, its_kind in zip(moves, _KINDS, strict=True) if its_kind is not kind]
            step = int(min(others) > 1.0 and (kind is not _LOADS or last.load_nm.any()))
        after[kind] = np.where(change == 0.0, counts[kind] + step, 0)
    has_motion = bool((changes[1] > bounds.VELOCITY_NOISE_RAD_S).any() or (changes[2] > bounds.LOAD_NOISE_NM).any())
    is_same = (changes[0] == 0.0) & (changes[1] == 0.0) & (changes[2] == 0.0)
    after[_WHOLE] = np.where(is_same, counts[_WHOLE] + int(has_motion), 0)
    after[_BODY] = np.where(_is_body_same(first, last), counts[_BODY] + int(max(moves[:2]) > 1.0), 0)
    return after


def _is_body_same(first: RobotState, last: RobotState) -> NDArray[np.bool_]:
    linear: Array = last.linear_vel_of_body_in_odom_m_s == first.linear_vel_of_body_in_odom_m_s
    angular: Array = last.angular_vel_of_body_in_odom_rad_s == first.angular_vel_of_body_in_odom_rad_s
    attitude = bool((last.odom_from_body_wxyz == first.odom_from_body_wxyz).all())
    return np.concatenate([[attitude], linear, angular])
