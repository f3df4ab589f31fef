"""Signals that stand still though their neighbours move."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.state import RobotState
from spot_runtime.control.safety.signals import bounds
from spot_runtime.control.safety.signals.readers import Signal

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
"""Names of the signals, in the order of :func:`still_windows`."""

WINDOWS: Final = np.array(
    [bounds.LOAD_WINDOWS_STILL if name.startswith("load") else bounds.STILL_WINDOWS for name in NAMES]
)
"""Windows after which a signal is no longer trusted. Shape (55,)."""

SUSPECTS: Final = (
    *[frozenset({kind}) for kind in (Signal.POSITION, Signal.VELOCITY, Signal.LOAD) for _ in facts.JOINT_NAMES],
    *[frozenset({Signal.POSITION, Signal.VELOCITY})] * facts.N_JOINTS,
    frozenset({Signal.ATTITUDE}),
    *[frozenset({Signal.BODY_VELOCITY})] * 3,
    *[frozenset({Signal.TURN_RATE})] * 3,
)
"""What each of them belongs to."""

NO_COUNTS: Final[Counts] = np.zeros(N_SIGNALS, dtype=np.int64)
NO_COUNTS.flags.writeable = False
_KINDS: Final = tuple(slice(i * facts.N_JOINTS, (i + 1) * facts.N_JOINTS) for i in range(3))
_POSITIONS, _, _LOADS = _KINDS
_WHOLE: Final = slice(3 * facts.N_JOINTS, 4 * facts.N_JOINTS)
"""A joint of which nothing changes at all, judged even if eleven of twelve are so, as long as one lives: all that it
reports changes in each window, or it moves quickly."""
_BODY: Final = slice(4 * facts.N_JOINTS, N_SIGNALS)
_RESOLUTIONS: Final = np.array([bounds.POSITION_NOISE_RAD, bounds.VELOCITY_NOISE_RAD_S, bounds.LOAD_NOISE_NM])


def still_windows(
    counts: Counts, first: RobotState, last: RobotState, resting: NDArray[np.bool_], *, has_loads: bool
) -> Counts:
    """Count on, signal by signal, in how many windows in a row it stood still while its neighbours moved.

    ``counts`` are those before the window, shape (55,), in the order of :data:`NAMES`; ``first`` and ``last`` are
    the states at its ends. Of joints known to rest, shape (12,), positions and velocities may repeat, not both.

    Where neighbours move quickly, a window counts as much as two; where they stand, it takes one back, so that nothing
    gathers while nothing happens. A signal that changes begins anew.
    """
    after = np.empty_like(counts)
    changes = np.abs(
        [
            last.position_rad - first.position_rad,
            last.velocity_rad_s - first.velocity_rad_s,
            last.load_nm - first.load_nm,
        ]
    )
    is_pair = (changes[:2] == 0.0).all(axis=0)
    middle = round((1.0 - bounds.MOVING_SHARE) * facts.N_JOINTS)
    # Half of the neighbours move by at least this much, in units of what a sensor resolves.
    moved = np.sort(changes, axis=1)[:, middle]
    moves, moves_most = moved / _RESOLUTIONS, changes.max(axis=1) / _RESOLUTIONS
    is_quick = moves[:2].max() > bounds.QUICK_FACTOR
    for number, kind in enumerate(_KINDS):
        change, step = changes[number], -1
        if not change.any():
            # All of a kind stand still, which their own sensors' steps may do until the joints move quickly.
            step = int(kind is not _POSITIONS and is_quick and (kind is not _LOADS or has_loads)) or -1
        elif moves[number] > 1.0 and moved[number] >= bounds.STEPS * change[change > 0.0].min():
            # Neighbours that move by fewer steps of their sensors say nothing.
            most = bounds.STILL_WINDOWS // bounds.QUICK_WINDOWS
            step = most if kind is not _LOADS and moves[number] > bounds.QUICK_FACTOR else 1
        is_judged = (kind is _LOADS) | ~resting | is_pair
        counted = np.maximum(counts[kind] + np.where(is_judged, step, -1), 0)
        after[kind] = np.where(change == 0.0, counted, 0)
    is_reported = np.array([True, True, has_loads])
    is_same = (changes == 0.0).all(axis=0)
    # Coarse sensors of a robot at rest repeat, but for some joints that cannot decide between two of their steps.
    lives = (changes[is_reported] > 0.0).all(axis=0)
    is_alive = lives.mean() >= bounds.MOVING_SHARE or (moves_most[:2] > bounds.QUICK_FACTOR).any()
    after[_WHOLE] = np.where(is_same & is_alive, counts[_WHOLE] + 1, 0)
    # An estimator may hold attitude and rates of a robot at rest.
    body = _body(last)
    is_same = body == _body(first)
    is_same[0] = bool((last.odom_from_body_wxyz == first.odom_from_body_wxyz).all())
    after[_BODY] = np.where(is_same, np.maximum(counts[_BODY] + (1 if is_quick else -1), 0), 0)
    return after


def _body(state: RobotState) -> Array:
    linear, angular = state.linear_vel_of_body_in_odom_m_s, state.angular_vel_of_body_in_odom_rad_s
    return np.concatenate([[1.0], linear, angular])
