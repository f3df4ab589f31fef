"""Spot for a viewer: boxes, cylinders and spheres, each fixed to a frame that moves with a joint.

The frames are ``body``, as the robot's odometry places it, and one for each joint, named like it: the link behind that
joint. Their transforms need no kinematics: each is a fixed offset and a turn by the measured angle. Sizes are the
joints' distances of :mod:`spot_model.robot.facts`; widths are for the eye alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp

from spot_model.robot import facts

BODY_FRAME: Final = "body"
_YELLOW: Final = (0.98, 0.78, 0.10, 1.0)
_DARK: Final = (0.16, 0.17, 0.19, 1.0)
_GREY: Final = (0.42, 0.44, 0.47, 1.0)
_RUBBER: Final = (0.08, 0.08, 0.08, 1.0)
_LYING: Final = Quaternion(w=math.cos(math.pi / 4), y=math.sin(math.pi / 4))
"""Turns a cylinder's axis from z to x."""

_BODY_LENGTH_M: Final = 2 * facts.HX_FROM_BODY_M[0] + 0.18
_UPPER_M: Final = -facts.KN_FROM_HY_M[2]
_LOWER_M: Final = -facts.FOOT_FROM_KN_M[2]


def joint_transforms(position_rad: Sequence[float], stamp: Timestamp) -> Iterator[FrameTransform]:
    """Where each joint's link is, seen from the link before it. Angles in canonical order, shape (12,)."""
    for i, name in enumerate(facts.JOINT_NAMES):
        leg, _, kind = name.partition("_")
        fore, side = (1.0 if leg[0] == "f" else -1.0), (1.0 if leg[1] == "l" else -1.0)
        parent, offset, is_about_x = {
            "hx": (BODY_FRAME, (fore * facts.HX_FROM_BODY_M[0], side * facts.HX_FROM_BODY_M[1], 0.0), True),
            "hy": (f"{leg}_hx", (0.0, side * facts.HY_FROM_HX_M[1], 0.0), False),
            "kn": (f"{leg}_hy", facts.KN_FROM_HY_M, False),
        }[kind]
        half_rad = 0.5 * position_rad[i]
        sine = math.sin(half_rad)
        yield FrameTransform(
            timestamp=stamp,
            parent_frame_id=parent,
            child_frame_id=name,
            translation=Vector3(x=offset[0], y=offset[1], z=offset[2]),
            rotation=Quaternion(w=math.cos(half_rad), x=sine if is_about_x else 0.0, y=0.0 if is_about_x else sine),
        )


def spot_scene(stamp: Timestamp) -> SceneUpdate:
    """All of Spot's shapes; they stay until they are replaced."""
    entities = [_body(stamp)]
    for leg in facts.LEG_NAMES:
        side = 1.0 if leg[1] == "l" else -1.0
        entities += [_hip(leg, side, stamp), _upper(leg, stamp), _lower(leg, stamp)]
    return SceneUpdate(entities=entities)


def _body(stamp: Timestamp) -> SceneEntity:
    return _entity(
        BODY_FRAME,
        stamp,
        cubes=[
            _cube((0.0, 0.0, 0.0), (_BODY_LENGTH_M, 0.19, 0.15), _YELLOW),
            _cube((0.0, 0.0, 0.085), (_BODY_LENGTH_M * 0.72, 0.15, 0.02), _DARK),
            _cube((_BODY_LENGTH_M / 2, 0.0, 0.0), (0.06, 0.15, 0.12), _DARK),
            _cube((-_BODY_LENGTH_M / 2, 0.0, 0.0), (0.06, 0.15, 0.12), _DARK),
        ],
    )


def _hip(leg: str, side: float, stamp: Timestamp) -> SceneEntity:
    reach_m = facts.HY_FROM_HX_M[1]
    cylinder = CylinderPrimitive(
        pose=_pose((0.0, side * reach_m / 2, 0.0), _LYING),
        size=Vector3(x=0.10, y=0.10, z=0.13),
        bottom_scale=1.0,
        top_scale=1.0,
        color=_color(_DARK),
    )
    return _entity(f"{leg}_hx", stamp, cylinders=[cylinder])


def _upper(leg: str, stamp: Timestamp) -> SceneEntity:
    x_m = facts.KN_FROM_HY_M[0] / 2
    return _entity(
        f"{leg}_hy",
        stamp,
        cubes=[_cube((x_m, 0.0, -_UPPER_M / 2), (0.075, 0.05, _UPPER_M + 0.04), _YELLOW)],
        spheres=[_sphere((0.0, 0.0, 0.0), 0.10, _GREY)],
    )


def _lower(leg: str, stamp: Timestamp) -> SceneEntity:
    return _entity(
        f"{leg}_kn",
        stamp,
        cubes=[_cube((0.0, 0.0, -_LOWER_M / 2), (0.035, 0.03, _LOWER_M), _GREY)],
        spheres=[
            _sphere((0.0, 0.0, 0.0), 0.06, _DARK),
            _sphere(facts.FOOT_FROM_KN_M, 2 * facts.FOOT_RADIUS_M, _RUBBER),
        ],
    )


def _entity(
    frame: str,
    stamp: Timestamp,
    *,
    cubes: Sequence[CubePrimitive] = (),
    spheres: Sequence[SpherePrimitive] = (),
    cylinders: Sequence[CylinderPrimitive] = (),
) -> SceneEntity:
    return SceneEntity(
        timestamp=stamp,
        frame_id=frame,
        id=f"spot/{frame}",
        frame_locked=True,
        cubes=cubes,
        spheres=spheres,
        cylinders=cylinders,
    )


def _cube(centre_m: Sequence[float], size_m: Sequence[float], color: Sequence[float]) -> CubePrimitive:
    return CubePrimitive(pose=_pose(centre_m), size=Vector3(x=size_m[0], y=size_m[1], z=size_m[2]), color=_color(color))


def _sphere(centre_m: Sequence[float], diameter_m: float, color: Sequence[float]) -> SpherePrimitive:
    return SpherePrimitive(
        pose=_pose(centre_m), size=Vector3(x=diameter_m, y=diameter_m, z=diameter_m), color=_color(color)
    )


def _pose(position_m: Sequence[float], orientation: Quaternion | None = None) -> Pose:
    x, y, z = position_m
    return Pose(position=Vector3(x=x, y=y, z=z), orientation=orientation or Quaternion(w=1.0))


def _color(rgba: Sequence[float]) -> Color:
    r, g, b, a = rgba
    return Color(r=r, g=g, b=b, a=a)
