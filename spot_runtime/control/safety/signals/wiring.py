"""Joints read with the wrong sign, or as other joints: which single such error would explain what cannot be.

An adapter that errs alike in positions, velocities, loads and set-points contradicts itself nowhere, and a symmetric
stand at rest shows none of it. What contradicts it is the ground, as soon as body and joints move: feet that stand
would slide. Only such an error that is named, and makes those feet stand, counts.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_runtime.control.safety.signals import bounds
from spot_runtime.control.safety.signals.legs import feet, sole_speeds_m_s, stance_of
from spot_runtime.control.safety.signals.window import Window
from spot_runtime.control.safety.states import is_between

_JOINTS: Final[NDArray[np.int64]] = np.array(np.split(np.arange(facts.N_JOINTS), facts.N_LEGS))
_ENDS: Final = {"left": [0, 2], "right": [1, 3], "front": [0, 1], "hind": [2, 3]}


def _errors() -> Iterator[tuple[str, NDArray[np.int64], NDArray[np.int64]]]:
    """Words, joints that are mirrored (or exchanged), and those that they are exchanged with (none: mirrored)."""
    of_a_kind = [legs_of for kind in _JOINTS.T for legs_of in (kind, *(kind[legs] for legs in _ENDS.values()))]
    singles = _JOINTS.ravel()[:, np.newaxis]
    for group in (*singles, *of_a_kind):
        yield ", ".join(facts.JOINT_NAMES[joint] for joint in group) + " mirrored", group, group[:0]
    for kind, names, joints in (("", facts.JOINT_NAMES, singles), ("legs ", facts.LEG_NAMES, _JOINTS)):
        for a, b in combinations(range(len(names)), 2):
            yield f"{kind}{names[a]} and {names[b]} exchanged", joints[a], joints[b]
    for one, other in (("left", "right"), ("front", "hind")):
        yield f"{one} and {other} legs exchanged", _JOINTS[_ENDS[one]].ravel(), _JOINTS[_ENDS[other]].ravel()


NAMES: Final = tuple(name for name, _, _ in _errors())
"""The errors in words."""
_ORDER: Final = np.tile(_JOINTS.ravel(), (len(NAMES), 1))
_IS_MIRRORED: Final = np.full(_ORDER.shape, False)
for _row, (_, _one, _other) in enumerate(_errors()):
    _ORDER[_row, [*_one, *_other]] = [*_other, *_one]
    _IS_MIRRORED[_row, [] if len(_other) else _one] = True


def readings(joints: Array) -> Array:
    """What joints of shape (12,) would be without each of the errors. Shape (number of :data:`NAMES`, 12)."""
    return np.where(_IS_MIRRORED, -joints, joints[_ORDER])


def explanations(window: Window) -> tuple[str, ...]:
    """Single errors of joint positions after which a wrong stance would be possible, in words."""
    state, up = window.last, window.odom_from_body[2]
    return tuple(
        words
        for words, position_rad in zip(NAMES, readings(state.position_rad), strict=True)
        if is_between(position_rad, position_rad) and stance_of(position_rad, state.load_nm, up).is_possible
    )


class WiringMemory(NamedTuple):
    """How feet that should stand have slid of late, as the joints are reported and without each of the errors."""

    felt_s: float = 0.0
    """Time in which any foot stood; it fades, s."""
    slid: Array = np.zeros(1 + len(NAMES))
    """Mean square of their speeds over ground, summed over that time, m²/s; first as reported, then without each."""
    windows: int = 0
    """In a row in which one of the errors explained it."""

    @property
    def explained(self) -> str:
        """The error that explains best what the feet did, in words."""
        return NAMES[int(self.slid[1:].argmin())]


def after_window(memory: WiringMemory, window: Window, carried_n: Array | None) -> WiringMemory:
    """The memory after one more window; ``carried_n`` is the upward force on each foot, None where it is not known."""
    stands = standing(window, carried_n)
    if not stands.any():
        return memory
    state, body_from_odom = window.last, window.odom_from_body.T
    position, velocity = (np.vstack([q, readings(q)]) for q in (state.position_rad, state.velocity_rad_s))
    speeds = sole_speeds_m_s(
        feet(position, velocity),
        velocity_m_s=body_from_odom @ state.linear_vel_of_body_in_odom_m_s,
        turn_rate_rad_s=body_from_odom @ state.angular_vel_of_body_in_odom_rad_s,
        up=window.odom_from_body[2],
    )[:, stands]
    fade = max(0.0, 1.0 - window.duration_s / bounds.FOOT_MEMORY_S)
    squares = (np.minimum(speeds, bounds.FOOT_SPEED_M_S) ** 2).mean(axis=1)
    felt_s, slid = memory.felt_s * fade + window.duration_s, memory.slid * fade + squares * window.duration_s
    is_sliding = felt_s >= 0.5 * bounds.FOOT_MEMORY_S and slid[0] > bounds.MISREAD_M_S**2 * felt_s
    is_explained = is_sliding and slid[1:].min() <= bounds.MISREAD_SHARE * slid[0]
    return WiringMemory(felt_s, slid, memory.windows + 1 if is_explained else 0)


def standing(window: Window, carried_n: Array | None) -> NDArray[np.bool_]:
    """Feet that touched the ground throughout and carry something, shape (4,); none where loads are not known."""
    if carried_n is None:
        return np.full(facts.N_LEGS, False)
    is_loaded = carried_n > bounds.FOOT_LEAST_SHARE * bounds.WEIGHT_N
    return np.asarray(window.first.foot_contact & window.last.foot_contact & is_loaded)
