"""Copies in Foxglove's message types at 50 Hz, which a viewer shows without set-up, and Spot's shapes.

Each shape is fixed to a frame: ``body``, as the robot's odometry places it, or one named like a joint, the link behind
it. Their transforms need no kinematics: each is a fixed offset and a turn by the measured angle. Sizes are the joints'
distances of :mod:`spot_model.robot.facts`; widths are for the eye alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointState_pb2 import JointState
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Odometry_pb2 import Odometry
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp

from spot_model.robot import facts
from spot_model.robot.facts import NS_PER_S
from spot_protos import log_pb2

VIEWER_PERIOD_NS: Final = 20_000_000
ODOM_FRAME: Final = "odom"
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
        fore, side = (1.0 if leg[0] == "f" else -1.0), _side(leg)
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


_Xyz = tuple[float, float, float]
_Shape = tuple[str, _Xyz, _Xyz, tuple[float, float, float, float]]
"""Kind, centre in its frame (m), size (m) and colour."""


def _shapes(kind: str, side: float) -> list[_Shape]:
    """The shapes that move with the body, or with a joint; ``side`` is 1 for a left leg and -1 for a right one."""
    end_m, hip_m, knee_m = _BODY_LENGTH_M / 2, side * facts.HY_FROM_HX_M[1] / 2, facts.KN_FROM_HY_M[0] / 2
    foot_m, origin_m = 2 * facts.FOOT_RADIUS_M, (0.0, 0.0, 0.0)
    shapes: dict[str, list[_Shape]] = {
        BODY_FRAME: [
            ("cubes", origin_m, (_BODY_LENGTH_M, 0.19, 0.15), _YELLOW),
            ("cubes", (0.0, 0.0, 0.085), (_BODY_LENGTH_M * 0.72, 0.15, 0.02), _DARK),
            ("cubes", (end_m, 0.0, 0.0), (0.06, 0.15, 0.12), _DARK),
            ("cubes", (-end_m, 0.0, 0.0), (0.06, 0.15, 0.12), _DARK),
        ],
        "hx": [("cylinders", (0.0, hip_m, 0.0), (0.10, 0.10, 0.13), _DARK)],
        "hy": [
            ("cubes", (knee_m, 0.0, -_UPPER_M / 2), (0.075, 0.05, _UPPER_M + 0.04), _YELLOW),
            ("spheres", origin_m, (0.10, 0.10, 0.10), _GREY),
        ],
        "kn": [
            ("cubes", (0.0, 0.0, -_LOWER_M / 2), (0.035, 0.03, _LOWER_M), _GREY),
            ("spheres", origin_m, (0.06, 0.06, 0.06), _DARK),
            ("spheres", facts.FOOT_FROM_KN_M, (foot_m, foot_m, foot_m), _RUBBER),
        ],
    }
    return shapes[kind]


def spot_scene(host_ns: int) -> SceneUpdate:
    """All of Spot's shapes, fixed to those frames; they stay until they are replaced."""
    scene, stamp = SceneUpdate(), timestamp(host_ns)
    for frame in (BODY_FRAME, *facts.JOINT_NAMES):
        entity = scene.entities.add(timestamp=stamp, frame_id=frame, id=f"spot/{frame}", frame_locked=True)
        for kind, centre_m, size_m, (r, g, b, a) in _shapes(frame[-2:] if "_" in frame else frame, _side(frame)):
            is_round = kind == "cylinders"
            ends = {"bottom_scale": 1.0, "top_scale": 1.0} if is_round else {}
            pose = Pose(position=_vector(centre_m), orientation=_LYING if is_round else Quaternion(w=1.0))
            getattr(entity, kind).add(pose=pose, size=_vector(size_m), color=Color(r=r, g=g, b=b, a=a), **ends)
    return scene


def _side(name: str) -> float:
    return 1.0 if name[1] == "l" else -1.0


_LEVELS: Final = {
    log_pb2.Event.INFO: Log.Level.INFO,
    log_pb2.Event.WARNING: Log.Level.WARNING,
    log_pb2.Event.ERROR: Log.Level.ERROR,
}


def joint_states(state: log_pb2.State, names: Sequence[str], host_ns: int) -> JointStates:
    """Positions (rad), velocities (rad/s) and loads (N·m) by joint name; a signal that the state lacks is left out."""
    n = len(names)
    columns = {"name": names, "position": state.position_rad, "velocity": state.velocity_rad_s, "effort": state.load_nm}
    present = {key: list(values) for key, values in columns.items() if len(values) == n}
    rows = (dict(zip(present, row, strict=True)) for row in zip(*present.values(), strict=True))
    return JointStates(timestamp=timestamp(host_ns), joints=[JointState(**row) for row in rows])


def transforms(state: log_pb2.State, host_ns: int, *, is_spot: bool = True) -> FrameTransforms:
    """The body's pose in odom, and the place of each joint's link, where the joints are Spot's."""
    transform = FrameTransform(
        timestamp=timestamp(host_ns),
        parent_frame_id=ODOM_FRAME,
        child_frame_id=BODY_FRAME,
        translation=_vector(state.position_of_body_in_odom_m),
        rotation=_quaternion(state.odom_from_body_wxyz),
    )
    links = joint_transforms(state.position_rad, timestamp(host_ns)) if is_spot else ()
    return FrameTransforms(transforms=[transform, *links])


def odometry(state: log_pb2.State, host_ns: int) -> Odometry:
    """Pose in odom, and velocities in the body frame, as Foxglove expects."""
    return Odometry(
        timestamp=timestamp(host_ns),
        frame_id=ODOM_FRAME,
        body_frame_id=BODY_FRAME,
        pose=Pose(
            position=_vector(state.position_of_body_in_odom_m), orientation=_quaternion(state.odom_from_body_wxyz)
        ),
        linear_velocity=_in_body(state.odom_from_body_wxyz, state.linear_vel_of_body_in_odom_m_s),
        angular_velocity=_in_body(state.odom_from_body_wxyz, state.angular_vel_of_body_in_odom_rad_s),
    )


def event_text(event: log_pb2.Event) -> Log:
    """One line for a viewer's log panel."""
    values = "".join(f" {key}={value:g}" for key, value in event.values.items())
    return Log(
        timestamp=timestamp(event.host_stamp_ns),
        level=_LEVELS.get(event.severity, Log.Level.UNKNOWN),
        message=f"{event.text}{values}",
        name=event.name,
    )


def has_pose(state: log_pb2.State) -> bool:
    """Tell whether pose and velocity of the body are in the state; other robots' logs may lack them."""
    return (
        len(state.odom_from_body_wxyz) == 4
        and len(state.position_of_body_in_odom_m) == 3
        and len(state.linear_vel_of_body_in_odom_m_s) == 3
        and len(state.angular_vel_of_body_in_odom_rad_s) == 3
    )


def timestamp(stamp_ns: int) -> Timestamp:
    """A time of a viewer's message."""
    return Timestamp(seconds=stamp_ns // NS_PER_S, nanos=stamp_ns % NS_PER_S)


def _vector(values: Sequence[float]) -> Vector3:
    x, y, z = values
    return Vector3(x=x, y=y, z=z)


def _in_body(odom_from_body_wxyz: Sequence[float], vector_in_odom: Sequence[float]) -> Vector3:
    """Rotate one vector by plain arithmetic: arrays cost thirty times as much for a single one."""
    w, x, y, z = odom_from_body_wxyz
    a, b, c = vector_in_odom
    tx, ty, tz = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
    return Vector3(x=a - w * tx + y * tz - z * ty, y=b - w * ty + z * tx - x * tz, z=c - w * tz + x * ty - y * tx)


def _quaternion(values_wxyz: Sequence[float]) -> Quaternion:
    w, x, y, z = values_wxyz
    return Quaternion(w=w, x=x, y=y, z=z)
