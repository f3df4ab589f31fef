"""The same data once more in Foxglove's own message types, at 50 Hz, so that a viewer shows it without set-up."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointState_pb2 import JointState
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Odometry_pb2 import Odometry
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp

from spot_model.rotation import rotate_inverse_wxyz
from spot_protos import log_pb2

NS_PER_S: Final = 1_000_000_000
VIEWER_PERIOD_NS: Final = 20_000_000
ODOM_FRAME: Final = "odom"
BODY_FRAME: Final = "body"

_LEVELS: Final = {
    log_pb2.Event.INFO: Log.Level.INFO,
    log_pb2.Event.WARNING: Log.Level.WARNING,
    log_pb2.Event.ERROR: Log.Level.ERROR,
}


def joint_states(state: log_pb2.State, names: Sequence[str], host_ns: int) -> JointStates:
    """Positions (rad), velocities (rad/s) and loads (N·m) by joint name; a signal that the state lacks is left out."""
    message = JointStates(timestamp=_timestamp(host_ns))
    signals = {"position": state.position_rad, "velocity": state.velocity_rad_s, "effort": state.load_nm}
    present = {name: values for name, values in signals.items() if len(values) == len(names)}
    for i, name in enumerate(names):
        message.joints.append(JointState(name=name, **{key: values[i] for key, values in present.items()}))
    return message


def transforms(state: log_pb2.State, host_ns: int) -> FrameTransforms:
    """The body's pose in odom."""
    transform = FrameTransform(
        timestamp=_timestamp(host_ns),
        parent_frame_id=ODOM_FRAME,
        child_frame_id=BODY_FRAME,
        translation=_vector(state.position_of_body_in_odom_m),
        rotation=_quaternion(state.odom_from_body_wxyz),
    )
    return FrameTransforms(transforms=[transform])


def odometry(state: log_pb2.State, host_ns: int) -> Odometry:
    """Pose in odom, and velocities expressed in the body frame as Foxglove wants them."""
    velocities = np.array([state.linear_vel_of_body_in_odom_m_s, state.angular_vel_of_body_in_odom_rad_s])
    linear, angular = rotate_inverse_wxyz(np.array(state.odom_from_body_wxyz)[None], velocities)
    return Odometry(
        timestamp=_timestamp(host_ns),
        frame_id=ODOM_FRAME,
        body_frame_id=BODY_FRAME,
        pose=Pose(
            position=_vector(state.position_of_body_in_odom_m), orientation=_quaternion(state.odom_from_body_wxyz)
        ),
        linear_velocity=_vector(linear.tolist()),
        angular_velocity=_vector(angular.tolist()),
    )


def event_text(event: log_pb2.Event) -> Log:
    """One line for a viewer's log panel."""
    values = "".join(f" {key}={value:g}" for key, value in event.values.items())
    return Log(
        timestamp=_timestamp(event.host_stamp_ns),
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


def _timestamp(stamp_ns: int) -> Timestamp:
    return Timestamp(seconds=stamp_ns // NS_PER_S, nanos=stamp_ns % NS_PER_S)


def _vector(values: Sequence[float]) -> Vector3:
    x, y, z = values
    return Vector3(x=x, y=y, z=z)


def _quaternion(values_wxyz: Sequence[float]) -> Quaternion:
    w, x, y, z = values_wxyz
    return Quaternion(w=w, x=x, y=y, z=z)
