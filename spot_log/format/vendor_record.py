"""The log's state record, copied straight from the vendor's message; going through arrays costs three times as much."""

from __future__ import annotations

from typing import Final

from bosdyn.api import geometry_pb2, robot_state_pb2
from google.protobuf.timestamp_pb2 import Timestamp

from spot_log.format.vendor_state import N_JOINTS_WITH_ARM, StateMessageError
from spot_model.robot.facts import N_JOINTS
from spot_model.robot.stamps import NS_PER_S
from spot_protos import log_pb2

_CONTACT_MADE: Final = robot_state_pb2.FootState.CONTACT_MADE


def state_record_from_wire(wire: bytes, host_stamp_ns: int) -> log_pb2.State:
    """Decode the wire bytes of a RobotStateStreamResponse into the log's record; the arm's joints are left out.

    What is missing in the message is missing in the record.

    Raises:
        google.protobuf.message.DecodeError: The bytes are no such message.
        StateMessageError: It has another number of joints than Spot.
    """
    message = robot_state_pb2.RobotStateStreamResponse.FromString(wire)
    joints = message.joint_states
    if len(joints.position) not in (0, N_JOINTS, N_JOINTS_WITH_ARM):
        raise StateMessageError(
            f"state message has {len(joints.position)} joint positions; "
            f"Spot sends {N_JOINTS}, or {N_JOINTS_WITH_ARM} with an arm"
        )
    try:
        return _record(message, host_stamp_ns)
    except ValueError as error:  # a stamp that no clock shows
        raise StateMessageError(f"state message cannot be kept: {error}") from error


def _record(message: robot_state_pb2.RobotStateStreamResponse, host_stamp_ns: int) -> log_pb2.State:
    joints, kinematics, last = message.joint_states, message.kinematic_state, message.last_command
    pose, velocity = kinematics.odom_tform_body, kinematics.velocity_of_body_in_odom
    return log_pb2.State(
        robot_stamp_ns=_stamp_ns(joints.acquisition_timestamp),
        host_stamp_ns=host_stamp_ns,
        position_rad=joints.position[:N_JOINTS],
        velocity_rad_s=joints.velocity[:N_JOINTS],
        load_nm=joints.load[:N_JOINTS],
        position_of_body_in_odom_m=_vector(pose.position),
        odom_from_body_wxyz=_quaternion_wxyz(pose.rotation),
        linear_vel_of_body_in_odom_m_s=_vector(velocity.linear),
        angular_vel_of_body_in_odom_rad_s=_vector(velocity.angular),
        foot_contact=[contact == _CONTACT_MADE for contact in message.contact_states],
        last_command_key=last.user_command_key,
        last_command_robot_stamp_ns=_stamp_ns(last.received_timestamp),
        imu=[
            log_pb2.ImuPacket(
                robot_stamp_ns=_stamp_ns(packet.timestamp),
                acceleration_of_imu_in_link_m_s2=_vector(packet.acceleration_rt_odom_in_link_frame),
                angular_vel_of_link_in_link_rad_s=_vector(packet.angular_velocity_rt_odom_in_link_frame),
                odom_from_link_wxyz=_quaternion_wxyz(packet.odom_rot_link),
            )
            for packet in message.inertial_state.packets
        ],
    )


def _stamp_ns(timestamp: Timestamp) -> int:
    return timestamp.seconds * NS_PER_S + timestamp.nanos


def _vector(vector: geometry_pb2.Vec3) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


def _quaternion_wxyz(quaternion: geometry_pb2.Quaternion) -> tuple[float, float, float, float]:
    return quaternion.w, quaternion.x, quaternion.y, quaternion.z
