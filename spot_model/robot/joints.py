"""Naming sets of joints: all, a joint type, a leg, a side, or single joints."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from spot_model.errors import BadInputError
from spot_model.robot.facts import JOINT_NAMES, JOINT_TYPES, LEG_NAMES

_GROUPS: dict[str, tuple[str, ...]] = {
    "all": JOINT_NAMES,
    "hips": tuple(n for n in JOINT_NAMES if not n.endswith("kn")),
    "knees": tuple(n for n in JOINT_NAMES if n.endswith("kn")),
    **{kind: tuple(n for n in JOINT_NAMES if n.endswith(kind)) for kind in JOINT_TYPES},
    **{leg: tuple(n for n in JOINT_NAMES if n.startswith(leg)) for leg in LEG_NAMES},
    **{name: (name,) for name in JOINT_NAMES},
}


def select_joints(names: Iterable[str]) -> NDArray[np.bool_]:
    """Turn names of joints or groups into a mask.

    Args:
        names: Any of ``all``, ``hips``, ``knees``, a type (``hx``), a leg (``fl``), a joint (``fl_kn``).

    Returns:
        Mask of shape (12,), canonical joint order.

    Raises:
        BadInputError: A name is unknown, or there is none.
    """
    chosen: set[str] = set()
    for name in names:
        if name not in _GROUPS:
            raise BadInputError(f"joints: {name!r} is no joint or group of joints; allowed: {', '.join(_GROUPS)}")
        chosen.update(_GROUPS[name])
    if not chosen:
        raise BadInputError("joints: the list is empty; name at least one joint or group, or 'all'")
    return np.array([name in chosen for name in JOINT_NAMES])


def describe_joints(mask: NDArray[np.bool_]) -> tuple[str, ...]:
    """The shortest list of names that :func:`select_joints` turns back into ``mask``, shape (12,)."""
    left = {name for name, chosen in zip(JOINT_NAMES, mask, strict=True) if chosen}
    names: list[str] = []
    for group, members in _GROUPS.items():
        if members and left.issuperset(members):
            names.append(group)
            left.difference_update(members)
    return tuple(names)
