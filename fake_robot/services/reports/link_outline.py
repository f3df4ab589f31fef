"""The links' outlines as OBJ files: boxes, because the vendor's meshes are not ours to give out."""

from __future__ import annotations

from itertools import product

from spot_model.robot.facts import FOOT_FROM_KN_M, FOOT_RADIUS_M, KN_FROM_HY_M
from spot_model.robot.mjcf import BODY_HALF_SIZE_M

_LEGS = ("front_left", "front_right", "rear_left", "rear_right")
_HALF_HIP_M = (0.11, 0.05, 0.05)
_HALF_THIGH_M = 0.05
_FACES = ((1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4))
"""Corners of each side, seen from outside against the clock; corner 1 has the least x, y, z, and z changes first."""

_Corners = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]


def _between(end_m: tuple[float, float, float], half_m: float) -> _Corners:
    """The box around a link that leads from its joint to ``end_m``."""
    x, y, z = end_m
    return (min(0.0, x) - half_m, max(0.0, x) + half_m), (y - half_m, y + half_m), (z - half_m, half_m)


def _around(half_m: tuple[float, float, float]) -> _Corners:
    x, y, z = half_m
    return (-x, x), (-y, y), (-z, z)


_OF_LEG: dict[str, _Corners] = {
    "hip": _around(_HALF_HIP_M),
    "upper_leg": _between(KN_FROM_HY_M, _HALF_THIGH_M),
    "lower_leg": _between(FOOT_FROM_KN_M, FOOT_RADIUS_M),
}
_BOXES: dict[str, _Corners] = {
    "body": _around(BODY_HALF_SIZE_M),
    **{f"{leg}_{part}": box for leg in _LEGS for part, box in _OF_LEG.items()},
}
LINK_NAMES = tuple(_BOXES)
"""The links, by the names of the robot's skeleton."""


def outline_obj(link: str) -> str:
    """The OBJ text of a link's box, in metres, in the link's frame. Raises KeyError for an unknown link."""
    corners = [f"v {x:g} {y:g} {z:g}" for x, y, z in product(*_BOXES[link])]
    faces = [f"f {' '.join(map(str, face))}" for face in _FACES]
    return "\n".join([f"o {link}", *corners, *faces, ""])
